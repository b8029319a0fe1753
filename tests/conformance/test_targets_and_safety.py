"""TGT, PUL, WDG, STP and FLT."""

import pytest

from ccr_host.link import messages as m
from ccr_host.link.framing import encode_frame
from ccr_host.sim.board.eeprom import EepromImage
from tests.conformance.host import RELAX_TICKS

SESSION = 0x5E55
PULSING = (
    m.State.ARMING,
    m.State.ACTIVE,
    m.State.HOLD,
    m.State.RELAXING,
    m.State.DISARMING,
)


def bring_to(host, state):
    """Bring the board into a state from armed, in hold, at rest."""
    match state:
        case m.State.DISARMED:
            host.done(m.Disarm(SESSION))
            host.wait_for(state)
        case m.State.ARMING:
            host.done(m.Stop())
            host.wait_ticks(1)
            host.done(m.ClearFault(SESSION))
            host.done(m.Arm(SESSION))
            host.wait_ticks(1)
        case m.State.ACTIVE:
            host.target(1000, 500)
        case m.State.RELAXING:
            host.target(3000, 500, validity_ms=100)
            host.wait_for(state)
        case m.State.DISARMING:
            host.target(3000, 500)
            host.wait_ticks(6)
            host.done(m.Disarm(SESSION))
        case m.State.FAULT:
            host.wait_for(state)  # link loss
        case m.State.STOPPED:
            host.done(m.Stop())
    assert host.state() is state


@pytest.mark.requirement("TGT-1")
def test_target_outside_the_limits_is_clamped_and_reported(armed):
    reply = armed.target(9000, -7000)
    assert reply.target_cdeg == (8500, -6000)
    assert reply.flags & m.StatusFlags.CLAMPED
    assert armed.report().target_cdeg == (8500, -6000)
    assert not armed.target(8500, -6000).flags & m.StatusFlags.CLAMPED
    counters = armed.counters()
    assert (counters.targets_accepted, counters.targets_clamped) == (2, 1)


@pytest.mark.requirement("TGT-2")
def test_ramp_is_a_straight_line_rounded_toward_zero(armed):
    armed.target(1000, -1000, ramp_ms=121)  # 7 ticks
    tick = armed.next_tick()
    setpoints = [armed.report_of_tick(tick + n).setpoint_cdeg for n in range(9)]
    first = [142, 285, 428, 571, 714, 857, 1000, 1000, 1000]
    assert setpoints == [(angle, -angle) for angle in first]


@pytest.mark.requirement("TGT-2", "TGT-3")
def test_without_a_ramp_the_slew_limit_leads(armed):
    armed.target(1300, 1300)
    tick = armed.next_tick()
    setpoints = [armed.report_of_tick(tick + n).setpoint_cdeg for n in range(4)]
    assert setpoints == [(600, 500), (1200, 1000), (1300, 1300), (1300, 1300)]


@pytest.mark.requirement("TGT-3")
def test_ramp_faster_than_the_slew_limit_is_slowed(armed):
    armed.target(4000, 0, ramp_ms=40)
    tick = armed.next_tick()
    setpoints = [armed.report_of_tick(tick + n).setpoint_cdeg[0] for n in range(8)]
    assert setpoints == [600, 1200, 1800, 2400, 3000, 3600, 4000, 4000]


@pytest.mark.requirement("TGT-4")
def test_latest_target_replaces_the_one_before_from_where_it_stands(armed):
    armed.target(400, 400)
    for target in ((-200, 100), (300, 100)):
        armed.target(*target, ramp_ms=40)
        tick = armed.next_tick()
        start = armed.report_of_tick(tick - 1).setpoint_cdeg
        half_way = tuple(a + int((b - a) / 2) for a, b in zip(start, target, strict=True))
        assert armed.report_of_tick(tick).setpoint_cdeg == half_way
    assert armed.report_of_tick(tick + 1).setpoint_cdeg == (300, 100)


@pytest.mark.requirement("TGT-5")
def test_timed_target_takes_effect_at_its_tick_as_if_it_came_right_before_it(armed):
    tick = armed.next_tick() + 5
    armed.done(m.SetTargetAt(SESSION, (400, -300), 40, 100, tick + 1), sequence=77)
    before = armed.report_of_tick(tick - 1)
    assert before.state is m.State.HOLD
    assert before.target_sequence != 77
    report = armed.report_of_tick(tick)
    assert (report.state, report.target_sequence) == (m.State.ACTIVE, 77)
    assert (report.target_age_ms, report.setpoint_cdeg) == (20, (200, -150))
    assert armed.report_of_tick(tick + 1).setpoint_cdeg == (400, -300)
    assert armed.report_of_tick(tick + 4).state is m.State.ACTIVE
    assert armed.report_of_tick(tick + 5).state is m.State.HOLD


