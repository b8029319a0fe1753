"""The reason that is given for a measured error unlike the true one is the right one."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from ccr_host.control.base import Outcome
from ccr_host.record.comparisons import why_measured_differs
from ccr_host.run.observer import StepRecord

RNG = np.random.default_rng(1)
TIPS_MM = np.array((0.0, -90.0, 0.0)) + RNG.uniform(-25, 25, (40, 3))


def run(see: Callable[[np.ndarray], np.ndarray]) -> list[StepRecord]:
    return [
        StepRecord(
            step=step, end_us=step, time_s=float(step), target_mm=tip_mm + 0.1, q_rad=np.zeros(2),
            outcome=Outcome.SOLVED, detail="", predicted_mm=np.zeros((0, 3)), solve_us=0.0,
            late=False, measured_mm=see(tip_mm), measured_age_us=0, true_mm=tip_mm,
        )
        for step, tip_mm in enumerate(TIPS_MM)
    ]  # fmt: skip


def test_an_honest_camera_needs_no_word() -> None:
    assert why_measured_differs(run(lambda tip: tip + RNG.normal(0, 0.1, 3))) is None
    assert why_measured_differs([]) is None
    *others, last = run(lambda tip: tip + RNG.normal(0, 0.1, 3))
    skipped = replace(last, measured_mm=None, true_mm=None)
    assert why_measured_differs([*others, skipped]) is None


@pytest.mark.parametrize("turn_deg", [(3.0, 0.0, 0.0), (0.0, 0.0, -8.0), (2.0, 2.0, 2.0)])
def test_a_turned_camera_is_found(turn_deg: tuple[float, float, float]) -> None:
    turn = Rotation.from_rotvec(turn_deg, degrees=True).as_matrix()
    why = why_measured_differs(run(lambda tip: turn @ tip + RNG.normal(0, 0.1, 3)))
    assert why is not None
    assert f"turned by {np.linalg.norm(turn_deg):.0f} deg" in why


def test_noise_is_not_taken_for_a_turn() -> None:
    why = why_measured_differs(run(lambda tip: tip + RNG.normal(0, 2.0, 3)))
    assert why is not None
    assert "noise" in why


def test_steps_that_were_not_measured_are_counted() -> None:
    records = run(lambda tip: tip)
    far = [
        replace(record, true_mm=record.true_mm + 20.0, measured_mm=None)
        if record.step < 15 and record.true_mm is not None
        else record
        for record in records
    ]
    assert why_measured_differs(far) == "15 of 40 steps were not measured"


def test_a_real_robot_has_no_known_truth() -> None:
    turn = Rotation.from_rotvec((5.0, 0.0, 0.0), degrees=True).as_matrix()
    real = [replace(record, true_mm=None) for record in run(lambda tip: turn @ tip)]
    assert why_measured_differs(real) is None
