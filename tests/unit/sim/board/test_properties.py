"""Properties that hold whatever the host sends: the pins stay safe and the board responsive."""

from dataclasses import dataclass
from itertools import pairwise
from math import isqrt

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, initialize, precondition, rule

from ccr_host.link import messages as m
from ccr_host.link.framing import Frame, FrameDecoder, encode_frame
from ccr_host.sim.board.board import UnoEmulator
from ccr_host.sim.board.setpoint import Setpoint

SESSION = 0x5E55
ANY_U16 = st.integers(0, 0xFFFF)
ANY_I16 = st.integers(-0x8000, 0x7FFF)
TARGETED = (m.State.HOLD, m.State.ACTIVE, m.State.RELAXING)
NO_PULSING = (m.State.BOOT, m.State.DISARMED, m.State.FAULT, m.State.STOPPED)

limits_in_use = st.builds(
    lambda a, b, c, d: m.Limits(
        (min(a[0], b[0]) - 1, min(c[0], d[0]) - 1),
        (max(a[0], b[0]) + 1, max(c[0], d[0]) + 1),
        (a[0], d[0]),
    ),
    *(st.tuples(st.integers(-13000, 13000)),) * 4,
)
slews = st.builds(m.Slew, st.tuples(*(st.integers(10, 2000),) * 2))
watchdogs = st.builds(m.Watchdog, st.integers(20, 400), st.integers(10, 500), st.integers(20, 200))


@st.composite
def calibrations(draw):
    axes = []
    for _ in range(2):
        least, neutral, greatest = sorted(
            draw(st.lists(st.integers(1000, 5000), min_size=3, max_size=3, unique=True))
        )
        slope = draw(st.integers(100, 4000)) * draw(st.sampled_from([-1, 1]))
        axes.append((neutral, slope, least, greatest))
    return m.Calibration(*zip(*axes, strict=True))


@dataclass
class Watched:
    """A board whose pins and reports are checked tick by tick."""

    board: UnoEmulator
    calibration: m.Calibration | None = None
    slew: m.Slew | None = None
    limits: m.Limits | None = None

    def __post_init__(self):
        self.decoder = FrameDecoder()
        self.ticks = 0

    def send(self, message_id, sequence, payload):
        self.board.receive(encode_frame(message_id, sequence, payload))
        return self.read()

    def ask(self, request, sequence):
        answers = [
            f for f in self.send(request.ID, sequence, request.pack()) if f.id != m.Telemetry.ID
        ]
        assert [answer.sequence for answer in answers] == [sequence]
        return m.MESSAGES[answers[0].id].unpack(answers[0].payload)

    def read(self):
        self.board.advance_to(self.board.now_us + 15_000)
        frames = self.decoder.feed(self.board.take_output())
        assert all(isinstance(frame, Frame) for frame in frames)
        return frames

    def judge_ticks(self, count):
        """Advance, and check the pins at the start of every frame."""
        before = self.report()
        for _ in range(count):
            self.board.advance_to(self.board.next_frame_us)
            pins = self.board.pulses_half_us
            after = self.report()
            self.judge_pins(pins)
            self.judge_setpoint(after)
            if self.slew and before.tick + 1 == after.tick:
                for axis in (0, 1):
                    step = after.setpoint_cdeg[axis] - before.setpoint_cdeg[axis]
                    assert abs(step) <= self.slew.slew_cdeg_tick[axis]
            before = after

    def judge_pins(self, pins):
        for axis, pulse in enumerate(pins):
            if pulse == 0:
                continue
            assert m.PULSE_FLOOR_HALF_US <= pulse <= m.PULSE_CEILING_HALF_US
            assert self.calibration is not None, "a pulse without a calibration"
            least = self.calibration.pulse_min_half_us[axis]
            greatest = self.calibration.pulse_max_half_us[axis]
            assert least <= pulse <= greatest

    def judge_setpoint(self, report):
        if self.limits is None:
            return
        for axis, angle in enumerate(report.setpoint_cdeg):
            least = self.limits.angle_min_cdeg[axis]
            assert least <= angle <= self.limits.angle_max_cdeg[axis]

    def report(self):
        """The state, without moving time."""
        return self.board.report()


@pytest.mark.long
@settings(max_examples=150)
@given(data=st.lists(st.binary(max_size=80), max_size=20), gap_us=st.integers(0, 50_000))
def test_random_bytes_never_break_the_board_or_move_a_servo(data, gap_us):
    board = UnoEmulator()
    board.advance_to(m.TICK_US)
    decoder = FrameDecoder()
    for chunk in data:
        board.receive(chunk)
        board.advance_to(board.now_us + gap_us)
        assert board.pulses_half_us == (0, 0)
    board.receive(b"\0" + encode_frame(m.GetState.ID, 1, b""))
    board.advance_to(board.now_us + 100_000)
    frames = decoder.feed(board.take_output())
    assert frames[-1].id == m.StateReply.ID


