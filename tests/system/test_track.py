import json
from pathlib import Path

import pytest

from ccr_host.record.log import topics
from tests.system.conftest import PAPERS, CcrHost, Ended, logged, write_short_path

SUMMARY_KEYS = {
    "path", "controller", "rate_hz", "steps", "planned_steps", "seed", "device", "tracker",
    "mean_error_mm", "rmse_mm", "p95_error_mm", "max_error_mm", "mean_lateral_error_mm",
    "true_mean_error_mm", "true_rmse_mm", "true_p95_error_mm", "true_max_error_mm",
    "true_mean_lateral_error_mm", "floor_mean_error_mm", "twin_floor_mean_error_mm",
    "surface",
    "unreachable_steps", "laps", "open", "solve_us", "missed_deadlines", "tracker_lost_steps",
    "jumped_pictures", "coasted_steps", "held_steps", "skipped_steps", "clamped_commands",
    "board_holds", "board_relaxes", "link", "wall_s", "faults",
}  # fmt: skip


@pytest.mark.parametrize(
    ("path", "steps", "closed_mm", "open_mm"),
    [("ellipse", 80, 7.5, 22.4), ("8shape", 80, 7.5, 21.3), ("star", 100, 7.0, 18.5)],
)
def test_open_loop_and_mpc_have_the_papers_errors_on_the_papers_robot(
    ccr_host: CcrHost, path: str, steps: int, closed_mm: float, open_mm: float
) -> None:
    ended = ccr_host("track", path, "--robot", "paper", "--controller", "mpc", "--json")
    assert ended.status == 0, ended.err
    summary = ended.summary
    assert summary["steps"] == steps
    assert summary["mean_error_mm"] == pytest.approx(closed_mm, rel=0.1)
    assert summary["open"]["mean_error_mm"] == pytest.approx(open_mm, rel=0.05)
    assert summary["link"]["crc_errors"] == 0
    assert summary["missed_deadlines"] == summary["tracker_lost_steps"] == 0
    assert summary["faults"] == []


@pytest.fixture(scope="module")
def tracked(tmp_path_factory: pytest.TempPathFactory) -> tuple[Ended, Path]:
    """The output of a short run, and its folder."""
    ccr_host = CcrHost(tmp_path_factory.mktemp("tracked"))
    path = write_short_path(ccr_host.folder)
    ended = ccr_host("track", path, *PAPERS, "--json", "--set", "twin.payload_g=2", drawn=True)
    assert ended.status == 0, ended.err
    (folder,) = (ccr_host.folder / "runs").iterdir()
    return ended, folder


def test_the_summary_has_the_keys_that_others_script_against(tracked: tuple[Ended, Path]) -> None:
    summary = tracked[0].summary
    assert set(summary) == SUMMARY_KEYS
    assert set(summary["solve_us"]) == {"median", "p99", "max"}
    assert set(summary["link"]) == {
        "sent", "received", "crc_errors", "retries", "rtt_us_median", "rtt_us_p99",
    }  # fmt: skip
    assert set(summary["open"]) == {k for k in SUMMARY_KEYS if k.endswith("_mm")} - {
        "floor_mean_error_mm",
        "twin_floor_mean_error_mm",
    }


def test_equal_seeds_give_equal_results_and_logs(ccr_host: CcrHost, short_path: str) -> None:
    def run(seed: int, folder: str) -> tuple[dict, bytes, bytes]:
        words = ("--seed", str(seed), "--no-open", "--out", folder, "--json")
        summary = ccr_host("track", short_path, *PAPERS, *words).summary
        for timing in ("solve_us", "wall_s"):
            del summary[timing]
        out = ccr_host.folder / folder
        return summary, (out / "run.json").read_bytes(), (out / "log_0000.mcap").read_bytes()

    first, again, other = run(7, "a"), run(7, "b"), run(8, "c")
    assert first == again
    assert first[0]["mean_error_mm"] != other[0]["mean_error_mm"]


