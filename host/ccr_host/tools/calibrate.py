"""``ccr-host calibrate --by-eye``: the user moves each servo to known angles and marks them."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence

import numpy as np
from rich.table import Table

from ccr_host.core.arrays import Array
from ccr_host.core.errors import ConfigError
from ccr_host.description.robot import Robot
from ccr_host.description.schema import Description, Servo
from ccr_host.link.messages import StateReport, StatusFlags
from ccr_host.run.rig import Rig
from ccr_host.tools.jog import JogView, jog
from ccr_host.tools.survey_fit import Survey

Pair = tuple[float, float]

ANGLES_DEG = (0.0, 45.0, -45.0)
"""Easy to see against a set square."""
_LIMIT_MARGIN_DEG = 1.0
"""Distance by which the rest pose may exceed the marked limits; it then becomes the limit."""
_STRAIGHT_DEG = 3.0
"""Largest distance of a mark from the line: nonlinearity of the servo and error of the eye."""
_LEAST_SPAN_US = 100.0
_MARKS = len(ANGLES_DEG) + 2
"""Marks of each motor: its angles, then its limits."""
_DIRECTIONS = {
    0.0: "to +x",
    90.0: "towards the markers' side",
    180.0: "to -x",
    270.0: "away from the markers",
}
"""Directions by their angle about the backbone, deg."""
_USUAL_RATIO = 1.25
"""Usual ratio of the scales of two servos, or of a servo and its description, at most."""
_USUAL_NEUTRAL_DEG = 20.0
"""Further off, the horn is on a wrong tooth of its spline (14.4 deg per tooth)."""


def questions(robot: Robot) -> list[str]:
    """The poses to which the user is asked to move each servo, `_MARKS` of them, in words."""
    listed = []
    for axis in range(robot.motors):
        horn = f"motor {axis + 1}: horn at"
        wound = [(segment, t) for segment, t in robot.tendons if t.motor == axis + 1]
        segment, tendon = max(wound, key=lambda one: one[1].winding)
        hole_deg = tendon.angle_deg + robot.chain[segment].clocking_deg
        towards_deg = (hole_deg + (180.0 if tendon.winding < 0 else 0.0)) % 360.0
        towards = _DIRECTIONS.get(towards_deg, f"towards {towards_deg:g} deg")
        listed += [
            f"{horn} 0 deg, segment {segment + 1} straight",
            f"{horn} +45 deg, which bends segment {segment + 1} {towards}",
            f"{horn} -45 deg, to the other side",
            f"motor {axis + 1}: lowest angle that is ever allowed",
            f"motor {axis + 1}: highest angle that is ever allowed",
        ]
    return listed


def check_marks(servo: Servo, pulses_us: Sequence[float]) -> None:
    """Check the answers so far, once a motor's line or limits are complete.

    Raises:
        ConfigError: the marks are not plausible.
    """
    axis, last = divmod(len(pulses_us) - 1, _MARKS)
    marked_us = np.array(pulses_us[len(pulses_us) - 1 - last :])
    if last >= len(ANGLES_DEG) - 1:
        line = _line(axis, marked_us[: len(ANGLES_DEG)])
        if last == _MARKS - 1:
            _limits_deg(axis, marked_us[len(ANGLES_DEG) :], line, servo.rest_deg[axis])


def doubts_about(before: Servo, found: Servo) -> list[str]:
    """Unusual results of a calibration that the user should confirm, each as a clause."""
    scales_us = np.abs(found.pulse_per_90_deg_us)
    doubts = []
    if scales_us.max() > _USUAL_RATIO * scales_us.min():
        one, other = sorted((int(scales_us.argmin()), int(scales_us.argmax())))
        doubts.append(
            f"90 deg are {scales_us[one]:g} us for motor {one + 1} but {scales_us[other]:g} us for "
            f"motor {other + 1}"
        )
    for axis in range(len(scales_us)):
        described_us, scale_us = abs(before.pulse_per_90_deg_us[axis]), scales_us[axis]
        if not 1.0 / _USUAL_RATIO <= scale_us / described_us <= _USUAL_RATIO:
            doubts.append(
                f"90 deg of motor {axis + 1} were {described_us:g} us, now {scale_us:g} us"
            )
        moved_us = found.neutral_pulse_us[axis] - before.neutral_pulse_us[axis]
        moved_deg = 90.0 * moved_us / scale_us
        if abs(moved_deg) > _USUAL_NEUTRAL_DEG:
            doubts.append(f"motor {axis + 1} is straight {abs(moved_deg):.0f} deg from its zero")
    return doubts


def servo_from_marks(servo: Servo, pulses_us: Sequence[float]) -> Servo:
    """The servos with calibration and angle limits from the marks, all else unchanged.

    ``pulses_us`` are the answers to all questions, in the same order.

    Raises:
        ConfigError: the marks are not plausible.
    """
    marks_us = np.reshape(np.asarray(pulses_us, dtype=np.float64), (-1, _MARKS))
    axes = range(len(marks_us))
    lines = [_line(axis, marks_us[axis, : len(ANGLES_DEG)]) for axis in axes]
    neutral_us, per_90_us = zip(*lines, strict=True)
    limits_deg = [
        _limits_deg(axis, marks_us[axis, len(ANGLES_DEG) :], lines[axis], servo.rest_deg[axis])
        for axis in axes
    ]
    return Servo.model_validate(
        servo.model_dump()
        | {
            "neutral_pulse_us": _to_half_us(neutral_us),
            "pulse_per_90_deg_us": _to_half_us(per_90_us),
            "angle_min_deg": _rounded([low for low, _ in limits_deg]),
            "angle_max_deg": _rounded([high for _, high in limits_deg]),
        }
    )


def _limits_deg(axis: int, marked_us: Array, line: Pair, rest_deg: float) -> tuple[float, float]:
    neutral_us, per_90_us = line
    low, high = sorted(90.0 * (marked_us - neutral_us) / per_90_us)
    if not low - _LIMIT_MARGIN_DEG <= rest_deg <= high + _LIMIT_MARGIN_DEG:
        raise ConfigError(
            f"motor {axis + 1}: its rest pose of {rest_deg:g} deg is outside the marked range of "
            f"{low:.1f} to {high:.1f} deg",
            "mark the limits again, or correct servo.rest_deg",
        )
    return min(low, rest_deg), max(high, rest_deg)


def _line(axis: int, marked_us: Array) -> Pair:
    """Neutral pulse and pulse per 90 deg of one servo, us."""
    per_deg_us, neutral_us = np.polyfit(ANGLES_DEG, marked_us, 1)
    if abs(marked_us[1] - marked_us[2]) < _LEAST_SPAN_US:
        raise ConfigError(
            f"motor {axis + 1}: +45 and -45 deg were marked at nearly the same pulse",
            "move the motor with the arrow keys before pressing Enter",
        )
    off_deg = np.abs(marked_us - neutral_us - per_deg_us * np.array(ANGLES_DEG)) / abs(per_deg_us)
    if off_deg.max() > _STRAIGHT_DEG:
        raise ConfigError(
            f"motor {axis + 1}: the marks at -45, 0 and 45 deg are {off_deg.max():.1f} deg off a "
            "line",
            "mark them again; if they still are, the horn has slipped",
        )
    return float(neutral_us), float(90.0 * per_deg_us)


def _to_half_us(pulses_us: Sequence[float]) -> tuple[float, ...]:
    return tuple(round(2.0 * pulse) / 2.0 for pulse in pulses_us)


def _rounded(angles_deg: Sequence[float]) -> tuple[float, ...]:
    return tuple(round(float(angle), 1) for angle in angles_deg)


def calibration_table(found: Survey, description: Description) -> Table:
    """Table of the fitted mounting, one row per servo."""
    robot = description.robot
    radii_mm = sorted({segment.tendon_radius_mm for segment in robot.chain}, reverse=True)
    described = ", ".join(f"{robot.pulley_radius_mm / radius_mm:.2f}" for radius_mm in radii_mm)
    table = Table(
        title="mounting of the servos",
        title_justify="left",
        caption=f"{found.fit.residual}; +-: standard deviation; take-up: motor "
        "angle, and length of tendon, that takes up the slack; gain: bending over motor angle, "
        f"described {described} (r_p / r_c)",
        caption_justify="left",
    )
    for heading in ("motor", "direction", "neutral (deg)", "take-up", "gain"):
        table.add_column(heading, justify="right")
    for axis in range(len(found.direction)):
        take_up_rad = found.take_up_rad[axis]
        table.add_row(
            str(axis + 1),
            "as described" if found.direction[axis] > 0 else "reversed",
            f"{np.degrees(found.neutral_rad[axis]):.2f} "
            f"+- {np.degrees(found.neutral_deviation_rad[axis]):.2f}",
            f"{np.degrees(take_up_rad):.1f} deg, {take_up_rad * robot.pulley_radius_mm:.2f} mm",
            f"{found.gain[axis]:.2f}",
        )
    return table


Show = Callable[[JogView, str], None]
"""Draws the robot and the question."""


def calibrate_by_eye(
    rig: Rig, description: Description, pressed: Callable[[], Iterable[str]], show: Show
) -> Servo | None:
    """Ask all questions; None if the user quits before the last one.

    Raises:
        DeviceError: the board cannot be armed or disarmed.
    """
    dialogue = _Dialogue(description)

    def show_question(view: JogView) -> None:
        show(view, dialogue.asked)

    done = jog(rig, description, pressed, show_question, dialogue.mark, dialogue.back)
    return dialogue.servo() if done else None


class _Dialogue:
    """Questions and answers; implausible marks are asked for again."""

    def __init__(self, description: Description) -> None:
        self._before = description.servo
        self._questions = questions(description.robot)
        self._pulses_us: list[float] = []
        self._refused = ""
        """Why the last marks must be repeated; empty if they need not be."""

    @property
    def asked(self) -> str:
        """The current question, after the reason for asking again, if any."""
        number = len(self._pulses_us)
        if number == len(self._questions):
            doubts = "; ".join(self._doubts())
            return f"{doubts}.\nEnter accepts this, b goes back, q quits" if doubts else ""
        question = f"{number + 1} of {len(self._questions)}: {self._questions[number]}, then Enter"
        return f"{self._refused}\n{question}" if self._refused else question

    def mark(self, report: StateReport) -> bool:
        """Record the present pulse as an answer, or accept all answers; whether all are done."""
        if len(self._pulses_us) == len(self._questions):
            return True
        half_us = report.pulse_half_us[len(self._pulses_us) // _MARKS]
        if not half_us or report.flags & StatusFlags.MOVING:
            return False
        self._pulses_us.append(half_us / 2)
        self._refused = ""
        try:
            check_marks(self._before, self._pulses_us)
        except ConfigError as error:
            self._refused = str(error)
            self.back()
        return len(self._pulses_us) == len(self._questions) and not self._doubts()

    def back(self) -> None:
        """Discard the last answer."""
        if self._pulses_us:
            self._pulses_us.pop()

    def servo(self) -> Servo:
        """The calibrated servos, once all questions are answered."""
        return servo_from_marks(self._before, self._pulses_us)

    def _doubts(self) -> list[str]:
        return doubts_about(self._before, self.servo())
