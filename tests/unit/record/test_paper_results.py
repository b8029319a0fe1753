"""The paper's figures stand beside the paper's experiment, and nowhere else."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from ccr_host.record.comparisons import paper_mean_mm
from ccr_host.run.options import RunOptions

PAPERS = RunOptions(path="8shape", controller="mpc", robot="paper")


def test_the_papers_own_experiment_has_its_mean() -> None:
    assert paper_mean_mm(PAPERS) == 7.5
    assert paper_mean_mm(replace(PAPERS, controller="open-loop")) == 21.3
    assert paper_mean_mm(replace(PAPERS, seed=7)) == 7.5
    assert paper_mean_mm(replace(PAPERS, overrides=("control.solver=compiled",))) == 7.5


@pytest.mark.parametrize(
    "changed",
    [
        {"controller": "adaptive"},
        {"controller": "pid-ik"},
        {"path": "mine.csv"},
        {"rate_hz": 20.0},
        {"laps": 3},
        {"surface": "robot"},
        {"robot": "hard"},
        {"robot": "default"},
        {"robot": None},
        {"overrides": ("twin.payload_g=5",)},
        {"overrides": ("robot.segment_lengths_mm=[60, 40]",)},
        {"overrides": ("control.horizon=10",)},
        {"overrides": ("tracker.rotation_deg=3",)},
    ],
)
def test_any_other_experiment_has_none(changed: dict) -> None:
    assert paper_mean_mm(replace(PAPERS, **changed)) is None


def test_a_real_robot_of_the_papers_geometry_is_compared_with_it(tmp_path: Path) -> None:
    description = tmp_path / "mine.toml"
    description.write_text('name = "mine"\n[servo]\nneutral_pulse_us = [1480, 1522]\n')
    real = replace(PAPERS, robot=str(description), tracker="ndi:/dev/ttyUSB0")
    as_printed = replace(real, overrides=("control.bending=commanded",))
    assert paper_mean_mm(as_printed) == 7.5
    assert paper_mean_mm(real) is None, "the paper's MPC does not estimate the bending"
    assert paper_mean_mm(replace(real, controller="open-loop")) == 21.3
    description.write_text("[robot]\nsegment_lengths_mm = [80, 60]\n")
    assert paper_mean_mm(as_printed) is None
