"""Runs whose helper processes are killed, as the kernel does when memory runs out."""

from __future__ import annotations

import json
import os
import signal
import time

import pytest

from tests.patience import PATIENCE_S, becomes_true
from tests.system.conftest import PAPERS, CcrHost, acting, children
from tests.system.test_sweep import NARROW
from tests.system.warm_start import PipedProgram


def kill_helpers(process: PipedProgram, times: int) -> set[int]:
    """Kill the given number of processes that it starts, each as soon as it exists."""
    killed: set[int] = set()
    deadline = time.monotonic() + PATIENCE_S
    while len(killed) < times and process.poll() is None and time.monotonic() < deadline:
        for child in children(process.pid):
            if child not in killed:
                os.kill(child, signal.SIGKILL)
                killed.add(child)
        time.sleep(0.02)
    return killed


def test_a_run_without_its_open_loop_says_why_and_is_done(
    ccr_host: CcrHost, short_path: str
) -> None:
    process = ccr_host.start("track", short_path, *PAPERS, "--out", "kept", "--json")
    assert kill_helpers(process, 1)
    out, err = process.communicate(timeout=PATIENCE_S)
    assert process.returncode == 0, err
    assert json.loads(out)["open"] is None
    (line,) = [line for line in err.splitlines() if line.startswith("ccr-host: ")]
    assert "no comparison with the open loop" in line
    assert "SIGKILL" in line
    assert json.loads((ccr_host.folder / "kept" / "run.json").read_text())["metrics"]["steps"] == 6


def test_a_comparison_repeats_what_was_killed(ccr_host: CcrHost, short_path: str) -> None:
    words = ("--path", short_path, "--controller", "mpc", "--controller", "open-loop", "--json")
    process = ccr_host.start("compare", *words)
    kill_helpers(process, 2)
    out, err = process.communicate(timeout=PATIENCE_S)
    assert process.returncode == 0, err
    assert [run["controller"] for run in json.loads(out)["runs"]] == ["mpc", "open-loop"]


def test_a_comparison_names_the_run_that_is_missing_and_keeps_the_others(
    ccr_host: CcrHost, short_path: str
) -> None:
    words = ("--path", short_path, "--controller", "mpc")
    process = ccr_host.start("compare", *words)
    kill_helpers(process, 100)
    _, err = process.communicate(timeout=PATIENCE_S)
    assert process.returncode == 3
    assert err.strip().splitlines()[-1].startswith("ccr-host: error: ")
    assert "with mpc" in err
    assert "SIGKILL" in err
    assert not (ccr_host.folder / "runs").exists()


def test_ctrl_c_ends_a_comparison_with_what_is_there(ccr_host: CcrHost, short_path: str) -> None:
    reached = ccr_host.folder / "reached"
    waits = acting(ccr_host.folder, f"pathlib.Path({str(reached)!r}).touch(); time.sleep(600)", 20)
    paths = ("--path", short_path, "--path", "8shape")
    process = ccr_host.start("compare", *paths, *waits, "--out", "kept")
    assert becomes_true(reached.exists)
    process.send_signal(signal.SIGINT)
    _, err = process.communicate(timeout=PATIENCE_S)
    assert process.returncode == 130
    assert err.endswith("ccr-host: interrupted\n")
    if (ccr_host.folder / "kept").exists():
        assert json.loads((ccr_host.folder / "kept" / "compare.json").read_text())["runs"]


def test_twins_whose_workers_are_killed_are_missing_until_the_command_is_repeated(
    ccr_host: CcrHost, short_path: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("DASK_DISTRIBUTED__SCHEDULER__ALLOWED_FAILURES", "0")
    short_of_memory = ccr_host.folder / "short of memory"
    short_of_memory.touch()
    killed = f"pathlib.Path({str(short_of_memory)!r}).exists() and os.kill(os.getpid(), 9)"
    controller = acting(ccr_host.folder, killed, 3)
    words = ("sweep", "--path", short_path, *controller, "--rate", "2", "--runs", "1", *NARROW)
    words = (*words, "--workers", "1", "--out", "kept", "--json")
    ended = ccr_host(*words)
    assert ended.status == 3, ended.err
    assert "missing" in ended.err.strip().splitlines()[-1]
    assert "Traceback" not in ended.err
    assert not (ccr_host.folder / "kept").exists()
    short_of_memory.unlink()
    again = ccr_host(*words)
    assert again.status == 0, again.err
    assert again.summary["runs"] == 1
