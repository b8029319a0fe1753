"""The client against an emulated board in virtual time."""

from dataclasses import replace

import numpy as np
import pytest

from ccr_host.core.clock import NEVER_US
from ccr_host.core.errors import DeviceError
from ccr_host.link import messages as m
from ccr_host.link.board import BOOT_TIMEOUT_US
from ccr_host.link.device_errors import (
    BoardFaultError,
    BoardResetError,
    BoardSilentError,
    BoardStoppedError,
    LinkLossError,
    RequestRefusedError,
    SessionTakenError,
    SpecMismatchError,
)
from ccr_host.link.framing import FrameDecoder, encode_frame
from ccr_host.link.messages import State
from tests.faulty_line import LineNoise

PERIOD_US = 100_000
VALIDITY_MS = 300


def drive(rig, client, steps=10):
    """Some control steps; the last accepted target is exact to the wire's resolution."""
    for step in range(steps):
        q = (0.3 * np.sin(step), 0.2 * np.cos(step))
        client.set_target(q, ramp_ms=0, validity_ms=VALIDITY_MS)
        rig.wait(PERIOD_US)
    client.poll()
    return q


def armed(rig, config, **observers):
    client = rig.client(**observers)
    client.connect()
    client.configure(config)
    client.arm()
    return client


def test_run_from_connect_to_disarm(rig, config):
    with armed(rig, config) as client:
        assert rig.board.state is State.HOLD
        assert client.accepted_rad.tolist() == [0, 0]
        q = drive(rig, client)
        assert client.accepted_rad == pytest.approx(q, abs=np.radians(0.005))
        assert rig.board.state is State.ACTIVE
        assert client.telemetry.report.state is State.ACTIVE
        assert client.telemetry_age_us() <= 2 * m.TICK_US
    assert rig.board.state is State.DISARMED
    statistics = client.statistics
    assert statistics.crc_errors == statistics.retries == statistics.unanswered_targets == 0
    assert statistics.lost_telemetry == 0
    assert 1_000 < statistics.rtt_us_median <= statistics.rtt_us_p99 < 5_000


def test_connect_waits_for_the_boot_loader_without_a_fixed_sleep(rig):
    rig.line.open_port(boot_loader_us=1_500_000)
    with rig.client() as client:
        identity = client.connect()
        assert 1_500_000 + m.BOOT_TICKS * m.TICK_US < rig.clock.now_us() < 2_000_000
    assert identity.boot_id == 2
    assert identity.reset_cause is m.ResetCause.EXTERNAL


def test_silent_board_is_reported_within_the_boot_timeout(rig):
    rig.line.open_port(boot_loader_us=10**9)
    with pytest.raises(BoardSilentError, match="no answer to hello"), rig.client() as client:
        client.connect()
    assert rig.clock.now_us() < BOOT_TIMEOUT_US + 1_000_000


def test_board_of_another_spec_is_named_and_can_still_be_read_and_stopped(make_rig):
    rig = make_rig(spec_hash=0xDEADBEEF)
    rig.wait(200_000)
    with rig.client() as client:
        with pytest.raises(SpecMismatchError, match="spec deadbeef") as mismatch:
            client.connect()
        assert f"{m.SPEC_HASH:08x}" in mismatch.value.cause
        assert client.read_state().state is State.DISARMED
        client.stop()
        assert client.read_state().state is State.STOPPED


def test_configure_sets_only_what_differs(rig, config):
    sent = []
    with rig.client(on_frame=lambda way, _, data: sent.append((way, data))) as client:
        client.connect()
        client.configure(config)
        sent.clear()
        changed = replace(config, slew=m.Slew((100, 100)))
        client.configure(changed)
        setters = [frame.id for frame in _frames(sent, "sent") if frame.id & 1 and frame.id >= 0x30]
        assert setters == [m.SetSlew.ID]
        assert client.read_config() == changed


