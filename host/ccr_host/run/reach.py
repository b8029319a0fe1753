"""What of a path two motors can reach, in figures."""

from __future__ import annotations

from typing import Any

import numpy as np

from ccr_host.robot.reference import Reference


def reach_of(reference: Reference) -> dict[str, Any]:
    """Summary of reach: unreachable steps, unavoidable error, motor travel (deg for people)."""
    unavoidable_mm = reference.unavoidable_mm
    q_deg = np.degrees(reference.q_rad)
    worst = int(np.argmax(unavoidable_mm))
    return {
        "path": reference.name,
        "steps": len(reference.time_s),
        "unreachable_steps": reference.unreachable_steps,
        "floor_mean_error_mm": reference.floor_mean_mm,
        "floor_max_error_mm": float(unavoidable_mm[worst]),
        "floor_max_at_s": float(reference.time_s[worst]),
        "motor_range_deg": np.stack([q_deg.min(axis=0), q_deg.max(axis=0)], axis=1).tolist(),
        "motor_step_max_deg": np.abs(np.diff(q_deg, axis=0)).max(axis=0).tolist(),
    }
