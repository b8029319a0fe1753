"""Calibration of the servos by eye: pulses that the user has marked, and the line through them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ccr_host.config import Pair, Servo
from ccr_host.errors import ConfigError

Array = NDArray[np.float64]

ANGLES_DEG = (0.0, 45.0, -45.0)
"""Easy to see against a set square."""
_LIMIT_MARGIN_DEG = 1.0
"""So far the marks may miss the rest pose, which then is the limit."""
_STRAIGHT_DEG = 3.0
"""Greatest distance of a mark from the line: a servo's own error and that of the eye."""
_LEAST_SPAN_US = 100.0
_AXES = 2
_USUAL_RATIO = 1.25
"""Servos of one robot, and a servo and its description, agree so well in scale."""
_USUAL_NEUTRAL_DEG = 20.0
"""Further off, the horn sits on a wrong tooth of its spline, which has one each 14.4 deg."""


@dataclass(frozen=True)
class Question:
    """One pose that the user is asked to lead a servo to."""

    axis: int
    text: str


def _questions() -> tuple[Question, ...]:
    bends = ("segment 1 towards the markers' side", "segment 2 to +x")
    listed = []
    for axis in range(_AXES):
        horn = f"motor {axis + 1}: horn at"
        listed += [
            Question(axis, f"{horn} 0 deg, segment {axis + 1} straight"),
            Question(axis, f"{horn} +45 deg, which bends {bends[axis]}"),
            Question(axis, f"{horn} -45 deg, to the other side"),
            Question(axis, f"motor {axis + 1}: the lowest angle that it may ever have"),
            Question(axis, f"motor {axis + 1}: the highest angle that it may ever have"),
        ]
    return tuple(listed)


QUESTIONS = _questions()


def check_marks(servo: Servo, pulses_us: Sequence[float]) -> None:
    """Judge the answers given so far, as soon as a motor's line or limits are complete.

    Raises:
        ConfigError: marks that no servo would give.
    """
    axis, last = divmod(len(pulses_us) - 1, len(QUESTIONS) // _AXES)
    marked_us = np.array(pulses_us[len(pulses_us) - 1 - last :])
    if last >= len(ANGLES_DEG) - 1:
        line = _line(axis, marked_us[: len(ANGLES_DEG)])
        if last == len(QUESTIONS) // _AXES - 1:
            _limits_deg(axis, marked_us[len(ANGLES_DEG) :], line, servo.rest_deg[axis])


def doubts_about(before: Servo, found: Servo) -> list[str]:
    """What of a calibration is so unusual that the user should be asked; each a clause."""
    scales_us = np.abs(found.pulse_per_90_deg_us)
    doubts = []
    if scales_us.max() > _USUAL_RATIO * scales_us.min():
        first, second = scales_us
        doubts.append(f"90 deg are {first:g} us of motor 1 but {second:g} us of motor 2")
    for axis in range(_AXES):
        described_us, scale_us = abs(before.pulse_per_90_deg_us[axis]), scales_us[axis]
        if not 1.0 / _USUAL_RATIO <= scale_us / described_us <= _USUAL_RATIO:
            doubts.append(
                f"90 deg of motor {axis + 1} were {described_us:g} us and are {scale_us:g} us"
            )
        moved_us = found.neutral_pulse_us[axis] - before.neutral_pulse_us[axis]
        moved_deg = 90.0 * moved_us / scale_us
        if abs(moved_deg) > _USUAL_NEUTRAL_DEG:
            doubts.append(f"motor {axis + 1} stands straight {abs(moved_deg):.0f} deg off its zero")
    return doubts


def servo_from_marks(servo: Servo, pulses_us: Sequence[float]) -> Servo:
    """The calibration through the marks; all but calibration and angle limits as before.

    Args:
        servo: as described so far.
        pulses_us: answers to ``QUESTIONS``, in their order.

    Raises:
        ConfigError: marks that no servo would give.
    """
    marks_us = np.reshape(np.asarray(pulses_us, dtype=np.float64), (_AXES, -1))
    lines = [_line(axis, marks_us[axis, : len(ANGLES_DEG)]) for axis in range(_AXES)]
    neutral_us, per_90_us = zip(*lines, strict=True)
    limits_deg = [
        _limits_deg(axis, marks_us[axis, len(ANGLES_DEG) :], lines[axis], servo.rest_deg[axis])
        for axis in range(_AXES)
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
            f"motor {axis + 1}: its rest pose of {rest_deg:g} deg is outside of the range marked, "
            f"{low:.1f} to {high:.1f} deg",
            "mark the limits again, or correct servo.rest_deg",
        )
    return min(low, rest_deg), max(high, rest_deg)


def _line(axis: int, marked_us: Array) -> Pair:
    """Neutral pulse and pulse per 90 deg of one servo."""
    per_deg_us, neutral_us = np.polyfit(ANGLES_DEG, marked_us, 1)
    if abs(marked_us[1] - marked_us[2]) < _LEAST_SPAN_US:
        raise ConfigError(
            f"motor {axis + 1}: +45 and -45 deg were marked at nearly the same pulse",
            "move the motor with the arrow keys before pressing Enter",
        )
    off_deg = np.abs(marked_us - neutral_us - per_deg_us * np.array(ANGLES_DEG)) / abs(per_deg_us)
    if off_deg.max() > _STRAIGHT_DEG:
        raise ConfigError(
            f"motor {axis + 1}: the marks at -45, 0 and 45 deg miss a line by {off_deg.max():.1f} "
            "deg",
            "mark them again; a servo that still does so has slipped on its horn",
        )
    return float(neutral_us), float(90.0 * per_deg_us)


def _to_half_us(pulses_us: Sequence[float]) -> Pair:
    first, second = (round(2.0 * pulse) / 2.0 for pulse in pulses_us)
    return first, second


def _rounded(angles_deg: Sequence[float]) -> Pair:
    first, second = (round(float(angle), 1) for angle in angles_deg)
    return first, second
