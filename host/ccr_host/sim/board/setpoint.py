"""The commanded angles, with ramp, slew limit and acceleration limit, and their pulse widths."""

from __future__ import annotations

from operator import add

from ccr_host.link.messages import PULSE_CEILING_HALF_US, PULSE_FLOOR_HALF_US, Calibration

Axes = tuple[int, ...]
"""One integer for each axis."""


class Setpoint:
    """Commanded angles of all axes, 0.01 deg; changes only in control ticks."""

    def __init__(self, start_cdeg: Axes) -> None:
        self.cdeg = start_cdeg
        self._start_cdeg = start_cdeg
        self._target_cdeg = start_cdeg
        self._ramp_ticks = 0
        self._ticks_since_target = 0
        self._step_cdeg: Axes = (0,) * len(start_cdeg)

    def aim_at(self, target_cdeg: Axes, ramp_ticks: int) -> None:
        """Start a linear ramp from the current setpoint to a target over `ramp_ticks` (TGT-2)."""
        self._start_cdeg = self.cdeg
        self._target_cdeg = target_cdeg
        self._ramp_ticks = ramp_ticks
        self._ticks_since_target = 0

    def step_along_ramp(self, slew_cdeg: Axes, acceleration_cdeg: Axes) -> None:
        """Move one tick along the ramp."""
        self._ticks_since_target += 1
        goal = tuple(map(self._ramp, self._start_cdeg, self._target_cdeg))
        self.step_towards(goal, slew_cdeg, acceleration_cdeg)

    def step_towards(self, goal_cdeg: Axes, slew_cdeg: Axes, acceleration_cdeg: Axes) -> None:
        """Move one tick towards `goal_cdeg` within the limits; acceleration 0 is unlimited."""
        steps = map(_next_step, goal_cdeg, self.cdeg, self._step_cdeg, slew_cdeg, acceleration_cdeg)
        self._move(tuple(steps), acceleration_cdeg)

    def brake(self, acceleration_cdeg: Axes) -> None:
        """Decelerate for one tick (ACC-1)."""
        steps = map(_shorter_step, self._step_cdeg, acceleration_cdeg)
        self._move(tuple(steps), acceleration_cdeg)

    def stand(self) -> None:
        """Set the rate to zero, as without pulses."""
        self._step_cdeg = (0,) * len(self.cdeg)

    @property
    def is_moving(self) -> bool:
        """Whether the last tick moved an axis that has an acceleration limit."""
        return any(self._step_cdeg)

    def _move(self, steps: Axes, acceleration_cdeg: Axes) -> None:
        """Move by the steps, of which those without an acceleration limit are not remembered."""
        self.cdeg = tuple(map(add, self.cdeg, steps))
        limited = zip(steps, acceleration_cdeg, strict=True)
        self._step_cdeg = tuple(step if acceleration else 0 for step, acceleration in limited)

    def clamp(self, least_cdeg: Axes, greatest_cdeg: Axes) -> None:
        """Clamp the setpoint to new limits."""
        self.cdeg = clamped(self.cdeg, least_cdeg, greatest_cdeg)

    def _ramp(self, start: int, target: int) -> int:
        if self._ticks_since_target >= self._ramp_ticks:
            return target
        return start + _quotient_toward_zero(
            (target - start) * self._ticks_since_target, self._ramp_ticks
        )


def clamped(angles: Axes, least: Axes, greatest: Axes) -> Axes:
    """Each axis clamped to its limits."""
    return tuple(map(min, map(max, angles, least), greatest))


def _next_step(goal: int, angle: int, last_step: int, slew: int, acceleration: int) -> int:
    if acceleration:
        return _accelerated_step(goal - angle, last_step, slew, acceleration)
    return min(max(goal - angle, -slew), slew)


def _shorter_step(last_step: int, acceleration: int) -> int:
    return last_step - min(max(last_step, -acceleration), acceleration) if acceleration else 0


def _accelerated_step(way: int, last_step: int, slew: int, acceleration: int) -> int:
    """Step of ACC-2, found by bisection."""
    if way < 0:
        return -_accelerated_step(-way, -last_step, slew, acceleration)
    shortest, longest = 0, slew
    while shortest < longest:
        tried = (shortest + longest + 1) // 2
        if _stopping_distance(tried, acceleration) <= way:
            shortest = tried
        else:
            longest = tried - 1
    return min(max(shortest, last_step - acceleration), last_step + acceleration)


def _stopping_distance(step: int, acceleration: int) -> int:
    """Sum of step + (step - acceleration) + ..., down to 0."""
    terms = -(-step // acceleration)
    return terms * step - acceleration * terms * (terms - 1) // 2


def _quotient_toward_zero(dividend: int, divisor: int) -> int:
    quotient = abs(dividend) // divisor
    return quotient if dividend >= 0 else -quotient


_REFERENCE_CDEG = 9000


def pulse_half_us(calibration: Calibration, axis: int, angle_cdeg: int) -> int:
    """Pulse width of one axis, in 0.5 us."""
    pulse = _unclamped_half_us(calibration, axis, angle_cdeg)
    pulse = max(pulse, calibration.pulse_min_half_us[axis], PULSE_FLOOR_HALF_US)
    return min(pulse, calibration.pulse_max_half_us[axis], PULSE_CEILING_HALF_US)


def is_saturated(calibration: Calibration, axis: int, angle_cdeg: int) -> bool:
    """Whether the pulse limits clamp the pulse of this angle."""
    pulse = _unclamped_half_us(calibration, axis, angle_cdeg)
    return pulse != pulse_half_us(calibration, axis, angle_cdeg)


def _unclamped_half_us(calibration: Calibration, axis: int, angle_cdeg: int) -> int:
    change = _round_half_away(angle_cdeg * calibration.per_90_deg_half_us[axis], _REFERENCE_CDEG)
    return calibration.neutral_half_us[axis] + change


def _round_half_away(dividend: int, divisor: int) -> int:
    quotient = (2 * abs(dividend) + divisor) // (2 * divisor)
    return quotient if dividend >= 0 else -quotient
