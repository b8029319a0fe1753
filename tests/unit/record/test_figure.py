"""What the figures of runs show."""

from __future__ import annotations

import warnings
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from matplotlib.axes import Axes

from ccr_host.record.figure import (
    PlottedRun,
    run_figure,
    write_comparison_figure,
    write_run_figure,
    write_workspace_figure,
)
from ccr_host.record.figure_style import LOST, controller_colours
from ccr_host.run.execute import execute_quietly, reference_of, workspace_of
from ccr_host.run.options import RunOptions


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> PlottedRun:
    path = tmp_path_factory.mktemp("path") / "short.csv"
    path.write_text("t_s,y_mm,z_mm\n0,0,30\n9,10,35\n")
    options = RunOptions(path=str(path), controller="mpc")
    result = execute_quietly(options)
    return PlottedRun(options, result.reference, result.records)


def repeated(run: PlottedRun, count: int) -> PlottedRun:
    """The run with more steps."""
    records = [
        replace(run.records[i % len(run.records)], step=i, time_s=float(i)) for i in range(count)
    ]
    return replace(run, records=records)


def on_hardware(run: PlottedRun) -> PlottedRun:
    return replace(run, records=[replace(record, true_mm=None) for record in run.records])


def error_axes(*runs: PlottedRun) -> Axes:
    return run_figure(runs).axes[2]


def legend_of(*runs: PlottedRun) -> list[str]:
    return [text.get_text() for text in run_figure(runs).legends[0].get_texts()]


@pytest.mark.long
def test_every_figure_is_kept_as_png_pdf_and_svg(tmp_path: Path, run: PlottedRun) -> None:
    write_run_figure(tmp_path / "run.png", [run])
    write_comparison_figure(tmp_path / "compare.png", [[run], [run]])
    write_workspace_figure(tmp_path / "reach.png", run.reference, workspace_of(run.options))
    for name in ("run", "compare", "reach"):
        assert (tmp_path / f"{name}.png").read_bytes().startswith(b"\x89PNG")
        assert (tmp_path / f"{name}.pdf").read_bytes().startswith(b"%PDF")
        assert "<svg" in (tmp_path / f"{name}.svg").read_text()


@pytest.mark.long
def test_the_same_run_gives_the_same_files(tmp_path: Path, run: PlottedRun) -> None:
    for name in ("a.png", "b.png"):
        write_run_figure(tmp_path / name, [run])
    for suffix in (".png", ".pdf", ".svg"):
        first, second = ((tmp_path / name).with_suffix(suffix).read_bytes() for name in "ab")
        assert first == second


def test_axes_are_labelled_for_a_paper(run: PlottedRun) -> None:
    labels = [axes.get_ylabel() for axes in run_figure([run]).axes]
    assert labels == ["z (mm)", "z (mm)", "tip error (mm)"]


def test_a_path_in_space_is_shown_from_a_third_side(run: PlottedRun) -> None:
    in_space = replace(run, reference=replace(run.reference, in_space=True))
    seen = [(axes.get_xlabel(), axes.get_ylabel()) for axes in run_figure([in_space]).axes[:3]]
    along = "x, along the robot (mm)"
    assert seen == [("y (mm)", "z (mm)"), (along, "z (mm)"), ("y (mm)", along)]


def test_a_controller_has_one_colour_whatever_stands_beside_it(run: PlottedRun) -> None:
    own = controller_colours(["mpc"])["mpc"]
    assert controller_colours(["my.py:Mine", "adaptive", "mpc"])["mpc"] == own
    first = run_figure([replace(run, options=run.options.with_controller("adaptive")), run])
    assert own in {line.get_color() for line in first.axes[0].lines}
    names = ["open-loop", "mpc", "adaptive", "pid-ik", "broyden", "kalman-jacobian", "mpc-offset"]
    colours = controller_colours([*names, "a.py:A", "b.py:B"])
    assert len(set(colours.values())) == len(names) + 2


