"""ACC: how fast the setpoint may change its speed."""

from itertools import pairwise

import pytest

from ccr_host.link import messages as m
from tests.conformance.device import AXES
from tests.conformance.host import LIMITS, SESSION

SLEW = m.Slew((600, 500))

pytestmark = pytest.mark.in_step("what a port's board keeps of it would have to be saved again")


def accelerating(host, *acceleration, slew=SLEW, watchdog=None):
    host.configure(slew=slew, watchdog=watchdog or m.Watchdog(3000, 100, 40))
    host.done(m.SetAcceleration(SESSION, m.Acceleration(acceleration)))
    host.arm()
    return host


def setpoints(host, ticks):
    """Setpoints after each tick, starting with the previous one."""
    seen = [host.report().setpoint_cdeg]
    first = host.next_tick()
    seen += [host.report_of_tick(tick).setpoint_cdeg for tick in range(first, first + ticks)]
    return seen


def steps(seen, axis):
    return [after[axis] - before[axis] for before, after in pairwise(seen)]


def assert_gentle(seen, acceleration, start=(0, 0)):
    for axis in (0, 1):
        made = [start[axis], *steps(seen, axis)]
        assert all(abs(b - a) <= acceleration[axis] for a, b in pairwise(made)), made
        assert max(map(abs, made)) <= SLEW.slew_cdeg_tick[axis]


@pytest.mark.requirement("ACC-1", "ACC-2")
@pytest.mark.parametrize("acceleration", [(1, 3), (7, 20), (60, 125), (600, 500), (2000, 1999)])
@pytest.mark.parametrize("target", [(1, -1), (137, -2001), (8500, -6000)])
def test_setpoint_stops_at_its_target_without_passing_it(host, acceleration, target):
    accelerating(host, *acceleration)
    host.target(*target, validity_ms=10_000)
    seen = setpoints(host, 400)
    assert_gentle(seen, acceleration)
    assert seen[-2:] == [target, target]
    for axis in (0, 1):
        made = steps(seen, axis)
        assert all(step * target[axis] >= 0 for step in made), "it never turns back"
        arrived = next(n for n, at in enumerate(seen) if at[axis] == target[axis])
        way, most, a = abs(target[axis]), SLEW.slew_cdeg_tick[axis], acceleration[axis]
        quickest = way / most + most / a if way * a > most**2 else 2 * (way / a) ** 0.5
        assert arrived <= quickest + 4


@pytest.mark.requirement("ACC-1", "ACC-2")
def test_target_nearer_than_it_can_brake_is_passed_and_returned_to_inside_the_limits(host):
    accelerating(host, 10, 10)
    host.target(LIMITS.angle_max_cdeg[0], 0, validity_ms=10_000)
    seen = setpoints(host, 25)
    here = seen[-1][0]
    host.target(here + 1, 0, validity_ms=10_000)
    after = setpoints(host, 120)
    assert_gentle(after, (10, 10), start=(steps(seen, 0)[-1], 0))
    assert max(at[0] for at in after) > here + 1
    assert max(at[0] for at in after) <= LIMITS.angle_max_cdeg[0]
    assert after[-1] == (here + 1, 0)


@pytest.mark.requirement("ACC-1")
def test_hold_brakes_and_then_stands_still(host):
    accelerating(host, 10, 10)
    host.target(8000, -6000, validity_ms=400)
    seen = setpoints(host, 20)
    moving = steps(seen, 0)[-1], steps(seen, 1)[-1]
    assert moving[0] > 100
    held = setpoints(host, 60)
    assert host.state() is m.State.HOLD
    assert_gentle(held, (10, 10), start=moving)
    assert len(set(held[-20:])) == 1
    assert max(at[0] for at in held) < 8000
    assert not host.report().flags & m.StatusFlags.MOVING


@pytest.mark.requirement("ACC-1", "ACC-3")
@pytest.mark.parametrize("way", ["relaxing", "disarming"])
def test_way_to_rest_is_gentle_and_ends_standing(host, way):
    accelerating(host, 5, 9, watchdog=m.Watchdog(200, 100, 40))
    host.target(6000, -5000, validity_ms=600)
    seen = setpoints(host, 30)
    if way == "disarming":
        host.done(m.Disarm(SESSION))
    start = steps(seen, 0)[-1], steps(seen, 1)[-1]
    seen, ended = [seen[-1]], (m.State.FAULT, m.State.DISARMED)
    for _ in range(400):
        report = host.report_of_tick(host.next_tick())
        seen.append(report.setpoint_cdeg)
        if report.state in ended:
            break
        assert report.pulse_half_us[0] > 0
    assert_gentle(seen, (5, 9), start=start)
    assert seen[-3:] == [(0, 0)] * 3, "it has stood before the pulses go"


@pytest.mark.requirement("ACC-1")
@pytest.mark.parametrize("end", ["stop", "emergency stop"])
def test_after_pulses_were_gone_it_starts_from_a_stand(host, end):
    accelerating(host, 10, 10)
    host.done(m.SetTelemetry(SESSION, 0))
    host.target(8000, 6000, validity_ms=10_000)
    host.wait_ticks(20)
    host.done(m.Stop())
    host.wait_ticks(1)
    stood = host.report().setpoint_cdeg
    assert host.report_of_tick(host.next_tick()).setpoint_cdeg == stood
    host.done(m.ClearFault(SESSION))
    host.done(m.Arm(SESSION))
    assert_gentle(setpoints(host, 50), (10, 10))


@pytest.mark.requirement("CFG-2")
def test_acceleration_is_kept_with_the_configuration(host):
    wanted = m.Acceleration((12, 34))
    host.done(m.SetAcceleration(SESSION, wanted))
    assert host.report().flags & m.StatusFlags.UNSAVED
    too_much = m.SetAcceleration(SESSION, m.Acceleration((2001, 0)))
    assert host.refusal(too_much) == (m.NackCode.OUT_OF_RANGE, 1)
    host.done(m.SaveConfig(SESSION))
    assert host.refusal(m.SetAcceleration(SESSION, wanted)) == (m.NackCode.BUSY, 0)
    host.wait_ticks(m.eeprom_slot_size(AXES) + 1)
    host.reset()
    assert host.config().acceleration == wanted
