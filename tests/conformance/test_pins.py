"""SUP and LED: outputs of the board other than the servo pulses."""

import pytest

from ccr_host.link import messages as m

SESSION = 0x5E55
STEPS = 8
SHOWN = {
    m.State.BOOT: "########",
    m.State.DISARMED: "#.......",
    m.State.ARMING: "#.#.#.#.",
    m.State.ACTIVE: "########",
    m.State.HOLD: "#######.",
    m.State.RELAXING: "##..##..",
    m.State.DISARMING: "##..##..",
    m.State.FAULT: "#.#.#...",
    m.State.STOPPED: "#.#.....",
}
"""A mark for each step in which the LED is on."""

pytestmark = pytest.mark.in_step("LED and supply cannot be seen over a port")


def led_through(host, ticks):
    """State, and whether the LED is on, in each tick."""
    seen = []
    first = host.next_tick()
    for tick in range(first, first + ticks):
        report = host.report_of_tick(tick)
        seen.append((report, host.device.board.led_on))
    return seen


def assert_shown(host, ticks):
    for report, is_on in led_through(host, ticks):
        step = report.tick // m.LED_STEP_TICKS % STEPS
        assert is_on == (SHOWN[report.state][step] == "#"), report


def supply_through(host, ticks):
    """State, and whether the supply is on, after each tick."""
    first = host.next_tick()
    return [
        (host.report_of_tick(tick).state, host.device.board.servo_supply_on)
        for tick in range(first, first + ticks)
    ]


PULSING = {m.State.ARMING, m.State.ACTIVE, m.State.HOLD, m.State.RELAXING, m.State.DISARMING}


@pytest.mark.requirement("SUP-1")
@pytest.mark.parametrize("way_out", ["disarm", "stop", "silence", "reset"])
def test_servo_supply_is_on_from_arming_until_the_pulses_end(host, way_out):
    host.configure(watchdog=m.Watchdog(400, 50, 40))
    seen = supply_through(host, 5)
    host.done(m.Arm(SESSION))
    assert not host.device.board.servo_supply_on, "it is switched in ticks"
    seen += supply_through(host, 20)
    host.target(500, validity_ms=200)
    seen += supply_through(host, 5)
    match way_out:
        case "disarm":
            host.done(m.Disarm(SESSION))
        case "stop":
            host.done(m.Stop())
        case "reset":
            host.reset(m.ResetCause.EXTERNAL)
            assert not host.device.board.servo_supply_on
    seen += supply_through(host, 60)
    assert all(is_on == (state in PULSING) for state, is_on in seen)
    assert {is_on for _, is_on in seen} == {False, True}
    assert not seen[-1][1]


@pytest.mark.requirement("SUP-1")
def test_servo_supply_stays_off_through_boot_into_fault(make_host):
    host = make_host()
    host.reset(m.ResetCause.WATCHDOG)
    assert {is_on for _, is_on in supply_through(host, 20)} == {False}


@pytest.mark.requirement("LED-1")
def test_led_shows_each_state(host):
    round_ticks = STEPS * m.LED_STEP_TICKS
    host.configure(watchdog=m.Watchdog(2000, 10, 1500))
    assert_shown(host, round_ticks)
    host.done(m.Arm(SESSION))
    assert_shown(host, 2 * round_ticks)
    host.wait_for(m.State.HOLD)
    assert_shown(host, round_ticks)
    host.target(4000, validity_ms=2000)
    assert_shown(host, round_ticks)
    host.wait_for(m.State.RELAXING)
    assert_shown(host, round_ticks)
    host.target(4000, validity_ms=200)
    host.done(m.Disarm(SESSION))
    assert_shown(host, round_ticks)
    host.done(m.Stop())
    host.wait_ticks(1)
    assert_shown(host, round_ticks)


@pytest.mark.requirement("LED-1")
def test_led_shows_boot_and_a_fault(make_host):
    host = make_host()
    host.reset(m.ResetCause.WATCHDOG)
    assert_shown(host, m.BOOT_TICKS + 1 + STEPS * m.LED_STEP_TICKS)


@pytest.mark.requirement("LED-2")
@pytest.mark.parametrize("ended_early", [False, True])
def test_led_blinks_on_request_without_a_session(started, ended_early):
    started.boot()
    ticks = 1000 // (m.TICK_US // 1000)
    first = started.next_tick()
    assert started.done(m.Blink(1)) == m.Ack(m.Blink.ID, m.State.DISARMED)
    blinking = ticks // 2 if ended_early else ticks
    for report, is_on in led_through(started, blinking):
        assert is_on == (report.tick // m.BLINK_STEP_TICKS % 2 == 0)
    assert started.next_tick() == first + blinking
    if ended_early:
        started.done(m.Blink(0))
    assert_shown(started, STEPS * m.LED_STEP_TICKS)


@pytest.mark.requirement("LED-2")
def test_blinking_for_longer_than_a_minute_is_refused(started):
    assert started.refusal(m.Blink(61)) == (m.NackCode.OUT_OF_RANGE, 0)
