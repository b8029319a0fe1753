"""What the paper measured (Section IV-B, Figs. 9, 12 and 15): mean of |f_m - f| in mm."""

from __future__ import annotations

from dataclasses import dataclass


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
