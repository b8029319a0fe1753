"""Figures of merit of a run."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ccr_host.robot.reference import PATH_AXES

LATERAL = [PATH_AXES["y"], PATH_AXES["z"]]


@dataclass(frozen=True)
class ErrorFigures:
    """Of the error norm |f - f_desired| over the steps where the position was known."""

    mean_mm: float
    rmse_mm: float
    p95_mm: float
    max_mm: float
    mean_lateral_mm: float

    @classmethod
    def of(cls, errors_mm: NDArray[np.float64]) -> ErrorFigures | None:
        """Figures of error vectors (N, 3), rows with NaN left out; None if no row is left."""
        known = errors_mm[np.isfinite(errors_mm).all(axis=1)]
        if not len(known):
            return None
        norms = np.linalg.norm(known, axis=1)
        return cls(
            mean_mm=float(norms.mean()),
            rmse_mm=float(np.sqrt((norms**2).mean())),
            p95_mm=float(np.percentile(norms, 95)),
            max_mm=float(norms.max()),
            mean_lateral_mm=float(np.linalg.norm(known[:, LATERAL], axis=1).mean()),
        )

    def as_summary(self, prefix: str = "") -> dict[str, float]:
        """Keys of the JSON summary."""
        return {
            f"{prefix}mean_error_mm": self.mean_mm,
            f"{prefix}rmse_mm": self.rmse_mm,
            f"{prefix}p95_error_mm": self.p95_mm,
            f"{prefix}max_error_mm": self.max_mm,
            f"{prefix}mean_lateral_error_mm": self.mean_lateral_mm,
        }


def quantiles_us(durations_us: NDArray[np.float64]) -> dict[str, float | None]:
    """Median, 99th percentile and maximum; None where nothing was timed."""
    if not len(durations_us):
        return {"median": None, "p99": None, "max": None}
    return {
        "median": float(np.median(durations_us)),
        "p99": float(np.percentile(durations_us, 99)),
        "max": float(durations_us.max()),
    }