@pytest.mark.requirement("TGT-5")
@pytest.mark.parametrize("ahead", [0, -1, 2**31, -(2**31)])
def test_timed_target_whose_tick_is_not_ahead_is_refused(armed, ahead):
    tick = (armed.report().tick + ahead) % 2**32
    request = m.SetTargetAt(SESSION, (400, -300), 0, 100, tick)
    assert armed.refusal(request) == (m.NackCode.OUT_OF_RANGE, 4)


@pytest.mark.requirement("TGT-5")
@pytest.mark.parametrize(
    "newer",
    [
        m.SetTarget(SESSION, (100, 100), 0, 10_000),
        m.SetTargetAt(SESSION, (100, 100), 0, 10_000, 2**30),
        m.OpenSession(m.SPEC_HASH, SESSION),
        m.Disarm(SESSION),
    ],
    ids=lambda request: request.NAME,
)
def test_waiting_target_is_discarded_by_what_comes_after_it(armed, newer):
    accepted = armed.counters().targets_accepted
    tick = armed.next_tick() + 10
    armed.done(m.SetTargetAt(SESSION, (400, -300), 0, 10_000, tick + 1))
    armed.done(newer)
    report = armed.report_of_tick(tick + 2)
    assert report.target_cdeg != (400, -300)
    expected = accepted + isinstance(newer, m.SetTarget)
    assert armed.counters().targets_accepted == expected


def test_report_names_no_target_before_the_first(started):
    report = started.report()
    assert (report.target_sequence, report.target_cdeg, report.target_age_ms) == (0, (0, 0), 65535)


def test_report_names_the_last_accepted_target_and_its_age(armed):
    armed.done(m.SetTarget(SESSION, (5, 6), 0, 10_000), sequence=77)
    tick = armed.next_tick()
    report = armed.report_of_tick(tick + 9)
    assert (report.target_sequence, report.target_cdeg, report.target_age_ms) == (77, (5, 6), 200)


@pytest.mark.requirement("PUL-1")
@pytest.mark.parametrize(
    ("angle_cdeg", "pulse"),
    [
        (0, 3000),
        (1, 3000),  # 0.22
        (2, 3000),  # 0.44
        (3, 3001),  # 0.67
        (-3, 2999),
        (9, 3002),
        (8500, 4889),  # 1888.9
        (-8500, 1111),
    ],
)
def test_pulse_follows_the_calibration(armed, angle_cdeg, pulse):
    armed.target(angle_cdeg)
    armed.wait_ticks(20)
    assert armed.pulses_of_tick(armed.next_tick())[0] == pulse


@pytest.mark.requirement("PUL-1")
def test_halves_are_rounded_away_from_zero(host):
    calibration = m.Calibration((3000, 3000), (100, -100), (1000, 1000), (5000, 5000))
    host.configure(calibration=calibration)
    host.arm()
    host.target(45, 45)  # 0.5 and -0.5
    assert host.pulses_of_tick(host.next_tick()) == (3001, 2999)
    host.target(-135, -135)  # -1.5 and 1.5
    assert host.pulses_of_tick(host.next_tick()) == (2998, 3002)


@pytest.mark.requirement("PUL-1")
def test_pulses_stay_between_floor_and_ceiling_and_the_calibrated_ends(host):
    limits = m.Limits((-13500, -13500), (13500, 13500), (0, 0))
    calibration = m.Calibration((3000, 3000), (4000, 4000), (1000, 2000), (5000, 4000))
    host.configure(limits=limits, slew=m.Slew((2000, 2000)), calibration=calibration)
    host.arm()
    host.target(13500, 13500)
    assert host.pulses_of_tick(host.next_tick() + 10) == (5000, 4000)
    host.target(-13500, -13500)
    assert host.pulses_of_tick(host.next_tick() + 20) == (1000, 2000)


@pytest.mark.requirement("PUL-2")
@pytest.mark.parametrize("state", [s for s in m.State if s is not m.State.BOOT])
def test_pulses_are_only_present_in_pulsing_states(armed, state):
    bring_to(armed, state)
    pulses = armed.pulses_of_tick(armed.next_tick())
    assert (pulses[0] > 0) == (state in PULSING)
    report = armed.report()
    assert bool(report.flags & m.StatusFlags.AXIS_1_PULSES) == (report.state in PULSING)


