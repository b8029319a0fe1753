"""The commanded angles, with ramp, slew limit and acceleration limit."""

from __future__ import annotations

Axes = tuple[int, int]


class Setpoint:
    """Commanded angle of both axes, 0.01 deg; changes only in control ticks."""

    def __init__(self, start_cdeg: Axes) -> None:
        self.cdeg = start_cdeg
        self._start_cdeg = start_cdeg
        self._target_cdeg = start_cdeg
        self._ramp_ticks = 0
        self._ticks_since_target = 0
        self._step_cdeg: Axes = (0, 0)

    def aim_at(self, target_cdeg: Axes, ramp_ticks: int) -> None:
        """Start a linear ramp from the current setpoint to a target over `ramp_ticks` (TGT-2)."""
        self._start_cdeg = self.cdeg
        self._target_cdeg = target_cdeg
        self._ramp_ticks = ramp_ticks
        self._ticks_since_target = 0

    def step_along_ramp(self, slew_cdeg: Axes, acceleration_cdeg: Axes) -> None:
        """Move one tick along the ramp."""
        self._ticks_since_target += 1
        goal = (
            self._ramp(self._start_cdeg[0], self._target_cdeg[0]),
            self._ramp(self._start_cdeg[1], self._target_cdeg[1]),
        )
        self.step_towards(goal, slew_cdeg, acceleration_cdeg)

    def step_towards(self, goal_cdeg: Axes, slew_cdeg: Axes, acceleration_cdeg: Axes) -> None:
        """Move one tick towards `goal_cdeg` within the limits; acceleration 0 is unlimited."""
        self._move(
            *(
                _limited_step(goal_cdeg[axis] - self.cdeg[axis], slew_cdeg[axis])
                if acceleration_cdeg[axis] == 0
                else _accelerated_step(
                    goal_cdeg[axis] - self.cdeg[axis],
                    self._step_cdeg[axis],
                    slew_cdeg[axis],
                    acceleration_cdeg[axis],
                )
                for axis in (0, 1)
            )
        )
        self._forget_steps_without_limit(acceleration_cdeg)

    def brake(self, acceleration_cdeg: Axes) -> None:
        """Decelerate for one tick (ACC-1)."""
        self._move(
            *(
                0 if most == 0 else step - _limited_step(step, most)
                for step, most in zip(self._step_cdeg, acceleration_cdeg, strict=True)
            )
        )

    def stand(self) -> None:
        """Set the rate to zero, as without pulses."""
        self._step_cdeg = (0, 0)

    @property
    def is_moving(self) -> bool:
        """Whether the last tick moved an axis that has an acceleration limit."""
        return self._step_cdeg != (0, 0)

    def _move(self, first: int, second: int) -> None:
        self._step_cdeg = (first, second)
        self.cdeg = (self.cdeg[0] + first, self.cdeg[1] + second)

    def _forget_steps_without_limit(self, acceleration_cdeg: Axes) -> None:
        first, second = self._step_cdeg
        self._step_cdeg = (
            first if acceleration_cdeg[0] else 0,
            second if acceleration_cdeg[1] else 0,
        )

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
    return (
        min(max(angles[0], least[0]), greatest[0]),
        min(max(angles[1], least[1]), greatest[1]),
    )


def _limited_step(way: int, limit: int) -> int:
    return min(max(way, -limit), limit)


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