def test_a_board_with_fewer_axes_than_motors_is_refused_before_anything_is_set(make_rig, config):
    rig = make_rig(axes=1)
    with rig.client() as client:
        assert client.connect().axes == 1
        with pytest.raises(DeviceError, match=r"drives 1 servo, .* 2 motors .*--board mega2560"):
            client.configure(config)
        assert client.read_config().slew.slew_cdeg_tick == (0,)


@pytest.mark.parametrize("axes", [3, 6, 12])
def test_axes_without_a_motor_stay_at_rest_and_are_not_seen_above_the_client(
    make_rig, config, axes
):
    rest_cdeg = config.limits.rest_cdeg[1]
    rig = make_rig(axes=axes)
    seen = []
    with rig.client(on_telemetry=lambda report, _: seen.append(report)) as client:
        client.connect()
        client.configure(config)
        assert client.read_config() == config.for_board(axes)
        seen.clear()
        client.arm()
        assert client.accepted_rad.shape == (2,)
        client.set_target((0.2, -0.3), ramp_ms=0, validity_ms=VALIDITY_MS)
        rig.wait(PERIOD_US)
        client.poll()
        assert client.accepted_rad == pytest.approx((0.2, -0.3), abs=1e-4)
        report = rig.board.report()
        assert report.target_cdeg[2:] == (rest_cdeg,) * (axes - 2)
        assert all(len(one.setpoint_cdeg) == 2 for one in (client.read_state(), *seen))
        assert client.telemetry.report.target_cdeg == report.target_cdeg[:2]
        assert client.statistics.clamped_targets == 0


def test_saved_configuration_survives_a_reset(rig, config):
    with rig.client() as client:
        client.connect()
        client.configure(config)
        client.save_config()
        rig.board.reset(m.ResetCause.POWER_ON)
        assert client.read_config() == config


def test_angles_are_clamped_by_the_board_and_told(rig, config):
    with armed(rig, config) as client:
        client.set_target((9.0, -9.0), ramp_ms=0, validity_ms=VALIDITY_MS)
        rig.wait(PERIOD_US)
        assert client.accepted_rad == pytest.approx(np.radians([85, -85]))


@pytest.mark.parametrize(
    "arguments",
    [
        {"q_rad": (np.nan, 0), "ramp_ms": 0, "validity_ms": 100},
        {"q_rad": (0, 0), "ramp_ms": 10_001, "validity_ms": 100},
        {"q_rad": (0, 0), "ramp_ms": 0, "validity_ms": 10},
        {"q_rad": (0, 0), "ramp_ms": -1, "validity_ms": 100},
    ],
)
def test_target_that_the_wire_cannot_carry_is_not_sent(rig, config, arguments):
    with armed(rig, config) as client:
        sent = client.statistics.sent
        with pytest.raises(ValueError, match=r"cannot be sent|out of range"):
            client.set_target(arguments.pop("q_rad"), **arguments)
        assert client.statistics.sent == sent


def test_arm_without_configuration_says_what_is_missing(rig):
    with rig.client() as client:
        client.connect()
        with pytest.raises(
            RequestRefusedError, match="limits, slew, watchdog, calibration missing"
        ):
            client.arm()


# Faults


def test_link_loss_is_reported_with_its_cure(rig, config):
    with pytest.raises(LinkLossError, match="to rest") as loss, armed(rig, config) as client:
        drive(rig, client)
        rig.wait(10_000_000)
    assert "the host stalled" in loss.value.cause
    assert "then clear that" in loss.value.cure


def test_latched_fault_is_not_cleared_by_arming(rig, config):
    with rig.client() as client:
        client.connect()
        client.configure(config)
        rig.board.inject_fault(m.Fault.STACK_LOW)
        with pytest.raises(BoardFaultError, match="stack low"):
            client.arm()
        client.clear_fault()
        client.arm()