def test_several_runs_of_one_controller_differ_in_their_dashes(run: PlottedRun) -> None:
    legend = run_figure([replace(run, label="a"), replace(run, label="b")]).legends[0]
    names = [text.get_text() for text in legend.get_texts()]
    first, second = (legend.legend_handles[names.index(name)] for name in "ab")
    assert first.get_color() == second.get_color()
    assert first.get_linestyle() != second.get_linestyle()


@pytest.mark.parametrize(("points", "marked"), [(200, True), (201, False)])
def test_many_points_are_a_line_without_markers(run: PlottedRun, points: int, marked: bool) -> None:
    axes = run_figure([repeated(run, points)]).axes
    markers = {line.get_marker() for plane in axes[:2] for line in plane.lines}
    assert bool(markers - {"None", ""}) == marked


@pytest.mark.parametrize(("rate_hz", "marked"), [(1.0, True), (5.0, False)])
def test_many_points_out_of_reach_are_a_line_too(rate_hz: float, marked: bool) -> None:
    options = RunOptions(path="ellipse", rate_hz=rate_hz)
    reference = reference_of(options)
    axes = run_figure([PlottedRun(options, reference, [])]).axes[0]
    assert ("x" in {line.get_marker() for line in axes.lines}) == marked


def test_the_true_tip_is_drawn_where_the_robot_is_simulated(run: PlottedRun) -> None:
    assert "full: true tip of the simulated robot" in legend_of(run)
    drawn = [line.get_xydata() for line in run_figure([run]).axes[0].lines]
    true_yz = np.array([record.true_mm for record in run.records])[:, [0, 2]]
    assert any(xy.shape == true_yz.shape and np.allclose(xy, true_yz) for xy in drawn)
    assert not any("true" in text for text in legend_of(on_hardware(run)))


def test_spans_without_markers_are_shaded(run: PlottedRun) -> None:
    lost = [
        replace(record, measured_mm=None, measured_age_us=None)
        if record.step in (2, 3, 4, 7)
        else record
        for record in run.records
    ]
    shaded = error_axes(replace(run, records=lost)).patches
    assert [(patch.get_x(), patch.get_width()) for patch in shaded] == [(1.5, 3.0), (6.5, 1.0)]
    seen = replace(run, records=lost)
    assert "markers lost" in legend_of(seen)
    open_loop = replace(seen, options=run.options.with_controller("open-loop"))
    assert len(error_axes(seen, open_loop).patches) == 2, "it does not look anyway"
    assert {"a: markers lost", "b: markers lost"} <= {
        *legend_of(replace(seen, label="a"), replace(seen, label="b"))
    }
    assert not error_axes(run).patches
    assert LOST not in controller_colours([]).values()


def test_the_papers_means_stand_beside_its_own_experiment_alone(run: PlottedRun) -> None:
    of_paper = RunOptions(path="8shape", controller="mpc", robot="paper")
    assert "paper's robot, mean of mpc" in legend_of(replace(run, options=of_paper))
    for other in (
        replace(of_paper, controller="adaptive"),
        replace(of_paper, robot="hard"),
        replace(of_paper, rate_hz=5.0),
    ):
        assert not any("paper" in text for text in legend_of(replace(run, options=other)))


@pytest.mark.long
@pytest.mark.parametrize(
    "name", ["cost $5 $x", "_private", "two\nlines", "x" * 250, "\udce9t\udce9", "経路"]
)
def test_a_name_from_outside_is_shown_as_it_is(tmp_path: Path, run: PlottedRun, name: str) -> None:
    named = replace(
        run, reference=replace(run.reference, name=name), options=run.options.with_controller(name)
    )
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        write_run_figure(tmp_path / "figure.png", [named])
        write_comparison_figure(tmp_path / "both.png", [[named]])
    assert len(legend_of(named)) == 4


@pytest.mark.long
def test_one_step_alone_can_be_drawn(tmp_path: Path, run: PlottedRun) -> None:
    one = replace(run.reference, **{
        name: getattr(run.reference, name)[:1]
        for name in ("time_s", "target_mm", "q_rad", "unavoidable_mm")
    })  # fmt: skip
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        write_run_figure(
            tmp_path / "figure.png", [replace(run, reference=one, records=run.records[:1])]
        )
