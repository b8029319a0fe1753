"""Runs whose helper processes are killed, as the kernel does when memory runs out."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import time
from contextlib import suppress
from pathlib import Path

import pytest

from tests.system.conftest import PAPERS, CcrHost, children

AT_WORK_S = 2.2
"""Processor time after which a worker of a sweep is certainly computing its twin."""


def cpu_s(process: int) -> float:
    """Processor time so far; 0 once it has ended."""
    with suppress(OSError):
        fields = Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()
        return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")
    return 0.0


def kill_helpers(process: subprocess.Popen[str], times: int) -> set[int]:
    """Kill the given number of processes that it starts, each as soon as it exists."""
    killed: set[int] = set()
    deadline = time.monotonic() + 60
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
    out, err = process.communicate(timeout=60)
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
    out, err = process.communicate(timeout=60)
    assert process.returncode == 0, err
    assert [run["controller"] for run in json.loads(out)["runs"]] == ["mpc", "open-loop"]


def test_a_comparison_names_the_run_that_is_missing_and_keeps_the_others(
    ccr_host: CcrHost, short_path: str
) -> None:
    words = ("--path", short_path, "--controller", "mpc")
    process = ccr_host.start("compare", *words)
    kill_helpers(process, 100)
    _, err = process.communicate(timeout=60)
    assert process.returncode == 3
    assert err.strip().splitlines()[-1].startswith("ccr-host: error: ")
    assert "with mpc" in err
    assert "SIGKILL" in err
    assert not (ccr_host.folder / "runs").exists()


def test_ctrl_c_ends_a_comparison_with_what_is_there(ccr_host: CcrHost, short_path: str) -> None:
    words = ("--path", short_path, "--path", "8shape", "--controller", "mpc", "--out", "kept")
    process = ccr_host.start("compare", *words, "--controller", "adaptive", "--rate", "20")
    time.sleep(5)
    process.send_signal(signal.SIGINT)
    _, err = process.communicate(timeout=60)
    assert process.returncode == 130
    assert err.endswith("ccr-host: interrupted\n")
    if (ccr_host.folder / "kept").exists():
        assert json.loads((ccr_host.folder / "kept" / "compare.json").read_text())["runs"]


def test_twins_whose_workers_are_killed_are_missing_until_the_command_is_repeated(
    ccr_host: CcrHost, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("DASK_DISTRIBUTED__SCHEDULER__ALLOWED_FAILURES", "0")
    words = ("--path", "8shape", "--controller", "mpc", "--rate", "1", "--runs", "1")
    words = ("sweep", *words, "--workers", "1", "--out", "kept")
    process = ccr_host.start(*words)
    deadline = time.monotonic() + 90
    while process.poll() is None and time.monotonic() < deadline:
        for worker in children(process.pid):
            if cpu_s(worker) > AT_WORK_S:
                os.kill(worker, signal.SIGKILL)
        time.sleep(0.05)
    _, err = process.communicate(timeout=60)
    assert process.returncode == 3, err
    assert "missing" in err.strip().splitlines()[-1]
    assert "Traceback" not in err
    assert not (ccr_host.folder / "kept").exists()
    again = ccr_host(*words, "--json")
    assert again.status == 0, again.err
    assert again.summary["runs"] == 1
