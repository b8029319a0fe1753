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

    def standard_deviations(self) -> Array:
        """Of the unknowns, if the residuals have unit variance."""
        return np.sqrt(np.diag(np.linalg.inv(self.jacobian.T @ self.jacobian)))


def minimise(residuals: Callable[[Array], Array], start: Array) -> Minimum:
    """Levenberg and Marquardt's method with forward differences."""
    unknowns, damping = start, _DAMPING_START
    now = residuals(unknowns)
    jacobian = _jacobian(residuals, unknowns, now)
    for _ in range(_ITERATIONS):
        normal = jacobian.T @ jacobian
        step = -np.linalg.solve(normal + damping * np.diag(np.diag(normal)), jacobian.T @ now)
        there = residuals(unknowns + step)
        if there @ there <= now @ now:
            gain = float(now @ now - there @ there)
            unknowns, now = unknowns + step, there
            jacobian = _jacobian(residuals, unknowns, now)
            damping /= _DAMPING_STEP
            if gain <= _CONVERGED * float(now @ now):
                break
        else:
            damping *= _DAMPING_STEP
    return Minimum(unknowns, now, jacobian)


def _jacobian(residuals: Callable[[Array], Array], at: Array, there: Array) -> Array:
    columns = [
        (residuals(at + step) - there) / _DIFFERENCE for step in _DIFFERENCE * np.eye(len(at))
    ]
    return np.stack(columns, axis=1)