@pytest.mark.parametrize("boot_loader_us", [0, 1_000_000])
def test_reset_in_mid_run_is_told_with_its_cause(rig, config, boot_loader_us):
    with pytest.raises(BoardResetError) as reset, armed(rig, config) as client:
        drive(rig, client, 3)
        rig.board.reset(m.ResetCause.BROWN_OUT, boot_loader_us)
        drive(rig, client, 30)
    assert reset.value.reset_cause is m.ResetCause.BROWN_OUT
    assert rig.board.pulses_half_us == (0, 0)


def test_second_host_takes_over_and_is_not_disturbed_by_the_first_one_leaving(rig, config):
    with pytest.raises(SessionTakenError), armed(rig, config) as first:
        drive(rig, first, 3)
        takeover = m.OpenSession(m.SPEC_HASH, first._session ^ 1)
        rig.line.write(encode_frame(takeover.ID, 0, takeover.pack()))
        drive(rig, first, 30)
    assert rig.board.state in (State.ACTIVE, State.HOLD)


def test_stop_by_somebody_else_ends_the_run(rig, config):
    with pytest.raises(BoardStoppedError), armed(rig, config) as client:
        drive(rig, client, 3)
        rig.line.write(encode_frame(m.Stop.ID, 0, b""))
        drive(rig, client, 3)
    assert rig.board.state is State.STOPPED


def test_dead_port_in_mid_run_is_one_clear_error(rig, config):
    with pytest.raises(DeviceError, match="the port is gone"), armed(rig, config) as client:
        drive(rig, client, 3)
        rig.line.unplug()
        drive(rig, client, 3)


def test_board_that_falls_silent_in_mid_run(rig, config):
    with pytest.raises(BoardSilentError) as silent, armed(rig, config) as client:
        drive(rig, client, 3)
        rig.line.noise = LineNoise(np.random.default_rng(1), drop=1.0)
        drive(rig, client, 30)
    assert "has fallen silent" in silent.value.cause
    assert "power" in silent.value.cure
    assert "cable" in silent.value.cure
    assert "flashed" not in str(silent.value), "it has answered before"
    assert "no answer to stop" in "".join(silent.value.__notes__)
    rig.line.advance_to(rig.clock.now_us() + 10_000_000)
    assert rig.board.state is State.FAULT  # the board has helped itself
    assert rig.board.pulses_half_us == (0, 0)


def test_a_silent_board_is_looked_for_after_a_second_whatever_is_sent_to_it(rig, config):
    client = armed(rig, config)
    drive(rig, client, 3)
    rig.line.noise = LineNoise(np.random.default_rng(1), drop=1.0)
    since_us = rig.clock.now_us()
    with pytest.raises(BoardSilentError):
        drive(rig, client, 100)
    silent_us = rig.clock.now_us() - since_us - BOOT_TIMEOUT_US
    assert 1_000_000 <= silent_us <= 1_000_000 + 2 * PERIOD_US


def test_targets_that_do_not_arrive_are_the_links_fault_and_end_the_run(rig, config, monkeypatch):
    with pytest.raises(LinkLossError) as loss, armed(rig, config) as client:
        drive(rig, client, 3)
        whole = rig.line.write
        monkeypatch.setattr(rig.line, "write", lambda data: None if len(data) > 12 else whole(data))
        drive(rig, client, 40)
    assert "did not reach the board; the board has begun to lead the robot to rest" in str(
        loss.value
    )
    assert "host stalled" not in str(loss.value)
    assert rig.board.state is State.DISARMED


@pytest.mark.parametrize("silent_s", [2.7, 4.9])
def test_a_link_that_was_silent_for_a_while_is_not_taken_for_a_stalled_host(rig, config, silent_s):
    with pytest.raises(LinkLossError) as loss, armed(rig, config) as client:
        for step in range(100):
            if step == 3:
                rig.line.noise = LineNoise(np.random.default_rng(1), drop=1.0)
                deaf_until_us = rig.clock.now_us() + int(silent_s * 1e6)
                rig.clock.attach(Hearing(rig.line, deaf_until_us))
            drive(rig, client, 1)
    assert "did not reach the board" in str(loss.value)


