"""``compare`` and ``workspace``, and the tables that the README has from them."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.system.conftest import CcrHost

ROOT = Path(__file__).parents[2]


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


COLUMNS = {
    "open loop": ("open-loop", "mean_error_mm"),
    "MPC": ("mpc", "mean_error_mm"),
    "`adaptive`": ("adaptive", "mean_error_mm"),
    "its true error": ("adaptive", "true_mean_error_mm"),
    "floor": ("adaptive", "twin_floor_mean_error_mm"),
}
PATHS = {"ellipse": "ellipse", "figure-8": "8shape", "star": "star"}


def tables_of_readme() -> dict[str, list[list[str]]]:
    """The cells of each table of results, heads first, by the words that follow `ccr-host`."""
    tables = {}
    for part in (ROOT / "README.md").read_text().split("\n`ccr-host compare")[1:]:
        rows = [line.strip("| ").split(" | ") for line in part.splitlines() if line[:1] == "|"]
        tables["compare" + part.split("`")[0]] = [rows[0], *rows[2 : 2 + len(PATHS)]]
    return tables


@pytest.mark.slow
@pytest.mark.parametrize("words", ["compare", "compare --robot paper"])
def test_the_readmes_tables_are_what_their_commands_print(ccr_host: CcrHost, words: str) -> None:
    heads, *rows = tables_of_readme()[words]
    ended = ccr_host(*words.split(), "--json")
    runs = {(run["path"], run["controller"]): run for run in ended.summary["runs"]}
    for path, *cells in rows:
        for head, cell in zip(heads[1:], cells, strict=True):
            if head in COLUMNS:
                controller, key = COLUMNS[head]
                last_digit = 10.0 ** -len(cell.partition(".")[2])
                assert float(cell) == pytest.approx(
                    runs[PATHS[path], controller][key], abs=1.5 * last_digit
                ), f"{path}, {head}"
