"""Where the ramp and the slew limit stand."""

from __future__ import annotations

Axes = tuple[int, int]


class Setpoint:
    """Commanded angle of both axes, 0.01 deg; moves only in control ticks."""

    def __init__(self, start_cdeg: Axes) -> None:
        self.cdeg = start_cdeg
        self._start_cdeg = start_cdeg
        self._target_cdeg = start_cdeg
        self._ramp_ticks = 0
        self._ticks_since_target = 0

    def aim_at(self, target_cdeg: Axes, ramp_ticks: int) -> None:
        """Go to a target in a straight line over `ramp_ticks`, from here (TGT-2)."""
        self._start_cdeg = self.cdeg
        self._target_cdeg = target_cdeg
        self._ramp_ticks = ramp_ticks
        self._ticks_since_target = 0

    def step_along_ramp(self, slew_cdeg: Axes) -> None:
        """One tick towards the target."""
        self._ticks_since_target += 1
        self.step_towards(
            (
                self._ramp(self._start_cdeg[0], self._target_cdeg[0]),
                self._ramp(self._start_cdeg[1], self._target_cdeg[1]),
            ),
            slew_cdeg,
        )

    def step_towards(self, goal_cdeg: Axes, slew_cdeg: Axes) -> None:
        """One tick straight towards `goal_cdeg`, at most by the slew."""
        self.cdeg = (
            _limited_step(self.cdeg[0], goal_cdeg[0], slew_cdeg[0]),
            _limited_step(self.cdeg[1], goal_cdeg[1], slew_cdeg[1]),
        )

    def clamp(self, least_cdeg: Axes, greatest_cdeg: Axes) -> None:
        """Move the remembered setpoint into new limits."""
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


def _limited_step(here: int, goal: int, limit: int) -> int:
    return here + min(max(goal - here, -limit), limit)


def _quotient_toward_zero(dividend: int, divisor: int) -> int:
    quotient = abs(dividend) // divisor
    return quotient if dividend >= 0 else -quotient