class Hearing:
    """Ends the noise of a line at a time, whoever waits then."""

    def __init__(self, line, time_us) -> None:
        self.line = line
        self.time_us = time_us

    def advance_to(self, time_us: int) -> None:
        if time_us >= self.time_us:
            self.line.noise = None


@pytest.mark.parametrize(("stalled_s", "still_follows"), [(0.35, True), (0.6, True), (0.8, False)])
def test_a_host_that_was_away_goes_on_only_if_the_board_has_not_begun_to_relax(
    rig, config, stalled_s, still_follows
):
    client = armed(rig, config)
    drive(rig, client, 3)
    rig.wait(int(stalled_s * 1e6))
    if still_follows:
        drive(rig, client, 3)
        client.disarm()
        client._leave()
        assert client.statistics.holds == 1
        assert client.statistics.relaxes == 0
    else:
        with pytest.raises(LinkLossError, match="the host stalled"):
            drive(rig, client, 3)
        client._leave()
        assert client.statistics.relaxes == 1
    assert rig.board.state is State.DISARMED


def test_a_target_that_came_too_late_does_not_hide_that_the_host_stalled(rig, config, monkeypatch):
    with pytest.raises(LinkLossError) as loss, armed(rig, config) as client:
        drive(rig, client, 3)
        rig.wait(650_000)
        whole = rig.line.write
        monkeypatch.setattr(rig.line, "write", lambda data: None if len(data) > 12 else whole(data))
        drive(rig, client, 3)
    assert "the host stalled and sent no target for 0.8 s" in loss.value.cause


def test_a_stalled_host_cannot_end_its_run_as_if_nothing_had_been(rig, config):
    with pytest.raises(LinkLossError, match="the host stalled"), armed(rig, config) as client:
        drive(rig, client, 3)
        rig.wait(800_000)
        client.disarm()


# Noise


@pytest.mark.long
@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize("kind", ["drop", "duplicate", "flip"])
def test_noisy_line_costs_retries_but_no_run(rig, config, kind, seed):
    client = rig.client()
    with client:
        client.connect()
        rig.line.noise = LineNoise(np.random.default_rng(seed), **{kind: 0.004})
        client.configure(config)
        client.arm()
        drive(rig, client, 30)
        client.disarm()
        rig.line.noise = None
    assert rig.board.state is State.DISARMED
    statistics = client.statistics
    board = rig.board.report().link_errors
    assert statistics.crc_errors > 0
    assert statistics.crc_errors >= board


def test_client_asks_for_every_slice_of_time_while_a_target_is_unanswered(rig, config):
    with armed(rig, config) as client:
        assert client.next_turn_us == NEVER_US
        client.set_target((0.1, 0.1), ramp_ms=0, validity_ms=VALIDITY_MS)
        assert client.next_turn_us <= rig.clock.now_us()
        rig.wait(10_000)
        assert client.next_turn_us == NEVER_US


def test_client_asks_for_every_slice_of_time_while_a_latch_is_to_be_raised(rig, config):
    with pytest.raises(BoardFaultError), armed(rig, config) as client:
        rig.board.inject_fault(m.Fault.STACK_LOW)
        with pytest.raises(BoardFaultError):
            rig.wait(100_000)
        assert client.next_turn_us <= rig.clock.now_us()
        rig.wait(1000)


def test_lost_target_is_counted_and_not_sent_again(rig, config):
    with armed(rig, config) as client:
        drive(rig, client, 3)
        rig.line.noise = LineNoise(np.random.default_rng(1), drop=1.0)
        client.set_target((0.1, 0.1), ramp_ms=0, validity_ms=VALIDITY_MS)
        rig.wait(50_000)
        rig.line.noise = None
        rig.wait(100_000)
        client.poll()
        assert client.accepted_rad != pytest.approx([0.1, 0.1])
        assert client.statistics.unanswered_targets == 1
        assert client.statistics.lost_telemetry > 0
        drive(rig, client, 300)
        assert client.statistics.unanswered_targets == 1, "though its number is used again"


