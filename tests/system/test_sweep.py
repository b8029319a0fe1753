"""Sweeps as a user runs them; narrow motor limits keep the static maps small."""

import json
import os
import shlex
import signal
import time
from pathlib import Path

import pyarrow.parquet as pq
import pytest

from tests.foreign_servers import foreign_server
from tests.system.conftest import CcrHost, children
from tests.system.test_bad_input import assert_one_clear_line
from tests.system.warm_start import PipedProgram

NARROW = (
    "--set", "servo.angle_min_deg=[-10, -50]", "--set", "servo.angle_max_deg=[35, 5]",
)  # fmt: skip


@pytest.fixture
def short_sweep(short_path: str) -> tuple[str, ...]:
    return ("sweep", "--path", short_path, "--controller", "mpc", "--rate", "2", *NARROW)


ROUNDING = 1e-11
"""OpenBLAS up to 0.3.29 (numpy before 2.4) rounds by where arrays lie in memory."""


def _rows(folder: Path) -> list[dict]:
    return pq.read_table(folder / "runs.parquet").to_pylist()


def _wait_for_a_part(sweep: PipedProgram, folder: Path) -> None:
    while not list(folder.glob("parts/*.parquet")):
        assert sweep.poll() is None, sweep.communicate()
        time.sleep(0.05)


def test_a_killed_sweep_continues_and_each_of_its_rows_can_be_repeated_alone(
    ccr_host: CcrHost, short_sweep: tuple[str, ...]
) -> None:
    words = (*short_sweep, "--runs", "2", "--workers", "1", "--out", "kept")
    killed = ccr_host.start(*words)
    _wait_for_a_part(killed, ccr_host.folder / "kept")
    killed.kill()
    killed.communicate()
    ended = ccr_host(*words, "--json", drawn=True)
    assert ended.status == 0, ended.err
    (group,) = ended.summary["groups"]
    rows = _rows(ccr_host.folder / "kept")
    assert [row["index"] for row in rows] == [0, 1]
    assert group["runs"] == 2
    assert group["ratio"]["max"] == max(row["ratio"] for row in rows)
    assert all(row["within_limits"] and not row["fault"] for row in rows)
    assert "worst twins of mpc at 2 Hz" in ended.err
    assert (ccr_host.folder / "kept" / "figure.png").read_bytes().startswith(b"\x89PNG")

    alone = ccr_host(*short_sweep, "--only", "0", "--only", "1", "--json")
    (repeated,) = alone.summary["groups"]
    assert repeated["runs"] == 2
    for figure in ("max", "median"):
        assert repeated["ratio"][figure] == pytest.approx(group["ratio"][figure], rel=ROUNDING)
    assert rows[1]["command"] in alone.err

    command = shlex.split(rows[1]["command"])
    tracked = ccr_host(*command[1:], "--no-open", "--json").summary
    for figure in ("true_mean_error_mm", "mean_error_mm", "twin_floor_mean_error_mm", "steps"):
        assert tracked[figure] == pytest.approx(rows[1][figure], rel=ROUNDING)


def test_ctrl_c_keeps_what_is_there(ccr_host: CcrHost, short_sweep: tuple[str, ...]) -> None:
    words = (*short_sweep, "--runs", "40", "--workers", "1", "--out", "kept")
    sweep = ccr_host.start(*words)
    _wait_for_a_part(sweep, ccr_host.folder / "kept")
    sweep.send_signal(signal.SIGINT)
    out, err = sweep.communicate()
    assert sweep.returncode == 130
    assert "Traceback" not in err
    assert "worst twins of mpc" in out
    kept = json.loads((ccr_host.folder / "kept" / "summary.json").read_text())
    assert 1 <= kept["groups"][0]["runs"] < 40


def test_the_death_of_a_worker_loses_nothing(
    ccr_host: CcrHost, short_sweep: tuple[str, ...]
) -> None:
    sweep = ccr_host.start(*short_sweep, "--runs", "2", "--workers", "1", "--out", "kept")
    _wait_for_a_part(sweep, ccr_host.folder / "kept")
    for worker in children(sweep.pid):
        os.kill(worker, signal.SIGKILL)
    out, err = sweep.communicate()
    assert sweep.returncode == 0, err
    assert [row["index"] for row in _rows(ccr_host.folder / "kept")] == [0, 1]
    assert "Traceback" not in out + err


@pytest.mark.parametrize(
    ("words", "named"),
    [
        (["--runs", "0"], ["--runs"]),
        (["--path", "spiral"], ["spiral", "ellipse"]),
        (["--controller", "pid9"], ["pid9", "mpc"]),
        (["--rate", "0"], ["rate"]),
        (["--twins", "gone.jsonl"], ["gone.jsonl"]),
        (["--out", "/proc/nowhere"], ["/proc/nowhere"]),
        (["--scheduler", "here"], ["here", "dask scheduler"]),
    ],
)
def test_a_word_that_makes_no_sense_gets_one_line(
    ccr_host: CcrHost, short_path: str, words: list[str], named: list[str]
) -> None:
    assert_one_clear_line(ccr_host("sweep", "--path", short_path, *words), 2, *named)


@pytest.mark.parametrize("kind", ["http", "random bytes", "echo", "hangs"])
def test_an_address_without_a_dask_scheduler_gets_one_line_within_seconds(
    ccr_host: CcrHost, short_path: str, kind: str
) -> None:
    with foreign_server(kind) as port:
        address = f"tcp://127.0.0.1:{port}"
        words = ("--path", short_path, "--runs", "1", "--scheduler", address)
        ended = ccr_host("sweep", *words, timeout_s=100)
    assert_one_clear_line(ended, 2, address, "no dask scheduler")
