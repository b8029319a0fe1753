from tests.system.conftest import CcrHost


def test_compare_puts_every_controller_beside_the_open_loop(
    ccr_host: CcrHost, short_path: str
) -> None:
    ended = ccr_host("compare", "--path", short_path, "--json", "--out", "kept", drawn=True)
    assert ended.status == 0, ended.err
    runs = {run["controller"]: run for run in ended.summary["runs"]}
    assert {"open-loop", "mpc"} <= set(runs)
    assert runs["mpc"]["mean_error_mm"] < runs["open-loop"]["mean_error_mm"]
    assert ended.summary["paper"]["8shape"] == {"open_loop_mm": 21.3, "mpc_mm": 7.5}
    assert (ccr_host.folder / "kept" / "figure.png").read_bytes().startswith(b"\x89PNG")
    assert "mpc" in ended.err


def test_a_compared_run_is_the_same_run_as_tracked_alone(
    ccr_host: CcrHost, short_path: str
) -> None:
    words = ("--controller", "mpc", "--seed", "3", "--json")
    (compared,) = ccr_host("compare", "--path", short_path, *words).summary["runs"]
    tracked = ccr_host("track", short_path, "--no-open", *words).summary
    for timing in ("solve_us", "wall_s"):
        del compared[timing], tracked[timing]
    assert compared == tracked


def test_workspace_shows_what_is_out_of_reach(ccr_host: CcrHost) -> None:
    reach = ccr_host("workspace", "ellipse", "--json", "--out", "kept").summary
    assert (reach["steps"], reach["unreachable_steps"]) == (80, 22)
    assert 3.4 < reach["floor_max_error_mm"] < 3.6
    assert (ccr_host.folder / "kept" / "figure.png").exists()
    within = ccr_host("workspace", "8shape", "--json").summary
    assert within["unreachable_steps"] == 0