@pytest.mark.parametrize("attach", [True, False])
def test_a_request_takes_no_longer_than_its_answer(rig, attach):
    client = rig.client(attach=attach)
    client.connect()
    before_us = rig.clock.now_us()
    client.read_state()
    assert rig.clock.now_us() - before_us < 5_000
    assert client.statistics.rtt_us_p99 < 5_000


def test_a_round_trip_that_nobody_watched_is_not_counted(rig, config):
    client = rig.client(attach=False)
    client.connect()
    client.configure(config)
    client.arm()
    drive(rig, client, 20)
    assert client.statistics.unanswered_targets == 0
    assert client.statistics.rtt_us_p99 < 5_000, "answers waited for 100 ms in the port"


def test_request_whose_answer_was_lost_is_executed_once(rig, config):
    """The board is deaf on the way back only: it arms at once, and tells it on repetition."""
    with rig.client() as client:
        client.connect()
        client.configure(config)
        client.start_telemetry(0)
        answers = LosingAnswers(rig.line, 2)
        client._exchange._transport = answers
        client.arm()
        assert answers.lost == 2
        assert client.statistics.retries == 2
        assert rig.board.state is State.HOLD


class LosingAnswers:
    """A transport that loses the first answers to `arm`."""

    def __init__(self, transport, count):
        self._transport = transport
        self._count = count
        self._unread = b""
        self.lost = 0
        self.name = transport.name

    def write(self, data):
        self._transport.write(data)

    def read(self):
        *whole, self._unread = (self._unread + self._transport.read()).split(b"\0")
        return b"".join(frame + b"\0" for frame in whole if not self._loses(frame + b"\0"))

    def _loses(self, data):
        (frame,) = FrameDecoder().feed(data)
        is_answer = frame.id == m.Ack.ID and frame.payload[0] == m.Arm.ID
        if is_answer and self.lost < self._count:
            self.lost += 1
            return True
        return False

    def close(self):
        self._transport.close()


# Leaving


class BoomError(Exception):
    pass


@pytest.mark.parametrize("error", [BoomError, KeyboardInterrupt, SystemExit])
@pytest.mark.parametrize("when", ["holding", "driving", "relaxing"])
def test_whatever_ends_the_run_leaves_the_robot_at_rest_and_disarmed(rig, config, error, when):
    with pytest.raises(error), armed(rig, config) as client:
        if when != "holding":
            drive(rig, client)
        if when == "relaxing":
            rig.wait(700_000)
            assert rig.board.state is State.RELAXING
        raise error
    report = rig.board.report()
    assert (report.state, report.setpoint_cdeg) == (State.DISARMED, (0, 0))
    assert rig.board.pulses_half_us == (0, 0)


@pytest.mark.parametrize("interrupt_us", [150_000, 165_000, 200_000, 240_000])
def test_ctrl_c_while_connecting_configuring_or_arming(rig, config, at, interrupt_us):
    def interrupt():
        raise KeyboardInterrupt

    rig.clock.attach(at(interrupt_us, interrupt))
    with pytest.raises(KeyboardInterrupt), rig.client() as client:
        client.connect()
        client.configure(config)
        client.arm()
        raise AssertionError("too late")
    rig.line.advance_to(rig.clock.now_us() + 100_000)
    assert rig.board.state is State.DISARMED


def test_second_ctrl_c_stops_at_once(rig, config, at):
    def interrupt():
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt), armed(rig, config) as client:
        client.set_target((1.4, 1.4), ramp_ms=0, validity_ms=2000)
        rig.wait(1_000_000)
        rig.clock.attach(at(rig.clock.now_us() + 200_000, interrupt))
        first_us = rig.clock.now_us()
        raise KeyboardInterrupt
    assert rig.clock.now_us() - first_us < 250_000
    assert rig.board.state is State.STOPPED