@pytest.mark.requirement("WDG-1", "WDG-3", "WDG-5")
def test_silent_host_gets_hold_then_relaxing_then_link_loss(armed):
    armed.target(2050, validity_ms=100)
    tick = armed.next_tick()
    expired = tick + 5
    for later in range(expired, expired + RELAX_TICKS):
        report = armed.report_of_tick(later)
        assert (report.state, report.setpoint_cdeg[0]) == (m.State.HOLD, 2050)
    relaxing = expired + RELAX_TICKS
    for n in range(21):
        report = armed.report_of_tick(relaxing + n)
        assert (report.state, report.setpoint_cdeg[0]) == (
            m.State.RELAXING,
            max(2050 - 100 * (n + 1), 0),
        )
    report = armed.report_of_tick(relaxing + 21)
    assert (report.state, report.fault) == (m.State.FAULT, m.Fault.LINK_LOSS)
    assert armed.pulses_of_tick(relaxing + 21) == (0, 0)
    counters = armed.counters()
    assert (counters.holds, counters.relaxes) == (1, 1)


@pytest.mark.requirement("WDG-2")
def test_only_accepted_targets_feed_the_watchdog(armed):
    armed.target(100, validity_ms=100)
    tick = armed.next_tick()
    for later in range(tick, tick + 5):
        armed.go_past(later)
        armed.ask(m.Hello(1, m.SPEC_HASH))
        armed.ask(m.SetTelemetry(SESSION, 1))
        armed.ask(m.SetTarget(SESSION, (0, 0), 0, 0))
        armed.ask(m.SetTarget(SESSION + 1, (0, 0), 0, 100))
    assert armed.report_of_tick(tick + 5).state is m.State.HOLD


@pytest.mark.requirement("WDG-6")
@pytest.mark.in_step("it takes a minute")
def test_the_slowest_return_to_rest_that_can_be_configured_ends_in_time(with_session):
    host = with_session
    far, slow = m.Limits((-13500,) * 2, (-13499,) * 2, (-13500,) * 2), m.Slew((10, 10))
    host.configure(limits=far, slew=slow, watchdog=m.Watchdog(1000, 10, 20))
    host.done(m.SetLimits(SESSION, m.Limits((-13500,) * 2, (13500,) * 2, (13500,) * 2)))
    for too_slow in (m.Slew((9, 10)), m.Slew((10, 1))):
        assert host.refusal(m.SetSlew(SESSION, too_slow))[0] is m.NackCode.OUT_OF_RANGE
    assert host.refusal(m.SetWatchdog(SESSION, m.Watchdog(1000, 9, 20)))[0] is (
        m.NackCode.OUT_OF_RANGE
    )
    host.done(m.Arm(SESSION))
    begins = host.next_tick() + 2
    way_ticks = 2 * 13500 // 10
    assert way_ticks < m.WAY_TO_REST_MS * 1000 // m.TICK_US
    assert host.report_of_tick(begins).setpoint_cdeg == (-13489, -13489)
    assert host.report_of_tick(begins + way_ticks - 1).setpoint_cdeg == (13500, 13500)
    assert host.state() is m.State.ARMING


