"""TIM and ARM."""

import pytest

from ccr_host.link import messages as m
from ccr_host.link.framing import encode_frame
from tests.conformance.host import AXIS_TICKS

SESSION = 0x5E55
PHYSICAL_CAUSES = [cause for cause in m.ResetCause if cause is not m.ResetCause.UNKNOWN]
NEUTRAL = (3000, 3100)
CLOCK_ERROR = 0.01
"""Tolerance of an UNO's ceramic resonator: 0.5 % initially, 0.3 % with temperature, plus ageing."""


def ticks_run_at(board_time_us):
    """Number of ticks run within that time after a reset."""
    return max(0, (board_time_us - m.TICK_PHASE_US) // m.TICK_US + 1)


@pytest.mark.requirement("TIM-1")
def test_ticks_run_at_their_phase_by_the_clock_of_the_board(started):
    started.boot()
    sync = encode_frame(m.ClockSync.ID, 1, m.ClockSync(0).pack())
    between_two_looks_at_the_clock = sync + encode_frame(m.GetState.ID, 2, b"") + sync
    for n in range(100):
        started.listen(n * 37 % 20 * 1000)  # so that they come at all phases
        answers = started.talk.ask_frames(between_two_looks_at_the_clock, 3)
        before, after = (m.ClockReply.unpack(answers[i].payload).board_time_us for i in (0, 2))
        report = m.StateReply.unpack(answers[1].payload).report
        assert ticks_run_at(before) <= report.tick <= ticks_run_at(after)


@pytest.mark.requirement("TIM-1")
def test_clock_of_the_board_keeps_time(listening):
    device = listening.device
    looks = []
    for _ in range(2):
        sent_us = device.since_reset_us()
        board_us = listening.told(m.ClockSync(0), m.ClockReply).board_time_us
        looks.append((board_us, sent_us, device.since_reset_us()))
        listening.listen(3_000_000)
    (board_1, sent_1, read_1), (board_2, sent_2, read_2) = looks
    passed_us = board_2 - board_1
    assert (sent_2 - read_1) * (1 - CLOCK_ERROR) <= passed_us
    assert passed_us <= (read_2 - sent_1) * (1 + CLOCK_ERROR)


@pytest.mark.requirement("TIM-1")
@pytest.mark.parametrize("tick", [0, 1, 49])
@pytest.mark.in_step("the moment of the reset cannot be seen on a port")
def test_tick_runs_at_its_phase(make_host, tick):
    host = make_host()
    request_us = 2_000  # longer than a get_state needs to its dispatch
    host.device.advance_to(m.TICK_PHASE_US + tick * m.TICK_US - request_us)
    assert host.report().tick == tick
    host.device.advance_to(m.TICK_PHASE_US + tick * m.TICK_US)
    assert host.report().tick == tick + 1


@pytest.mark.requirement("TIM-2")
@pytest.mark.in_step("pins are seen in simulators only")
def test_pulses_of_a_tick_are_on_the_pins_from_the_next_frame_on(armed):
    armed.target(600)
    tick = armed.next_tick()
    assert armed.device.pulses_in_frame(tick) == NEUTRAL
    assert armed.device.pulses_in_frame(tick + 1) == (3000 + 133, 3100)
    assert armed.device.pulses_in_frame(tick + 2) == (3000 + 133, 3100)


@pytest.mark.requirement("TIM-3")
def test_boot_lasts_its_ticks(in_boot):
    report = in_boot.report()
    while report.state is m.State.BOOT:
        assert report.tick <= m.BOOT_TICKS
        report = in_boot.report()
    assert report.state is m.State.DISARMED
    assert report.tick > m.BOOT_TICKS


@pytest.mark.requirement("TIM-3", "WDG-1")
@pytest.mark.parametrize(("validity_ms", "ticks"), [(20, 1), (21, 2), (40, 2), (41, 3), (1000, 50)])
def test_target_runs_out_after_its_ticks_and_not_before(armed, validity_ms, ticks):
    armed.target(100, validity_ms=validity_ms)
    tick = armed.next_tick()
    if ticks > 1:
        assert armed.report_of_tick(tick + ticks - 1).state is m.State.ACTIVE
    assert armed.report_of_tick(tick + ticks).state is m.State.HOLD


@pytest.mark.requirement("TIM-4")
def test_transition_comes_before_the_move_of_the_same_tick(armed):
    armed.target(5000, validity_ms=20)
    tick = armed.next_tick()
    moved = armed.report_of_tick(tick).setpoint_cdeg
    held = armed.report_of_tick(tick + 1)
    assert moved == (600, 0)
    assert (held.state, held.setpoint_cdeg) == (m.State.HOLD, moved)


@pytest.mark.requirement("TIM-4")
def test_one_tick_makes_one_transition(armed):
    tick = armed.wait_for(m.State.RELAXING)  # already at rest
    assert armed.report_of_tick(tick + 1).state is m.State.FAULT


@pytest.mark.requirement("ARM-1")
def test_axes_are_enabled_one_after_the_other(host):
    host.wait_ticks(1)
    host.done(m.Arm(SESSION))
    tick = host.next_tick()
    assert host.pulses_of_tick(tick - 1) == (0, 0)
    assert host.pulses_of_tick(tick) == (NEUTRAL[0], 0)
    assert host.pulses_of_tick(tick + AXIS_TICKS - 1) == (NEUTRAL[0], 0)
    assert host.pulses_of_tick(tick + AXIS_TICKS) == NEUTRAL
    assert host.report_of_tick(tick + 2 * AXIS_TICKS - 1).state is m.State.ARMING
    assert host.report_of_tick(tick + 2 * AXIS_TICKS).state is m.State.HOLD


@pytest.mark.requirement("ARM-1", "ARM-3")
def test_arming_starts_where_the_robot_was_left_and_moves_it_to_rest(armed):
    armed.target(1000, -250)
    armed.wait_ticks(10)
    armed.done(m.Stop())
    armed.wait_ticks(1)
    armed.done(m.ClearFault(SESSION))
    armed.done(m.Arm(SESSION))
    tick = armed.next_tick()
    start = (3000 + 222, 3100 + 53)
    assert armed.pulses_of_tick(tick) == (start[0], 0)
    assert armed.pulses_of_tick(tick + 2 * AXIS_TICKS - 1) == start
    setpoints = [armed.report_of_tick(tick + 2 * AXIS_TICKS + n).setpoint_cdeg for n in range(11)]
    assert setpoints[:4] == [(900, -150), (800, -50), (700, 0), (600, 0)]
    assert setpoints[9:] == [(0, 0), (0, 0)]
    assert armed.report_of_tick(tick + 2 * AXIS_TICKS + 9 + 2).state is m.State.HOLD


@pytest.mark.requirement("ARM-1")
def test_hold_is_made_by_the_first_tick_that_finds_the_setpoint_at_rest(armed):
    armed.target(100)
    armed.wait_ticks(2)
    armed.done(m.Stop())
    armed.wait_ticks(1)
    armed.done(m.ClearFault(SESSION))
    armed.done(m.Arm(SESSION))
    moving = armed.next_tick() + 2 * AXIS_TICKS
    assert armed.report_of_tick(moving).state is m.State.ARMING
    assert armed.report_of_tick(moving + 1).state is m.State.HOLD


@pytest.mark.requirement("ARM-1")
def test_lesser_of_relax_slew_and_slew_limit_counts(host):
    host.configure(slew=m.Slew((30, 500)))
    host.arm()
    host.target(90, 250)
    host.wait_ticks(5)
    host.done(m.Disarm(SESSION))
    assert host.report_of_tick(host.next_tick()).setpoint_cdeg == (60, 150)


@pytest.mark.requirement("ARM-2")
def test_incomplete_configuration_is_refused_and_named(unconfigured):
    missing = m.ConfigGroups(0xF)
    assert unconfigured.refusal(m.Arm(SESSION)) == (m.NackCode.NOT_CONFIGURED, missing)
    unconfigured.done(m.SetSlew(SESSION, m.Slew((600, 600))))
    missing &= ~m.ConfigGroups.SLEW
    assert unconfigured.refusal(m.Arm(SESSION)) == (m.NackCode.NOT_CONFIGURED, missing)
    assert unconfigured.refusal(m.SaveConfig(SESSION)) == (m.NackCode.NOT_CONFIGURED, missing)
    assert not unconfigured.report().flags & m.StatusFlags.CONFIGURED
    unconfigured.configure()
    assert unconfigured.report().flags & m.StatusFlags.CONFIGURED
    unconfigured.done(m.Arm(SESSION))


@pytest.mark.requirement("ARM-3")
@pytest.mark.usefixtures("may_save")
def test_setpoint_after_a_reset_is_the_rest_pose(host):
    host.configure(limits=m.Limits((-8500, -6000), (8500, 6000), (500, -700)))
    host.save()
    host.reset()
    assert host.report().setpoint_cdeg == (500, -700)


@pytest.mark.requirement("ARM-4")
@pytest.mark.parametrize("cause", PHYSICAL_CAUSES)
@pytest.mark.usefixtures("may_save")
def test_board_never_arms_by_itself(armed, cause):
    armed.done(m.Stop())
    armed.wait_ticks(1)
    armed.done(m.ClearFault(SESSION))
    armed.save()
    armed.arm()
    armed.target(100)
    armed.reset(cause)
    assert armed.pulses_through(100) == {(0, 0)}
    assert armed.state() in (m.State.DISARMED, m.State.FAULT)


def test_disarm_while_arming_enables_no_further_axis(host):
    host.done(m.Arm(SESSION))
    tick = host.next_tick()
    host.go_past(tick)
    host.done(m.Disarm(SESSION))
    for later in range(tick, tick + 10):
        assert host.pulses_of_tick(later)[1] == 0
    assert host.state() is m.State.DISARMED


@pytest.mark.requirement("TIM-1", "TIM-3")
@pytest.mark.in_step("the clocks cannot be preset over a port")
def test_nothing_changes_when_the_clocks_of_the_board_wrap(make_host):
    before_wrap_us = 200_000
    plain = make_host()
    wrapping = make_host(board_time_at_reset_us=2**32 - before_wrap_us, tick_offset=2**32 - 12)
    histories = []
    for host in (plain, wrapping):
        offset = host.report().tick
        host.boot()
        history = []
        host.device.advance_to(m.TICK_PHASE_US + 6 * m.TICK_US)
        host.open_session()
        host.configure(watchdog=m.Watchdog(200, 100, 60))
        host.done(m.Arm(SESSION))
        for tick in range(8, 60):
            if tick == 18:
                host.target(3000, 500, ramp_ms=200, validity_ms=100)
            host.go_past(tick)
            report = host.report()
            ticks = (report.tick - offset) % 2**32
            history.append((ticks, report.state, report.setpoint_cdeg, report.target_age_ms))
        histories.append(history)
    assert histories[0] == histories[1]
    assert wrapping.report().tick < 100
    board_us = wrapping.told(m.ClockSync(0), m.ClockReply).board_time_us
    assert board_us == pytest.approx(wrapping.device.since_reset_us() - before_wrap_us, abs=2_000)


@pytest.mark.in_step("the moment of the reset cannot be seen on a port")
def test_clock_sync_reports_when_it_was_dispatched(make_host):
    host = make_host()
    host.device.advance_to(1_000_000)
    reply = host.told(m.ClockSync(0xDEADBEEF), m.ClockReply)
    assert reply.host_time_us == 0xDEADBEEF
    assert 1_000_000 < reply.board_time_us < host.device.since_reset_us()


@pytest.mark.requirement("TIM-5")
@pytest.mark.parametrize("cause", [m.ResetCause.POWER_ON, m.ResetCause.EXTERNAL])
@pytest.mark.in_step("the moment of the reset cannot be seen on a port")
def test_board_listens_soon_after_a_reset(make_host, cause):
    host = make_host()
    host.reset(cause)
    sent_us = host.device.since_reset_us()
    assert host.state() is m.State.BOOT
    assert host.device.since_reset_us() - sent_us < 15_000