def test_leaving_without_arming_sends_nothing_that_moves(rig, config):
    sent = []
    with rig.client(on_frame=lambda way, _, data: sent.append((way, data))) as client:
        client.connect()
        client.configure(config)
    ids = {frame.id for frame in _frames(sent, "sent")}
    assert not ids & {m.Arm.ID, m.Disarm.ID, m.Stop.ID}


def test_board_found_armed_is_disarmed_before_it_is_configured(rig, config):
    crashed = armed(rig, config, attach=False)
    crashed.set_target((0.5, 0.5), ramp_ms=0, validity_ms=10_000)
    rig.wait(500_000)
    with rig.client(session=2) as client:
        client.connect()
        assert client.read_state().state is State.ACTIVE
        client.configure(replace(config, slew=m.Slew((100, 100))))
        assert rig.board.state is State.DISARMED
        client.arm()


def test_original_error_is_kept_when_the_robot_cannot_be_made_safe(rig, config):
    with pytest.raises(BoomError) as boom, armed(rig, config):
        rig.line.unplug()
        raise BoomError
    assert "the port is gone" in boom.value.__notes__[0]


def test_failure_to_make_safe_is_raised_where_nothing_else_was(rig, config):
    with pytest.raises(DeviceError, match="the port is gone"), armed(rig, config):
        rig.line.unplug()


# Observation


def test_frames_are_shown_both_ways_in_order_of_time(rig, config):
    seen = []
    with armed(rig, config, on_frame=lambda *frame: seen.append(frame)) as client:
        drive(rig, client, 3)
    assert [time_us for _, time_us, _ in seen] == sorted(time_us for _, time_us, _ in seen)
    assert len(_frames([(w, d) for w, _, d in seen], "sent")) == client.statistics.sent
    assert len(_frames([(w, d) for w, _, d in seen], "received")) == client.statistics.received


def test_every_report_of_the_stream_is_shown(rig, config):
    ticks = []
    with armed(rig, config, on_telemetry=lambda report, _: ticks.append(report.tick)) as client:
        drive(rig, client, 5)
    assert ticks == list(range(ticks[0], ticks[-1] + 1))


def test_clock_offset_is_found_within_its_uncertainty(make_rig):
    rig = make_rig(board_time_at_reset_us=2**32 - 1_000_000)
    with rig.client() as client:
        client.connect()
        rig.wait(5_000_000)
        client.sync_clock(8)
        now_us = rig.clock.now_us()
        error_us = client.board_clock.offset_us(now_us) - (2**32 - 1_000_000)
        assert abs(error_us) <= client.board_clock.uncertainty_us(now_us) < 1_000


def test_same_seed_gives_the_same_bytes(make_rig, config):
    logs = []
    for _ in range(2):
        rig = make_rig()
        rig.line.noise = LineNoise(np.random.default_rng(3), drop=0.002, flip=0.002)
        log = []
        with armed(rig, config, on_frame=lambda *frame, log=log: log.append(frame)) as client:
            drive(rig, client)
        logs.append(log)
    assert logs[0] == logs[1]


def _frames(seen, way):
    return [
        frame for seen_way, data in seen if seen_way == way for frame in FrameDecoder().feed(data)
    ]


def test_polling_a_board_that_still_starts_is_no_retry(rig):
    rig.line.open_port(boot_loader_us=1_000_000)
    with rig.client() as client:
        client.connect()
        assert rig.clock.now_us() > 1_000_000
        assert client.statistics.retries == 0
        assert client.statistics.crc_errors == 0


def test_a_stop_can_be_cleared_at_once(rig, config):
    with armed(rig, config) as client:
        client.stop()
        client.clear_fault()
        assert rig.board.state is State.DISARMED
        assert rig.board.pulses_half_us == (0, 0)


def test_a_stop_is_not_swallowed_by_a_torn_frame(rig, config):
    with armed(rig, config) as client:
        rig.line.write(encode_frame(m.Hello.ID, 1, bytes(5))[:4])
        client.stop()
        assert client.statistics.retries == 0
        assert rig.board.state is State.STOPPED
