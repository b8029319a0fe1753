"""A small nonlinear least-squares solver for a handful of unknowns."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

_ITERATIONS = 50
_DIFFERENCE = 1e-6
_CONVERGED = 1e-9
_DAMPING_START = 1e-3
_DAMPING_STEP = 10.0


@dataclass(frozen=True, eq=False)
class Minimum:
    """Where the sum of squares is least."""

    unknowns: Array
    residuals: Array
    jacobian: Array

    def cost(self) -> float:
        """The sum of squares."""
        return float(self.residuals @ self.residuals)

    def standard_deviations(self) -> Array:
        """Of the unknowns, if the residuals have unit variance."""
        return np.sqrt(np.diag(np.linalg.inv(self.jacobian.T @ self.jacobian)))


def minimise(
    residuals: Callable[[Array], Array],
    start: Array,
    *,
    jacobian: Callable[[Array], Array] | None = None,
    lower: Array | float = -np.inf,
    upper: Array | float = np.inf,
    converged: float = _CONVERGED,
) -> Minimum:
    """Levenberg and Marquardt's method; unknowns that press against a bound stay there.

    Args:
        residuals: of unknowns (n,), (m,).
        start: where to begin, within the bounds, (n,).
        jacobian: of the residuals, (m, n); by forward differences without one.
        lower: bounds, one for all or (n,).
        upper: bounds.
        converged: share of the sum of squares; a step that gains less is the last one.
    """
    slope = jacobian or _by_differences(residuals)
    unknowns, damping = start, _DAMPING_START
    now = residuals(unknowns)
    slopes = slope(unknowns)
    for _ in range(_ITERATIONS):
        downhill = -slopes.T @ now
        pressing = (unknowns <= lower) & (downhill < 0.0) | (unknowns >= upper) & (downhill > 0.0)
        free = np.flatnonzero(~pressing)
        normal = (slopes.T @ slopes)[np.ix_(free, free)]
        step = np.zeros_like(unknowns)
        step[free] = np.linalg.solve(normal + damping * np.diag(np.diag(normal)), downhill[free])
        trial = np.clip(unknowns + step, lower, upper)
        there = residuals(trial)
        if there @ there <= now @ now:
            gain = float(now @ now - there @ there)
            unknowns, now = trial, there
            slopes = slope(unknowns)
            damping /= _DAMPING_STEP
            if gain <= converged * float(now @ now):
                break
        else:
            damping *= _DAMPING_STEP
    return Minimum(unknowns, now, slopes)


def _by_differences(residuals: Callable[[Array], Array]) -> Callable[[Array], Array]:
    def jacobian(at: Array) -> Array:
        there = residuals(at)
        columns = [
            (residuals(at + step) - there) / _DIFFERENCE for step in _DIFFERENCE * np.eye(len(at))
        ]
        return np.stack(columns, axis=1)

    return jacobian
