"""Damped least squares: the inverse of a Jacobian that may lose rank."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]


def damped_inverse(jacobian: FloatArray, damping: float) -> FloatArray:
    """(J'J + damping^2 I)^-1 J', (2, 3) of a (3, 2) Jacobian; finite for any damping above 0."""
    gram = jacobian.T @ jacobian + damping**2 * np.eye(2)
    return np.asarray(np.linalg.solve(gram, jacobian.T))