@pytest.mark.requirement("WDG-6")
@pytest.mark.in_step("it takes a minute")
def test_the_slowest_return_to_rest_that_starts_with_braking_ends_in_time(with_session):
    host = with_session
    limits = m.Limits((-13500,) * 2, (13500,) * 2, (-13500,) * 2)
    host.configure(limits=limits, slew=m.Slew((2000, 2000)), watchdog=m.Watchdog(1000, 10, 20))
    host.done(m.SetAcceleration(SESSION, m.Acceleration((1, 1))))
    host.done(m.Arm(SESSION))
    host.wait_for(m.State.HOLD, ticks=1500)
    host.target(13500, 13500, validity_ms=10_000)
    while host.report_of_tick(host.next_tick()).setpoint_cdeg[0] < 0:
        pass
    host.done(m.Disarm(SESSION))
    host.wait_ticks(m.WAY_TO_REST_MS * 1000 // m.TICK_US)
    assert host.state() is m.State.DISARMED


@pytest.mark.requirement("WDG-4")
@pytest.mark.parametrize("state", [m.State.HOLD, m.State.RELAXING])
def test_fresh_target_ends_hold_and_relaxing(armed, state):
    bring_to(armed, state)
    setpoint = armed.report().setpoint_cdeg[0]
    assert armed.target(setpoint + 100).state is m.State.ACTIVE
    assert armed.report_of_tick(armed.next_tick()).setpoint_cdeg[0] == setpoint + 100


@pytest.mark.requirement("STP-1")
@pytest.mark.parametrize("state", list(m.State))
@pytest.mark.parametrize("keep_session", [True, False])
def test_stop_takes_the_pulses_away_from_every_state(armed, state, keep_session):
    if state is m.State.BOOT:
        armed.reset_into_boot()
    else:
        bring_to(armed, state)
        assert (armed.pulses_of_tick(armed.next_tick())[0] > 0) == (state in PULSING)
    if not keep_session and state is not m.State.BOOT:
        armed.open_session(SESSION + 1)
    ack = armed.told(m.Stop(), m.Ack)
    assert ack.state is m.State.STOPPED
    assert armed.pulses_through(armed.next_tick() + 5) == {(0, 0)}


@pytest.mark.requirement("TIM-2")
@pytest.mark.parametrize("state", sorted(set(PULSING) - {m.State.ARMING}))
@pytest.mark.in_step("pins are seen in simulators only")
def test_stop_cuts_no_pulse(armed, state):
    bring_to(armed, state)
    armed.done(m.Stop())
    frame = armed.next_tick()
    assert armed.device.pulses_in_frame(frame)[0] > 0
    assert armed.device.pulses_in_frame(frame + 1) == (0, 0)


@pytest.mark.requirement("FLT-1")
@pytest.mark.in_step("EEPROM cells cannot be worn out over a port")
def test_first_fault_is_kept(make_host):
    host = make_host(EepromImage(worn_out=frozenset({m.EEPROM_SLOT_A})))
    host.reset(m.ResetCause.WATCHDOG)
    host.boot()
    host.open_session()
    host.configure()
    host.done(m.SaveConfig(SESSION))
    host.wait_ticks(6)
    assert not host.report().flags & m.StatusFlags.EEPROM_BUSY, "the save has failed by now"
    assert host.report().fault is m.Fault.WATCHDOG_RESET
    host.done(m.ClearFault(SESSION))
    assert host.report().fault is m.Fault.NONE


@pytest.mark.requirement("FLT-1")
def test_fault_is_kept_until_it_is_cleared(armed):
    armed.wait_for(m.State.FAULT)
    armed.done(m.Stop())
    armed.open_session()
    armed.configure()
    assert armed.report().fault is m.Fault.LINK_LOSS
    armed.done(m.ClearFault(SESSION))
    assert armed.report().fault is m.Fault.NONE


@pytest.mark.requirement("FLT-2")
@pytest.mark.parametrize("state", [m.State.FAULT, m.State.STOPPED])
def test_only_clear_fault_leads_out_of_a_latch(armed, state):
    bring_to(armed, state)
    for request in (m.Arm(SESSION), m.Disarm(SESSION), m.SetTarget(SESSION, (0, 0), 0, 100)):
        assert armed.refusal(request) == (m.NackCode.BAD_STATE, state)
    armed.wait_ticks(200)
    assert armed.state() is state
    ack = armed.told(m.ClearFault(SESSION), m.Ack)
    assert ack.state is m.State.DISARMED
    armed.arm()


@pytest.mark.requirement("FLT-4")
@pytest.mark.parametrize("state", PULSING)
@pytest.mark.in_step("the requests have to come between two ticks")
def test_a_latch_is_cleared_only_after_a_frame_without_pulses(armed, state):
    bring_to(armed, state)
    requests = [
        m.Stop(),
        m.SetLimits(SESSION, m.Limits((-9000, -9000), (-8000, -8000), (-8000, -8000))),
        m.ClearFault(SESSION),
        m.Arm(SESSION),
    ]
    frames = [encode_frame(r.ID, 100 + n, r.pack()) for n, r in enumerate(requests)]
    next_frame_us = (armed.device.since_reset_us() // m.TICK_US + 1) * m.TICK_US
    armed.device.advance_to(next_frame_us + 3000)  # all before the tick of this frame
    answers = [a for a in armed.exchange(b"".join(frames)) if a.sequence >= 100]
    clear, arm = (m.MESSAGES[answer.id].unpack(answer.payload) for answer in answers[2:])
    assert clear == m.Nack(m.ClearFault.ID, m.NackCode.BUSY, 0)
    assert arm == m.Nack(m.Arm.ID, m.NackCode.BAD_STATE, m.State.STOPPED)
    assert armed.pulses_of_tick(armed.next_tick()) == (0, 0)
    armed.done(m.ClearFault(SESSION))
    armed.done(m.Arm(SESSION))


@pytest.mark.requirement("REQ-3")
def test_requests_before_a_stop_are_neither_repeated_nor_acknowledged_again(host):
    host.done(m.Arm(SESSION), sequence=77)
    host.done(m.Stop())
    assert host.refusal(m.Arm(SESSION), sequence=77) == (m.NackCode.BAD_STATE, m.State.STOPPED)
    host.wait_ticks(1)
    host.done(m.ClearFault(SESSION), sequence=78)
    host.done(m.Stop())
    again = host.refusal(m.ClearFault(SESSION), sequence=78)
    assert again == (m.NackCode.BAD_STATE, m.State.STOPPED)
    assert host.state() is m.State.STOPPED


@pytest.mark.requirement("TGT-1")
def test_a_target_beyond_the_calibrated_pulses_is_reported_and_counted_as_clamped(host):
    narrow = m.Calibration((3000, 3000), (2000, 2000), (2900, 1000), (3100, 5000))
    host.done(m.SetCalibration(SESSION, narrow))
    host.arm()
    inside, outside = host.target(450), host.target(451 + 50)
    assert not inside.flags & m.StatusFlags.CLAMPED
    assert outside.flags & m.StatusFlags.CLAMPED
    assert outside.target_cdeg == (501, 0)
    assert host.counters().targets_clamped == 1


@pytest.mark.requirement("FLT-3")
@pytest.mark.parametrize(
    ("cause", "fault"),
    [
        (m.ResetCause.WATCHDOG, m.Fault.WATCHDOG_RESET),
        (m.ResetCause.BROWN_OUT, m.Fault.BROWN_OUT_RESET),
    ],
)
def test_reset_by_watchdog_or_brown_out_ends_boot_in_fault(armed, cause, fault):
    armed.reset(cause)
    assert armed.report_of_tick(m.BOOT_TICKS - 1).state is m.State.BOOT
    report = armed.report_of_tick(m.BOOT_TICKS)
    assert (report.state, report.fault) == (m.State.FAULT, fault)
    armed.open_session()
    armed.done(m.ClearFault(SESSION))
    assert armed.state() is m.State.DISARMED


@pytest.mark.requirement("FLT-3")
@pytest.mark.parametrize("state", [s for s in m.State if s is not m.State.BOOT])
def test_reset_of_unknown_cause_ends_boot_in_fault_where_it_has_cut_pulses(armed, state):
    bring_to(armed, state)
    armed.wait_ticks(1)
    armed.reset(m.ResetCause.UNKNOWN)
    assert armed.hello().reset_cause is m.ResetCause.UNKNOWN
    report = armed.report_of_tick(m.BOOT_TICKS)
    expected = m.Fault.RESET_WHILE_ARMED if state in PULSING else m.Fault.NONE
    assert report.fault is expected
    assert report.state is (m.State.FAULT if expected else m.State.DISARMED)


@pytest.mark.requirement("FLT-3")
@pytest.mark.parametrize("cause", [m.ResetCause.EXTERNAL, m.ResetCause.POWER_ON])
@pytest.mark.in_step("a boot loader may hide the cause")
def test_reset_of_another_known_cause_is_not_a_fault(armed, cause):
    armed.reset(cause)
    report = armed.report_of_tick(m.BOOT_TICKS)
    assert (report.state, report.fault) == (m.State.DISARMED, m.Fault.NONE)


def test_disarm_moves_slowly_to_rest_and_then_ends_the_pulses(armed):
    armed.target(450, 100)
    armed.wait_ticks(5)
    armed.done(m.Disarm(SESSION))
    tick = armed.next_tick()
    setpoints = [armed.report_of_tick(tick + n).setpoint_cdeg for n in range(5)]
    assert setpoints == [(350, 0), (250, 0), (150, 0), (50, 0), (0, 0)]
    assert armed.pulses_of_tick(tick + 4)[0] > 0
    assert armed.report_of_tick(tick + 5).state is m.State.DISARMED
    assert armed.pulses_of_tick(tick + 5) == (0, 0)
    armed.done(m.Disarm(SESSION))
    assert armed.state() is m.State.DISARMED
