"""What one control step leaves behind."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ccr_host.control.base import Outcome

Vector = NDArray[np.float64]


@dataclass(frozen=True)
class StepRecord:
    """One control period, judged at its end: the command of step i aims at f_i.

    ``measured_mm`` and ``true_mm`` are f = M3 - M1 (3,) at the end of the period; None where the
    tracker has lost the markers, or where nobody knows the truth (hardware).
    """

    step: int
    end_us: int
    """Of the period, on the run's clock."""
    time_s: float
    """Of the step, on the path's clock."""
    target_mm: Vector
    q_rad: Vector
    outcome: Outcome
    detail: str
    predicted_mm: Vector
    solve_us: float
    late: bool
    measured_mm: Vector | None
    measured_age_us: int | None
    true_mm: Vector | None


def measured_errors_mm(records: Sequence[StepRecord]) -> Vector:
    """f_m - f, (N, 3); NaN rows where nothing was measured."""
    return _errors(records, [record.measured_mm for record in records])


def true_errors_mm(records: Sequence[StepRecord]) -> Vector | None:
    """True tip minus desired one, (N, 3); NaN rows of skipped steps, None without a twin."""
    positions = [record.true_mm for record in records]
    is_real = bool(positions) and all(position is None for position in positions)
    return None if is_real else _errors(records, positions)


def _errors(records: Sequence[StepRecord], positions: Sequence[Vector | None]) -> Vector:
    unknown = np.full(3, np.nan)
    rows = [
        (unknown if position is None else position) - record.target_mm
        for record, position in zip(records, positions, strict=True)
    ]
    return np.array(rows).reshape(-1, 3)
