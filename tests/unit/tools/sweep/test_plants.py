"""How ``bench.plants`` judges the rows of a sweep."""

from __future__ import annotations

import pytest

from bench.plants import FEEDFORWARD, change_overs, errors_of, print_table, repeatability_mm
from ccr_host.tools.sweep.job import Row
from ccr_host.tools.sweep.plan import GivenTwin, SweepPlan


def row_of(index: int, controller: str, error_mm: float | None, fault: str = "") -> Row:
    return {
        "index": index,
        "path": ("ellipse", "star")[index % 2],
        "controller": controller,
        "true_mean_error_mm": error_mm,
        "twin_floor_mean_error_mm": None if error_mm is None else 0.5,
        "diverged": False,
        "fault": fault,
    }


def rows_of(adaptive_mm: list[float | None], other_mm: list[float | None]) -> list[Row]:
    rows = [row_of(index, "adaptive", error) for index, error in enumerate(adaptive_mm)]
    return rows + [row_of(index, "mpc", error) for index, error in enumerate(other_mm)]


def test_wins_are_counted_on_plants_where_both_have_a_result(
    capsys: pytest.CaptureFixture[str],
) -> None:
    rows = rows_of([1.0, 2.0, 1.0, None], [2.0, 1.0, None, 1.0])
    print_table("random, 1 Hz", rows, {}, ["adaptive", "mpc"])
    (mpc,) = [line for line in capsys.readouterr().out.splitlines() if line.startswith("| mpc")]
    assert mpc.endswith("| 1 of 2 |")


def test_a_run_that_ended_early_has_no_error_but_its_plant_has_a_floor() -> None:
    errors = errors_of([row_of(0, "mpc", 0.1, "tracker lost")], {})
    assert not errors["mpc"]
    assert errors["floor"] == {0: 0.5}


def test_feedforward_has_the_best_of_its_previews_on_each_plant() -> None:
    rows = [row_of(0, name, error) for name, error in zip(FEEDFORWARD, (3, 1, 2, 4), strict=True)]
    rows += [row_of(1, name, error) for name, error in zip(FEEDFORWARD, (3, 4, 5, 2), strict=True)]
    assert errors_of(rows, {})["feedforward"] == {0: 1, 1: 2}


def test_a_shipped_robot_has_a_column_for_each_path(capsys: pytest.CaptureFixture[str]) -> None:
    print_table("dirty, 1 Hz", rows_of([1.0, 2.0], [3.0, 4.0]), {0: 0.25}, ["adaptive", "mpc"])
    lines = capsys.readouterr().out.splitlines()
    assert "| ellipse | star |" in lines[1]
    assert any(line.startswith("| adaptive | 2 | 1.00 | 2.00 | 0 |") for line in lines)
    assert any(line.startswith("| repeatability | 1 | 0.25 |") for line in lines)


@pytest.mark.long
def test_friction_costs_repeatability(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("bench.plants.HOME_PATTERNS", ("single",))

    def repeats_to(*overrides: str) -> float:
        plan = SweepPlan(1, ("ellipse",), "ideal", overrides, twins=(GivenTwin({}),))
        (job,) = plan.jobs([0], [(1.0, "mpc")])
        found_mm = repeatability_mm(job)
        assert found_mm is not None
        return found_mm

    assert repeats_to("twin.friction=0.4") > 3.0 * repeats_to()


@pytest.mark.long
def test_change_overs_of_adaptive_are_counted_on_a_path_to_both_sides() -> None:
    compiled = ("control.solver=compiled",)
    plan = SweepPlan(1, ("8shape",), "ideal", compiled, twins=(GivenTwin({}),))
    (job,) = plan.jobs([0], [(1.0, "mpc")])
    counts = change_overs(job)
    assert list(counts) == ["1"]
    jumps, again = counts["1"]
    assert 2 <= jumps <= 12
    assert again == 0
