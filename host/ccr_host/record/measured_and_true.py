"""Explains why measured and true tip of a simulated robot differ."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import scipy

from ccr_host.run.observer import StepRecord, Vector, measured_errors_mm, true_errors_mm

_MUCH_MM = 0.5
_MUCH = 0.15
"""Share of the greater of the two means."""
_FEWEST_STEPS = 5
"""Fewest steps from which a rotation can be estimated."""


def why_measured_differs(records: Sequence[StepRecord]) -> str | None:
    """The main reason why the mean measured and true errors differ substantially.

    Returns:
        None if they agree, or if the true error is unknown.
    """
    measured, truth = measured_errors_mm(records), true_errors_mm(records)
    if truth is None:
        return None
    known = np.isfinite(truth).all(axis=1)
    seen = known & np.isfinite(measured).all(axis=1)
    if np.count_nonzero(seen) < _FEWEST_STEPS:
        return None
    means_mm = [
        float(np.linalg.norm(errors, axis=1).mean()) for errors in (measured[seen], truth[known])
    ]
    if abs(means_mm[0] - means_mm[1]) < max(_MUCH_MM, _MUCH * max(means_mm)):
        return None
    targets = np.array([record.target_mm for record in records])[seen]
    turn, _ = scipy.spatial.transform.Rotation.align_vectors(
        targets + measured[seen], targets + truth[seen]
    )
    unturned_mm = turn.inv().apply(targets + measured[seen]) - (targets + truth[seen])
    off_mm, left_mm = _rms_mm(measured[seen] - truth[seen]), _rms_mm(unturned_mm)
    if left_mm < off_mm / 2:
        return (
            f"the camera stands turned by {np.degrees(turn.magnitude()):.0f} deg against the "
            "robot, so the measured error is that in the camera's frame; `ccr-host register` finds "
            "the turn"
        )
    lost = len(records) - np.count_nonzero(seen)
    if lost > len(records) / 10:
        return f"{lost} of {len(records)} steps were not measured"
    return f"noise, delay or misread markers put the measured tip {off_mm:.1f} mm (RMS) off"


def _rms_mm(vectors_mm: Vector) -> float:
    return float(np.sqrt((vectors_mm**2).sum(axis=1).mean()))
