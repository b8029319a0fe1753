"""Boards of one to twelve axes: the emulator, and a Mega's binary in simavr, pin by pin."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import closing
from functools import partial
from itertools import pairwise

import pytest

from ccr_host.link import messages as m
from ccr_host.link.framing import encode_frame
from ccr_host.sim.board.eeprom import EepromImage
from tests.conformance.device import EmulatedDevice, SimavrDevice, SteppedDevice
from tests.conformance.talk import Talk

SESSION = 0x5E55
AXIS_TICKS = 2
FLOOD_BYTES = 20_000
"""40 ticks of a line that never pauses."""
BOARDS: dict[str, Callable[..., SteppedDevice]] = {
    **{f"emulator {axes}": partial(EmulatedDevice, axes=axes) for axes in (1, 6, 12)},
    **{
        f"mega2560 {axes}": partial(SimavrDevice, board="mega2560", axes=axes)
        for axes in (1, 6, 12)
    },
}


class Robot:
    """A board with its configuration: each axis has another neutral pulse."""

    def __init__(self, device: SteppedDevice, axes: int) -> None:
        self.device, self.axes = device, axes
        self.talk = Talk(device)
        self._sequence = 0
        self.calibration = m.Calibration(
            tuple(3000 + 20 * axis for axis in range(axes)),
            tuple(2000 if axis % 2 else -2000 for axis in range(axes)),
            (1000,) * axes,
            (5000,) * axes,
        )

    def ask(self, request: m.Request) -> m.Message:
        self._sequence = (self._sequence + 1) % 256
        answer = self.talk.ask_frame(request.ID, self._sequence, request.pack())
        return m.MESSAGES[answer.id].unpack(answer.payload, self.axes)

    def done(self, request: m.Request) -> None:
        assert isinstance(self.ask(request), m.Ack), request

    def report(self) -> m.StateReport:
        reply = self.ask(m.GetState())
        assert isinstance(reply, m.StateReply)
        return reply.report

    def counters(self) -> m.CountersReply:
        reply = self.ask(m.GetCounters())
        assert isinstance(reply, m.CountersReply)
        return reply

    def wait_ticks(self, ticks: int) -> None:
        self.device.advance_to(self.device.since_reset_us() + ticks * m.TICK_US)

    def pulses(self) -> tuple[int, ...]:
        """Read the pulses in the next whole frame."""
        return self.device.pulses_in_frame(self.device.since_reset_us() // m.TICK_US + 1)

    def begin(self) -> None:
        self.wait_ticks(m.BOOT_TICKS + 2)
        assert isinstance(self.ask(m.OpenSession(m.SPEC_HASH, SESSION)), m.SessionReply)

    def configure(self) -> None:
        limits = m.Limits((-8500,) * self.axes, (8500,) * self.axes, (0,) * self.axes)
        self.done(m.SetLimits(SESSION, limits))
        self.done(m.SetSlew(SESSION, m.Slew((2000,) * self.axes)))
        self.done(m.SetWatchdog(SESSION, m.Watchdog(60_000, 500, AXIS_TICKS * 20)))
        self.done(m.SetCalibration(SESSION, self.calibration))

    def arm(self) -> None:
        self.done(m.Arm(SESSION))
        self.wait_ticks(self.axes * AXIS_TICKS + 3)
        assert self.report().state is m.State.HOLD


@pytest.fixture(params=BOARDS)
def robot(request: pytest.FixtureRequest) -> Iterator[Robot]:
    axes = int(request.param.split()[1])
    with closing(BOARDS[request.param](EepromImage())) as device:
        yield Robot(device, axes)


@pytest.fixture
def configured(robot: Robot) -> Robot:
    robot.begin()
    robot.configure()
    return robot


def test_hello_tells_the_axes_and_the_longest_payload(robot: Robot) -> None:
    identity = robot.ask(m.Hello(m.PROTOCOL_VERSION, m.SPEC_HASH))
    assert isinstance(identity, m.HelloReply)
    assert identity.axes == robot.axes
    assert identity.max_payload == m.MAX_PAYLOAD.of(robot.axes)


def test_lengths_are_exact(robot: Robot) -> None:
    robot.begin()
    for axes in {1, 2, 6, 12, robot.axes - 1, robot.axes + 1} - {0, 13, robot.axes}:
        request = m.SetSlew(SESSION, m.Slew((100,) * axes))
        answer = robot.ask(request)
        assert isinstance(answer, m.Nack)
        assert answer.code is m.NackCode.BAD_LENGTH
    robot.done(m.SetSlew(SESSION, m.Slew((100,) * robot.axes)))


def test_range_and_contradiction_are_told_of_the_last_axis(robot: Robot) -> None:
    robot.begin()
    last = robot.axes - 1
    refusals = {
        m.Slew((100,) * last + (9,)): (m.NackCode.OUT_OF_RANGE, 1),
    }
    for slew, expected in refusals.items():
        answer = robot.ask(m.SetSlew(SESSION, slew))
        assert isinstance(answer, m.Nack)
        assert (answer.code, answer.detail) == expected
    upside_down = m.Limits((-10,) * last + (20,), (10,) * robot.axes, (0,) * robot.axes)
    answer = robot.ask(m.SetLimits(SESSION, upside_down))
    assert isinstance(answer, m.Nack)
    assert (answer.code, answer.detail) == (m.NackCode.INCONSISTENT, last)


def test_axes_are_enabled_one_after_another(configured: Robot) -> None:
    configured.done(m.Arm(SESSION))
    counts = []
    while configured.report().state is m.State.ARMING:
        pulses = configured.report().pulse_half_us
        enabled = sum(pulse > 0 for pulse in pulses)
        assert all(pulses[:enabled])
        counts.append(enabled)
        configured.wait_ticks(1)
    steps = [after - before for before, after in pairwise(counts)]
    assert max(steps, default=0) <= 1
    assert set(counts) - {0} == set(range(1, configured.axes + 1))


def test_every_axis_follows_its_own_target_at_its_own_pin(configured: Robot) -> None:
    configured.arm()
    assert configured.pulses() == configured.calibration.neutral_half_us
    target = tuple(90 * (axis + 1) for axis in range(configured.axes))
    reply = configured.ask(m.SetTarget(SESSION, target, 0, 5000))
    assert isinstance(reply, m.TargetReply)
    assert reply.target_cdeg == target
    configured.wait_ticks(4)
    expected = tuple(
        3000 + 20 * axis + (20 if axis % 2 else -20) * (axis + 1) for axis in range(configured.axes)
    )
    assert configured.report().pulse_half_us == configured.pulses() == expected


def test_only_the_axis_beyond_its_limit_is_clamped(configured: Robot) -> None:
    configured.arm()
    target = (0,) * (configured.axes - 1) + (9000,)
    reply = configured.ask(m.SetTarget(SESSION, target, 0, 5000))
    assert isinstance(reply, m.TargetReply)
    assert m.StatusFlags.CLAMPED in reply.flags
    assert reply.target_cdeg == (0,) * (configured.axes - 1) + (8500,)


def test_stop_takes_the_pulses_from_every_pin(configured: Robot) -> None:
    configured.arm()
    configured.done(m.Stop())
    configured.wait_ticks(2)
    assert configured.pulses() == (0,) * configured.axes


def test_the_saved_configuration_of_all_axes_is_in_use_after_a_reset(configured: Robot) -> None:
    configured.done(m.SaveConfig(SESSION))
    configured.wait_ticks(m.eeprom_slot_size(configured.axes) + 2)
    assert not configured.report().flags & m.StatusFlags.EEPROM_BUSY
    configured.device.reset(m.ResetCause.EXTERNAL)
    configured.begin()
    identity = configured.ask(m.Hello(m.PROTOCOL_VERSION, m.SPEC_HASH))
    assert isinstance(identity, m.HelloReply)
    assert identity.eeprom_status is m.EepromStatus.LOADED
    reply = configured.ask(m.GetCalibration())
    assert isinstance(reply, m.CalibrationReply)
    assert reply.calibration == configured.calibration


@pytest.mark.parametrize("request_type", [m.GetCalibration, m.GetCounters, m.GetState])
def test_as_many_requests_as_may_be_outstanding_are_answered(
    configured: Robot, request_type: type[m.Request]
) -> None:
    configured.done(m.SetTelemetry(SESSION, 1))
    frame = encode_frame(request_type.ID, 1, b"")
    for _ in range(10):
        answers = configured.talk.exchange(frame * m.OUTSTANDING_REQUESTS, 3 * m.TICK_US)
        replies = [one for one in answers if one.id == request_type.REPLY_ID]
        assert len(replies) == m.OUTSTANDING_REQUESTS


def test_the_longest_request_and_a_stop_may_be_outstanding(configured: Robot) -> None:
    calibration = m.SetCalibration(SESSION, configured.calibration)
    frames = encode_frame(calibration.ID, 7, calibration.pack()) + encode_frame(m.Stop.ID, 8, b"")
    assert len(frames) <= m.OUTSTANDING_BYTES.of(configured.axes)
    answers = configured.talk.exchange(frames, 2 * m.TICK_US)
    assert [(a.id, a.sequence) for a in answers] == [(m.Ack.ID, 7), (m.Ack.ID, 8)]


FLOODS = {
    "states": "s",
    "counters": "c",
    "targets": "t",
    "targets and states": "tttttts",
    "hellos": "h",
}


@pytest.mark.parametrize("flood", FLOODS.values(), ids=FLOODS.keys())
def test_on_a_line_that_never_pauses_each_request_is_obeyed_and_a_stop_is_answered(
    configured: Robot, flood: str
) -> None:
    configured.done(m.SetAcceleration(SESSION, m.Acceleration((1,) * configured.axes)))
    configured.arm()
    configured.done(m.SetTelemetry(SESSION, 1))
    before = configured.counters()
    target = m.SetTarget(SESSION, (8000,) * configured.axes, 10_000, 10_000)
    requests = {
        "s": m.GetState(),
        "c": m.GetCounters(),
        "t": target,
        "h": m.Hello(m.PROTOCOL_VERSION, m.SPEC_HASH),
    }
    burst = b"".join(encode_frame(r.ID, 1, r.pack()) for r in map(requests.__getitem__, flood))
    flooded = burst * (FLOOD_BYTES // len(burst))
    stop = encode_frame(m.Stop.ID, 99, b"")
    data = flooded + stop + burst * 5
    answers = configured.talk.exchange(data, len(data) * 10_000_000 // m.BAUD + 50_000)
    acks = [m.Ack.unpack(a.payload) for a in answers if (a.id, a.sequence) == (m.Ack.ID, 99)]
    assert acks == [m.Ack(m.Stop.ID, m.State.STOPPED)]
    counters = configured.counters()
    assert counters.overruns == 0
    # The end of the exchange and get_counters itself come on top.
    accepted = counters.frames_accepted - before.frames_accepted
    assert accepted == data.count(0) + 2
    assert counters.targets_accepted - before.targets_accepted == flooded.count(
        encode_frame(target.ID, 1, target.pack())
    )


def test_pulses_are_exact_on_a_saturated_line(configured: Robot) -> None:
    configured.arm()
    rest = configured.calibration.neutral_half_us
    target = m.SetTarget(SESSION, (0,) * configured.axes, 0, 5000)
    frame = encode_frame(target.ID, 1, target.pack())
    for _ in range(20):
        configured.device.send(frame * (m.TICK_US // 40 // len(frame) + 1))
        assert configured.pulses() == rest  # the device refuses jitter
        configured.device.read()
