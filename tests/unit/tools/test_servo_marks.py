import pytest
from hypothesis import given
from hypothesis import strategies as st

from ccr_host.core.errors import ConfigError
from ccr_host.description.schema import Robot, Servo, load
from ccr_host.tools.calibrate import check_marks, doubts_about, questions, servo_from_marks

SERVO = Servo(slew_deg_s=(200.0, 100.0))


def marks_us(neutral_us: float, per_90_us: float, low_deg: float, high_deg: float) -> list[float]:
    return [neutral_us + per_90_us * angle / 90 for angle in (0, 45, -45, low_deg, high_deg)]


@given(
    st.floats(1400, 1600),
    st.floats(600, 1100),
    st.sampled_from([-1, 1]),
    st.floats(-80, -5),
    st.floats(5, 80),
)
def test_marks_of_any_servo_give_that_servo(neutral_us, per_90_us, direction, low, high) -> None:
    pulses = [
        *marks_us(neutral_us, direction * per_90_us, low, high),
        *marks_us(1500.0, 1000.0, -60.0, 60.0),
    ]
    found = servo_from_marks(SERVO, pulses)
    assert found.neutral_pulse_us[0] == pytest.approx(neutral_us, abs=0.25)
    assert found.pulse_per_90_deg_us[0] == pytest.approx(direction * per_90_us, abs=0.25)
    assert found.angle_min_deg == pytest.approx((low, -60.0), abs=0.051)
    assert found.angle_max_deg == pytest.approx((high, 60.0), abs=0.051)
    assert found.slew_deg_s == SERVO.slew_deg_s, "not asked for, not changed"


GOOD = marks_us(1500.0, 1000.0, -60.0, 60.0)


@pytest.mark.parametrize(
    ("first", "told"),
    [
        ([1500.0] * 5, "nearly the same pulse"),
        ([1500.0, 2000.0, 1200.0, 1000.0, 2000.0], "off a line"),
        (marks_us(1500.0, 1000.0, 20.0, 60.0), "rest pose"),
    ],
)
def test_marks_that_no_servo_gives_are_refused(first, told) -> None:
    with pytest.raises(ConfigError, match=told):
        servo_from_marks(SERVO, [*first, *GOOD])


def test_each_servo_is_asked_the_same() -> None:
    about = [question.partition(":")[0] for question in questions(Robot())]
    assert about == ["motor 1"] * 5 + ["motor 2"] * 5


def test_each_servo_is_told_where_it_bends_which_segment() -> None:
    first, second = (questions(Robot())[number] for number in (1, 6))
    assert first.endswith("which bends segment 1 towards the markers' side")
    assert second.endswith("which bends segment 2 to +x")
    robot = load("two-spatial").robot
    asked = questions(robot)
    assert [question[:8] for question in asked[::5]] == [f"motor {n}:" for n in (1, 2, 3, 4)]
    assert asked[16] == "motor 4: horn at +45 deg, which bends segment 2 towards 45 deg"
    base, tip = robot.segments
    turned = robot.model_copy(
        update={"segments": (base, tip.model_copy(update={"clocking_deg": 10.0}))}
    )
    assert questions(turned)[16].endswith("towards 55 deg")


def test_marks_of_four_servos_give_four_servos() -> None:
    servo = load("two-spatial").servo
    marked = [marks_us(1500.0 + 10 * axis, 1000.0, -60.0, 50.0 + axis) for axis in range(4)]
    found = servo_from_marks(servo, [pulse for pulses in marked for pulse in pulses])
    assert found.neutral_pulse_us == (1500.0, 1510.0, 1520.0, 1530.0)
    assert found.angle_max_deg == (50.0, 51.0, 52.0, 53.0)
    assert not doubts_about(servo, found)


def doubts(first: list[float], second: list[float]) -> list[str]:
    return doubts_about(SERVO, servo_from_marks(SERVO, [*first, *second]))


def test_usual_servos_leave_no_doubt() -> None:
    assert (
        doubts(marks_us(1540.0, 950.0, -70.0, 60.0), marks_us(1475.0, -1050.0, -70.0, 60.0)) == []
    )


@pytest.mark.parametrize(
    ("other", "told"),
    [
        (marks_us(1500.0, 500.0, -60.0, 60.0), "1000 us for motor 1 but 500 us for motor 2"),
        (marks_us(1500.0, -1600.0, -30.0, 30.0), "motor 2 were 1000 us, now 1600 us"),
        (marks_us(1800.0, 1000.0, -60.0, 30.0), "motor 2 is straight 27 deg from"),
    ],
)
def test_a_servo_unlike_its_fellow_or_its_description_is_doubted(other, told) -> None:
    assert told in "; ".join(doubts(GOOD, other))


def test_marks_are_judged_as_soon_as_a_motor_has_enough_of_them() -> None:
    good, crooked = marks_us(1500.0, 1000.0, -60.0, 60.0), [1500.0, 2000.0, 1200.0]
    for count in range(1, len(questions(Robot())) + 1):
        check_marks(SERVO, [*good, *good][:count])
    with pytest.raises(ConfigError, match=r"motor 1: .*off a line"):
        check_marks(SERVO, crooked)
    with pytest.raises(ConfigError, match=r"motor 2: .*off a line"):
        check_marks(SERVO, [*good, *crooked])
    with pytest.raises(ConfigError, match=r"motor 2: its rest pose"):
        check_marks(SERVO, [*good, *marks_us(1500.0, 1000.0, 20.0, 60.0)])