def test_a_run_leaves_configuration_log_and_figure(tracked: tuple[Ended, Path]) -> None:
    ended, folder = tracked
    assert f"saved in runs/{folder.name}/" in ended.err
    run = json.loads((folder / "run.json").read_text())
    assert run["description"]["twin"]["payload_g"] == 2
    assert run["versions"]["ccr_host"]
    assert run["metrics"]["steps"] == 6
    assert len(logged(folder, topics.STEP)) == 6
    assert (folder / "figure.png").read_bytes().startswith(b"\x89PNG")


def test_json_is_alone_on_standard_output(tracked: tuple[Ended, Path]) -> None:
    ended, _ = tracked
    assert json.loads(ended.out)
    assert "tip error" in ended.err, "the table goes to standard error"


def test_every_step_records_what_the_board_was_sent(tracked: tuple[Ended, Path]) -> None:
    steps = logged(tracked[1], topics.STEP)
    assert all(step["outcome"] == "solved" for step in steps)
    assert all(len(step["q_rad"]) == 2 for step in steps)


def test_a_weaker_camera_shows_in_the_summary(ccr_host: CcrHost, short_path: str) -> None:
    words = ("track", short_path, *PAPERS, "--rate", "10", "--json", "--no-open")
    summary = ccr_host(*words, "--set", "tracker.dropout=0.9").summary
    assert summary["tracker_lost_steps"] > 0


def test_a_runs_folder_is_named_for_path_and_controller(tracked: tuple[Ended, Path]) -> None:
    assert tracked[1].name.endswith("-short-mpc")


def test_a_tracker_too_slow_to_be_fresh_is_a_fault_before_anything_is_armed(
    ccr_host: CcrHost, short_path: str
) -> None:
    ended = ccr_host(
        "track", short_path, *PAPERS, "--no-open", "--json", "--out", "kept",
        "--set", "tracker.latency_ms=1000",
    )  # fmt: skip
    assert ended.status == 3
    assert ended.summary["steps"] == 0
    assert "stale_after_ms" in ended.summary["faults"][0]
    assert "no markers" in ended.summary["faults"][0]
    assert not (ccr_host.folder / "kept").exists(), "nothing was armed"


def test_each_lap_is_judged_by_itself(ccr_host: CcrHost) -> None:
    loop = "t_s,y_mm,z_mm\n0,0,50\n2,4,50\n4,4,46\n6,0,46\n8,0,50\n"
    (ccr_host.folder / "loop.csv").write_text(loop)
    summary = ccr_host("track", "loop.csv", "--laps", "3", *PAPERS, "--no-open", "--json").summary
    of_laps = [lap["true_mean_error_mm"] for lap in summary["laps"]]
    assert summary["steps"] == 24
    assert len(of_laps) == 3
    assert summary["true_mean_error_mm"] == pytest.approx(sum(of_laps) / 3)


def test_laps_of_an_open_path_are_refused(ccr_host: CcrHost) -> None:
    (ccr_host.folder / "open.csv").write_text("t_s,y_mm,z_mm\n0,0,40\n20,20,40\n")
    ended = ccr_host("track", "open.csv", "--laps", "2")
    assert ended.status == 2
    assert "mm from its start" in ended.err
    assert "Traceback" not in ended.err


def test_adaptive_learns_a_load_that_came_after_its_tour_from_lap_to_lap(ccr_host: CcrHost) -> None:
    """Over seeds 1 to 4 the third lap's error is 13 % below the first one's, within 1 %.

    Without a load there is little to learn after the tour: 4 %, within 5 %, which shows nothing.
    """
    late_load = ("--set", "twin.payload_g=10", "--set", "twin.payload_start_s=1")
    words = ("--laps", "3", "--no-open", "--json", "--set", "control.solver=compiled")
    laps = ccr_host("track", "star", *late_load, *words).summary["laps"]
    assert laps[2]["true_mean_error_mm"] < 0.95 * laps[0]["true_mean_error_mm"]