@settings(max_examples=150)
@given(
    frames=st.lists(
        st.tuples(st.sampled_from(sorted(m.MESSAGES)), st.integers(0, 255), st.binary(max_size=48)),
        max_size=30,
    )
)
def test_every_frame_is_answered_once_whatever_it_carries(frames):
    board = UnoEmulator()
    board.advance_to(m.TICK_US)
    decoder = FrameDecoder()
    for message_id, sequence, payload in frames:
        board.receive(encode_frame(message_id, sequence, payload))
        board.advance_to(board.now_us + 10_000)
        (answer,) = decoder.feed(board.take_output())
        assert answer.sequence == sequence
        assert board.pulses_half_us == (0, 0)


@pytest.mark.long
@settings(max_examples=300)
@given(
    start=st.tuples(*(st.integers(-13500, 13500),) * 2),
    target=st.tuples(*(st.integers(-13500, 13500),) * 2),
    ramp_ticks=st.integers(0, 500),
    slew=st.tuples(*(st.integers(1, 2000),) * 2),
    acceleration=st.tuples(*(st.just(0) | st.integers(1, 2000),) * 2),
)
def test_setpoint_goes_monotonically_to_its_target_within_its_limits(
    start, target, ramp_ticks, slew, acceleration
):
    setpoint = Setpoint(start)
    setpoint.aim_at(target, ramp_ticks)
    slowest = max(-(-abs(t - s) // v) for s, t, v in zip(start, target, slew, strict=True))
    for axis, least in enumerate(acceleration):
        if least:
            way = abs(target[axis] - start[axis])
            slowest = max(
                slowest, way // slew[axis] + slew[axis] // least + isqrt(4 * way // least)
            )
    steps = (0, 0)
    for _ in range(ramp_ticks + slowest + 4):
        before, steps_before = setpoint.cdeg, steps
        setpoint.step_along_ramp(slew, acceleration)
        steps = (setpoint.cdeg[0] - before[0], setpoint.cdeg[1] - before[1])
        for axis in (0, 1):
            step = setpoint.cdeg[axis] - before[axis]
            assert abs(step) <= slew[axis]
            assert step * (target[axis] - start[axis]) >= 0
            assert not acceleration[axis] or abs(step - steps_before[axis]) <= acceleration[axis]
    assert setpoint.cdeg == target


class AnyHost(RuleBasedStateMachine):
    """Random well-formed requests, noise, faults, resets, silence."""

    @initialize(data=st.data())
    def power_on(self, data):
        self.watched = Watched(UnoEmulator())
        self.sequence = 0
        self.watched.judge_ticks(m.BOOT_TICKS + 1)
        self.open_session()
        self.configure(data)

    def ask(self, request):
        self.sequence = (self.sequence + 1) % 256
        return self.watched.ask(request, self.sequence)

    def did(self, request):
        return not isinstance(self.ask(request), m.Nack)

    def read_config(self):
        return (
            self.ask(m.GetLimits()).limits,
            self.ask(m.GetSlew()).slew,
            self.ask(m.GetWatchdog()).watchdog,
            self.ask(m.GetCalibration()).calibration,
        )

    def state(self):
        return self.watched.board.state

    @rule()
    def open_session(self):
        self.did(m.OpenSession(m.SPEC_HASH, SESSION))

    @precondition(lambda self: self.state() in NO_PULSING)
    @rule(data=st.data())
    def configure(self, data):
        watched = self.watched
        limits = data.draw(limits_in_use)
        if self.did(m.SetLimits(SESSION, limits)):
            watched.limits = limits
        slew = data.draw(slews)
        if self.did(m.SetSlew(SESSION, slew)):
            watched.slew = slew
        calibration = data.draw(calibrations())
        if self.did(m.SetCalibration(SESSION, calibration)):
            watched.calibration = calibration
        self.did(m.SetWatchdog(SESSION, data.draw(watchdogs)))

    @precondition(lambda self: self.state() in NO_PULSING)
    @rule(patience_ticks=st.sampled_from([3, 10, 3000, 3000]))
    def arm(self, patience_ticks):
        """Wait until the board holds, or not as long; clear any latch."""
        self.open_session()
        self.did(m.ClearFault(SESSION))
        self.did(m.Arm(SESSION))
        for _ in range(patience_ticks):
            self.watched.judge_ticks(1)
            if self.state() is not m.State.ARMING:
                break

    @precondition(lambda self: self.state() in TARGETED)
    @rule(
        angles=st.tuples(*(st.integers(-18000, 18000),) * 2),
        ramp_ms=st.integers(0, 600),
        validity_ms=st.integers(20, 500),
        ticks=st.integers(1, 40),
    )
    def set_target(self, angles, ramp_ms, validity_ms, ticks):
        self.did(m.SetTarget(SESSION, angles, ramp_ms, validity_ms))
        self.watched.judge_ticks(ticks)

    @precondition(lambda self: self.state() in TARGETED)
    @rule(
        stream=st.lists(
            st.tuples(*(st.integers(-18000, 18000),) * 2, st.sampled_from([0, 0, 30, 300])),
            min_size=1,
            max_size=10,
        )
    )
    def stream_of_targets(self, stream):
        for first, second, ramp_ms in stream:
            self.did(m.SetTarget(SESSION, (first, second), ramp_ms, 40))
            self.watched.judge_ticks(2)

    @precondition(lambda self: self.state() is not m.State.DISARMED)
    @rule(
        kind=st.sampled_from([m.Disarm, m.ClearFault, m.SaveConfig]),
        session=st.sampled_from([SESSION, SESSION + 1]),
    )
    def session_request(self, kind, session):
        self.did(kind(session))

    @rule()
    def stop(self):
        assert self.did(m.Stop())
        self.watched.board.advance_to(self.watched.board.next_frame_us)
        self.watched.judge_ticks(1)
        assert self.watched.board.pulses_half_us == (0, 0)

    @rule(noise=st.binary(max_size=60))
    def noise(self, noise):
        self.watched.board.receive(noise + b"\0")
        self.watched.read()

    @rule(
        message_id=st.sampled_from(sorted(m.REQUESTS)),
        session=st.sampled_from([SESSION, 0]),
        rest=st.lists(st.one_of(ANY_U16, ANY_I16.map(lambda v: v % 65536)), max_size=20),
    )
    def any_payload(self, message_id, session, rest):
        """A request of the right length and session, with arbitrary values."""
        if message_id in (m.OpenSession.ID, *CONFIGURING):
            return
        words = [session, *rest, *[0] * 24]
        payload = b"".join(word.to_bytes(2, "little") for word in words)
        self.watched.send(message_id, 3, payload[: m.REQUESTS[message_id].size(2)])

    @rule(fault=st.sampled_from([f for f in m.Fault if f]))
    def fault(self, fault):
        self.watched.board.inject_fault(fault)
        self.watched.judge_ticks(1)

    @rule(cause=st.sampled_from(m.ResetCause))
    def reset(self, cause):
        board = self.watched.board
        board.reset(cause)
        assert board.pulses_half_us == (0, 0)
        board.advance_to(board.now_us + m.LISTENS_AFTER_US)
        self.watched.limits, self.watched.slew, _, self.watched.calibration = self.read_config()
        self.watched.judge_ticks(m.BOOT_TICKS + 2)
        assert self.watched.board.pulses_half_us == (0, 0)

    @rule()
    def silence(self):
        """After hold and the way to rest, the pulses are at rest and then gone."""
        watched = self.watched
        if not watched.report().flags & m.StatusFlags.CONFIGURED:
            return
        limits, slew, watchdog, _ = self.read_config()
        way_ticks = max(
            (limits.angle_max_cdeg[axis] - limits.angle_min_cdeg[axis])
            // min(slew.slew_cdeg_tick[axis], watchdog.relax_slew_cdeg_tick)
            + 2
            for axis in (0, 1)
        )
        longest_validity_ticks = 500
        arming_ticks = 2 * -(-watchdog.arm_axis_ms // 20) + way_ticks
        hold_ticks = -(-watchdog.relax_after_ms // 20)
        bound = max(longest_validity_ticks, arming_ticks) + hold_ticks + way_ticks + 2
        last_pins, at_rest_pins = (0, 0), None
        for _ in range(bound):
            watched.board.advance_to(watched.board.next_frame_us)
            if watched.board.pulses_half_us != (0, 0):
                last_pins = watched.board.pulses_half_us
                at_rest_pins = watched.report().setpoint_cdeg
        assert watched.board.pulses_half_us == (0, 0)
        if last_pins[1]:
            assert at_rest_pins == limits.rest_cdeg
        assert watched.board.state in NO_PULSING


CONFIGURING = (m.SetLimits.ID, m.SetSlew.ID, m.SetWatchdog.ID, m.SetCalibration.ID)

TestAnyHost = pytest.mark.long(AnyHost.TestCase)
TestAnyHost.settings = settings(
    max_examples=100,
    stateful_step_count=25,
    deadline=None,
    suppress_health_check=[HealthCheck.too_slow],
)


@pytest.mark.requirement("REQ-3")
@settings(max_examples=60, deadline=None)
@given(
    requests=st.lists(
        st.sampled_from([m.Arm(SESSION), m.Disarm(SESSION), m.SetTelemetry(SESSION, 0)]), max_size=8
    ),
    repeats=st.integers(2, 4),
)
def test_repeating_every_request_changes_nothing(requests, repeats):
    outcomes = []
    for times in (1, repeats):
        watched = Watched(UnoEmulator())
        watched.board.advance_to(200_000)
        watched.ask(m.OpenSession(m.SPEC_HASH, SESSION), 0)
        watched.ask(m.SetLimits(SESSION, m.Limits((-10, -10), (10, 10), (0, 0))), 1)
        watched.ask(m.SetSlew(SESSION, m.Slew((10, 10))), 2)
        watched.ask(m.SetWatchdog(SESSION, m.Watchdog(100, 10, 20)), 3)
        calibration = m.Calibration((3000, 3000), (900, 900), (1000, 1000), (5000, 5000))
        watched.ask(m.SetCalibration(SESSION, calibration), 4)
        states = []
        for sequence, request in enumerate(requests, start=5):
            frame = encode_frame(request.ID, sequence, request.pack())
            watched.board.receive(frame * times)
            answers = watched.read()
            assert answers == answers[:1] * times
            watched.board.advance_to(watched.board.now_us + 100_000)
            states.append((answers[0], watched.board.state))
        outcomes.append(states)
    assert outcomes[0] == outcomes[1]


QUICK_SLEW = m.Slew((500, 300))
LEGAL = [
    m.Stop(),
    m.ClearFault(SESSION),
    m.Arm(SESSION),
    m.Disarm(SESSION),
    m.SetTarget(SESSION, (8000, -6000), 0, 200),
    m.SetTarget(SESSION, (-8000, 6000), 100, 60),
    m.SetLimits(SESSION, m.Limits((-9000, -9000), (9000, 9000), (0, 0))),
    m.SetLimits(SESSION, m.Limits((-9000, -9000), (-1000, -1000), (-2000, -2000))),
    m.SetCalibration(
        SESSION, m.Calibration((3000, 3000), (2000, -2000), (1000, 1000), (5000, 5000))
    ),
    m.SetCalibration(
        SESSION, m.Calibration((2400, 3600), (-2000, 2000), (1000, 1000), (5000, 5000))
    ),
]


@pytest.mark.long
@pytest.mark.requirement("FLT-4", "TGT-3")
@settings(max_examples=150, deadline=None)
@given(
    talk=st.lists(
        st.tuples(
            st.lists(st.sampled_from(LEGAL), min_size=1, max_size=5)
            | st.sampled_from(LEGAL[6:]).map(
                lambda change: [m.Stop(), change, m.ClearFault(SESSION), m.Arm(SESSION)]
            ),
            st.sampled_from([0, 0, 1_000, 20_000, 100_000]),
        ),
        max_size=30,
    )
)
def test_pulses_further_apart_than_the_slew_limit_have_a_frame_without_between_them(talk):
    watched = Watched(UnoEmulator())
    board = watched.board
    board.advance_to(m.BOOT_TICKS * m.TICK_US + 2 * m.TICK_US)
    watched.ask(m.OpenSession(m.SPEC_HASH, SESSION), 0)
    watched.ask(m.SetSlew(SESSION, QUICK_SLEW), 1)
    watched.ask(m.SetWatchdog(SESSION, m.Watchdog(100, 100, 20)), 2)
    for number in (6, 8):
        watched.ask(LEGAL[number], number)
    pins = [(0, 0)]
    sequence = 0
    for burst, gap_us in [([m.Arm(SESSION)], 100_000), *talk, ([], 100_000)]:
        for request in burst:
            sequence = (sequence + 1) % 256
            board.receive(encode_frame(request.ID, sequence, request.pack()))
        until_us = board.now_us + 3_000 + gap_us
        while board.next_frame_us <= until_us:
            board.advance_to(board.next_frame_us)
            pins.append(board.pulses_half_us)
        board.advance_to(until_us)
    for before, after in pairwise(pins):
        for axis, most_cdeg in enumerate(QUICK_SLEW.slew_cdeg_tick):
            if before[axis] and after[axis]:
                assert abs(after[axis] - before[axis]) <= most_cdeg * 2000 / 9000 + 1
