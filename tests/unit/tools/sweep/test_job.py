import numpy as np
import pytest

from ccr_host.core.errors import CcrError
from ccr_host.run import twin_floor
from ccr_host.run.execute import execute_quietly
from ccr_host.run.summary import summarise
from ccr_host.tools.sweep.job import LOST_MM, cpu_seconds_of, run_job
from ccr_host.tools.sweep.plan import GivenTwin, SweepPlan


@pytest.mark.long
def test_a_row_matches_the_same_run_alone(plan):
    (job,) = plan.jobs([0], [(2.0, "mpc")])
    (row,) = run_job(job)
    alone = summarise(execute_quietly(job.options((2.0, "mpc"))))
    for key in ("mean_error_mm", "true_mean_error_mm", "true_p95_error_mm", "steps"):
        assert row[key] == alone[key]
    assert row["ratio"] == row["true_mean_error_mm"] / row["twin_floor_mean_error_mm"]


@pytest.mark.long
def test_where_the_time_went_adds_up(plan):
    (job,) = plan.jobs([0], [(2.0, "mpc")])
    (row,) = run_job(job)
    parts = {part: row[f"cpu_{part}_s"] for part in ("twin", "emulator", "controller", "rest")}
    assert min(parts["twin"], parts["emulator"], parts["controller"]) > 0
    assert sum(parts.values()) == pytest.approx(row["cpu_s"])


@pytest.mark.long
def test_timing_ends_with_the_run(plan):
    (job,) = plan.jobs([0], [(2.0, "open-loop")])
    options = job.options((2.0, "open-loop"))
    with cpu_seconds_of(options) as spent:
        execute_quietly(options)
    before = spent.parts
    execute_quietly(options)
    assert spent.parts == before


@pytest.mark.long
def test_a_run_that_ends_far_from_its_path_has_diverged(short_path, narrow):
    away = {"tracker.rotation_deg": [0.0, 120.0, 0.0]}
    plan = SweepPlan(1, (short_path,), overrides=narrow, twins=(GivenTwin({}), GivenTwin(away)))
    at_home, lost = (run_job(job)[0] for job in plan.jobs([0, 1], [(4.0, "mpc")]))
    assert not at_home["diverged"]
    assert at_home["end_error_mm"] < at_home["twin_floor_mean_error_mm"] + LOST_MM
    assert lost["diverged"]


@pytest.mark.long
def test_a_run_that_a_fault_ends_says_so_and_the_others_go_on(short_path, narrow):
    blind = {"tracker.latency_ms": 1000.0}
    plan = SweepPlan(1, (short_path,), overrides=narrow, twins=(GivenTwin(blind),))
    rows = run_job(plan.jobs([0], [(2.0, "mpc"), (2.0, "open-loop")])[0])
    assert [row["controller"] for row in rows] == ["mpc", "open-loop"]
    assert all("no markers" in row["fault"] for row in rows)
    assert rows[0]["ratio"] is None
    assert not rows[0]["diverged"]


@pytest.mark.long
def test_a_twin_that_has_no_rest_is_run_without_floor(plan, monkeypatch):
    def no_rest(*_: object, **__: object) -> None:
        raise CcrError("no rest pose")

    monkeypatch.setattr(twin_floor, "rests_along", no_rest)
    (row,) = run_job(plan.jobs([0], [(2.0, "open-loop")])[0])
    assert row["twin_floor_mean_error_mm"] is None
    assert np.isfinite(row["true_mean_error_mm"])


@pytest.mark.long
def test_a_twin_that_cannot_be_simulated_is_a_row_and_the_others_go_on(short_path):
    stiff = {"twin.bending_stiffness_nm_rad": [100.0, 100.0]}
    plan = SweepPlan(1, (short_path,), twins=(GivenTwin(stiff), GivenTwin({})))
    (row,) = run_job(plan.jobs([0], [(2.0, "open-loop")])[0])
    assert "time steps" in row["fault"]
