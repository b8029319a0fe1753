"""What a run is compared with: the paper's results, and the true tip of a simulated robot."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy

from ccr_host.control.open_loop import OpenLoop
from ccr_host.core.arrays import Array
from ccr_host.description.schema import Control, Description, load
from ccr_host.run.observer import StepRecord, measured_errors_mm, true_errors_mm
from ccr_host.run.options import RunOptions
from ccr_host.sim.robot.plant import TWIN
from ccr_host.tracking.uri import parse_tracker_uri

PAPERS_ROBOT = "paper"
"""Shipped description of the robot that the paper measured."""
_PAPER_RATE_HZ = 1.0
_OF_THE_TWIN = {"servo", "twin", "tracker", "polaris_faults"}


@dataclass(frozen=True)
class PaperResult:
    """Means of |f_m - f| along a path of the paper (Section IV-B, Figs. 9, 12 and 15)."""

    open_loop_mm: float
    mpc_mm: float


PAPER_RESULTS = {
    "ellipse": PaperResult(open_loop_mm=22.4, mpc_mm=7.5),
    "8shape": PaperResult(open_loop_mm=21.3, mpc_mm=7.5),
    "star": PaperResult(open_loop_mm=18.5, mpc_mm=7.0),
}


def paper_mean_mm(options: RunOptions) -> float | None:
    """Mean error of the same experiment in the paper, in mm.

    Returns:
        None unless path, surface, controller, rate and robot are the paper's; the MPC is that of
        `control.bending = "commanded"`. Of a real robot only the geometry is known.
    """
    paper = PAPER_RESULTS.get(options.path)
    is_path = options.surface == "model" and options.laps == 1
    if paper is None or options.rate_hz != _PAPER_RATE_HZ or not is_path:
        return None
    figures = {OpenLoop.name: paper.open_loop_mm, "mpc": paper.mpc_mm}
    return figures.get(options.controller) if _is_papers_robot(options) else None


def _is_papers_robot(options: RunOptions) -> bool:
    if options.plant != TWIN:
        return False
    sections = {"robot"}
    if options.controller != OpenLoop.name:
        sections.add("control")
    if parse_tracker_uri(options.tracker).is_simulated:
        sections |= _OF_THE_TWIN
    given, papers = options.description(), load(PAPERS_ROBOT)
    return _kept(given, sections) == _kept(papers, sections)


def _kept(description: Description, sections: set[str]) -> dict[str, object]:
    """The sections, without the choice between two solvers of the same program."""
    control = description.control.model_copy(update={"solver": Control().solver})
    return description.model_copy(update={"control": control}).model_dump(include=sections)


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


def _rms_mm(vectors_mm: Array) -> float:
    return float(np.sqrt((vectors_mm**2).sum(axis=1).mean()))
