import pytest

from ccr_host.record.figure_style import controller_colours
from ccr_host.tools.sweep.statistics import groups_of, worst_first, write_sweep_figure


def test_each_controller_and_rate_has_its_own_distribution(row):
    rows = [row(i, ratio=1.0 + i) for i in range(5)] + [row(i, 20.0, ratio=9.0) for i in range(2)]
    rows += [row(0, 20.0, "adaptive", ratio=1.1)]
    groups = {(g["rate_hz"], g["controller"]): g for g in groups_of(rows)}
    assert set(groups) == {(1.0, "mpc"), (20.0, "mpc"), (20.0, "adaptive")}
    slow = groups[1.0, "mpc"]
    assert slow["runs"] == 5
    assert slow["ratio"] == {"median": 3.0, "p95": pytest.approx(4.8), "max": 5.0}
    assert slow["excess_mm"]["median"] == pytest.approx(2.0)
    assert [worst["index"] for worst in slow["worst"]] == [4, 3, 2]


def test_what_went_wrong_is_counted(row):
    rows = [
        row(0), row(1, diverged=True, ratio=30.0), row(2, within_limits=False),
        row(3, fault="no markers", ratio=None),
    ]  # fmt: skip
    (group,) = groups_of(rows)
    wrong = [group[key] for key in ("diverged", "outside_limits", "ended_early")]
    assert wrong == [1, 1, 1]
    assert group["ratio"]["max"] == 30.0
    assert [worst["index"] for worst in group["worst"]] == [3, 1, 0]


def test_runs_without_figures_are_the_worst(row):
    ordered = worst_first([row(0, ratio=2.0), row(1, ratio=None, fault="gone"), row(2, ratio=5.0)])
    assert [r["index"] for r in ordered] == [1, 2, 0]


@pytest.mark.long
@pytest.mark.parametrize("ratio", [None, 1.5])
def test_the_figure_is_drawn_whatever_is_there(tmp_path, row, ratio):
    write_sweep_figure(tmp_path / "figure.png", [row(0, ratio=ratio)])
    assert (tmp_path / "figure.png").read_bytes().startswith(b"\x89PNG")
    assert (tmp_path / "figure.pdf").read_bytes().startswith(b"%PDF")
    assert "<svg" in (tmp_path / "figure.svg").read_text()


@pytest.mark.long
def test_the_figure_has_the_controllers_own_colours(tmp_path, row):
    write_sweep_figure(tmp_path / "figure.png", [row(0), row(0, controller="adaptive")])
    drawn = (tmp_path / "figure.svg").read_text()
    assert all(controller_colours([name])[name] in drawn for name in ("mpc", "adaptive"))


def test_twins_that_reach_the_whole_path_are_judged_by_their_excess(row):
    rows = [row(i, ratio=None) | {"true_mean_error_mm": float(i)} for i in range(3)]
    rows = [one | {"twin_floor_mean_error_mm": 0.0} for one in rows]
    (group,) = groups_of(rows)
    assert group["ratio"]["median"] is None
    assert group["excess_mm"]["median"] == 1.0
    assert [worst["index"] for worst in group["worst"]] == [2, 1, 0]
