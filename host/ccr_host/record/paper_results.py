"""What the paper measured (Section IV-B, Figs. 9, 12 and 15): mean of |f_m - f| in mm."""

from __future__ import annotations

from dataclasses import dataclass

from ccr_host.description.schema import Control, Description, load
from ccr_host.run.options import RunOptions
from ccr_host.sim.robot.plant import TWIN
from ccr_host.tracking.uri import parse_tracker_uri

PAPERS_ROBOT = "paper"
"""Shipped description of the robot that the paper measured."""
_PAPER_RATE_HZ = 1.0
_OF_THE_ROBOT = {"robot", "control"}
_OF_THE_TWIN = {"servo", "twin", "tracker", "polaris_faults"}


@dataclass(frozen=True)
class PaperResult:
    """One path of the paper's experiment."""

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
        None unless path, surface, controller, rate and robot are the paper's. Of a real robot only
        the geometry is known.
    """
    paper = PAPER_RESULTS.get(options.path)
    is_path = options.surface == "model" and options.laps == 1
    if paper is None or options.rate_hz != _PAPER_RATE_HZ or not is_path:
        return None
    figures = {"open-loop": paper.open_loop_mm, "mpc": paper.mpc_mm}
    return figures.get(options.controller) if _is_papers_robot(options) else None


def _is_papers_robot(options: RunOptions) -> bool:
    if options.plant != TWIN:
        return False
    is_simulated = parse_tracker_uri(options.tracker).is_simulated
    sections = _OF_THE_ROBOT | (_OF_THE_TWIN if is_simulated else set())
    given, papers = options.description(), load(PAPERS_ROBOT)
    return _kept(given, sections) == _kept(papers, sections)


def _kept(description: Description, sections: set[str]) -> dict[str, object]:
    """The sections, without the choice between two solvers of the same program."""
    control = description.control.model_copy(update={"solver": Control().solver})
    return description.model_copy(update={"control": control}).model_dump(include=sections)
