"""What is believed about the places of M2 and M3: a mean and a covariance, and their updates."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

M2_ROWS = slice(0, 3)
M3_ROWS = slice(3, 6)


@dataclass(frozen=True, eq=False)
class Belief:
    """State of a motion model."""

    mean: Array
    """(n,)."""
    covariance: Array
    """(n, n)."""
    agitation: Array
    """(2,): how far the pose has lately been from what was expected, decaying; model's units."""


@dataclass(frozen=True, eq=False)
class Expectation:
    """Where M2 and M3 are expected relative to M1: six coordinates."""

    mean_mm: Array
    """(6,): M2, M3."""
    covariance_mm2: Array
    """(6, 6), without the camera's noise."""
    jacobian: Array
    """(6, n): of the expectation over the state."""


def expectation(belief: Belief, mean_mm: Array, jacobian: Array) -> Expectation:
    """Carry the covariance of the state over to the markers."""
    return Expectation(mean_mm, jacobian @ belief.covariance @ jacobian.T, jacobian)


def corrected(
    belief: Belief, expected: Expectation, rows: Array, seen_mm: Array, noise_mm: float
) -> tuple[Array, Array]:
    """Kalman's correction by some of the six coordinates; new mean and covariance.

    Args:
        belief: before.
        expected: of that belief.
        rows: which coordinates were seen.
        seen_mm: these coordinates.
        noise_mm: of the camera, per coordinate.
    """
    jacobian = expected.jacobian[rows]
    innovation_covariance = expected.covariance_mm2[np.ix_(rows, rows)] + noise_mm**2 * np.eye(
        len(rows)
    )
    gain = np.linalg.solve(innovation_covariance, jacobian @ belief.covariance).T
    mean = belief.mean + gain @ (seen_mm - expected.mean_mm[rows])
    covariance = belief.covariance - gain @ innovation_covariance @ gain.T
    return mean, 0.5 * (covariance + covariance.T)
