"""What a run leaves behind when disk, folder or start fail."""

from __future__ import annotations

import json
import resource
import signal
import subprocess
from functools import partial
from pathlib import Path

import pytest

from ccr_host.link.messages import Disarm, Stop
from ccr_host.record.log import topics
from ccr_host.record.log.reader import RunRecording
from tests.patience import PATIENCE_S
from tests.system.conftest import (
    AT_ONCE,
    IN_REAL_TIME,
    PAPERS,
    CcrHost,
    Ended,
    acting,
    events,
    logged,
    messages_in,
    wait_until_following,
)
from tests.system.warm_start import PipedProgram

REALTIME = (*PAPERS, *IN_REAL_TIME, "--no-open", "--realtime", "--rate", "5", "--out", "kept")
REMOVE = "shutil.rmtree('kept')"


def with_small_files(folder: Path, kilobytes: int, *words: str) -> Ended:
    """The command where no file can grow further, as on a disk that becomes full."""
    limit = partial(resource.setrlimit, resource.RLIMIT_FSIZE, (1024 * kilobytes,) * 2)
    program = PipedProgram(words, folder, drawn=True, prepared=limit)
    out, err = program.communicate(timeout=PATIENCE_S)
    return Ended(program.wait(), out, err)


def lines_of(ended: Ended) -> list[str]:
    assert "Traceback" not in ended.err
    return [line for line in ended.err.splitlines() if line.startswith("ccr-host: ")]


def test_a_full_disk_costs_what_no_longer_fits_and_nothing_else(
    tmp_path: Path, short_path: str
) -> None:
    words = ("track", short_path, *PAPERS, *AT_ONCE, "--no-open", "--out", "kept", "--json")
    ended = with_small_files(tmp_path, 40, *words)
    assert ended.status == 0, ended.err
    assert ended.summary["steps"] == 6
    (line,) = lines_of(ended)
    assert "figure.png" in line
    assert "messages lost" in line
    assert "run.json" not in line
    folder = tmp_path / "kept"
    assert {file.name for file in folder.iterdir()} >= {"run.json", "log_0000.mcap"}
    assert not (folder / "figure.png").exists()
    assert all(file.stat().st_size for file in folder.iterdir())
    assert logged(folder, topics.SETUP), "what fits can be read"


@pytest.mark.parametrize(
    "words", [("workspace", "8shape"), ("compare", "--path", "short.csv", *PAPERS)]
)
def test_tables_are_printed_though_their_files_do_not_fit(
    tmp_path: Path, short_path: str, words: tuple[str, ...]
) -> None:
    ended = with_small_files(tmp_path, 0, *words, "--json", "--out", short_path + ".kept")
    assert ended.status == 2, "nothing fits: refused before anything is run"
    ended = with_small_files(tmp_path, 4, *words, "--json")
    assert ended.status == 0, ended.err
    assert ended.summary
    (line,) = lines_of(ended)
    assert "figure.png" in line


def test_an_export_that_does_not_fit_leaves_no_half_tables(tmp_path: Path, short_path: str) -> None:
    host = CcrHost(tmp_path)
    assert host("track", short_path, *PAPERS, *AT_ONCE, "--no-open", "--out", "kept").status == 0
    for form in ("csv", "jsonl", "parquet", "mat", "rosbag2", "mcap"):
        ended = with_small_files(tmp_path, 8, "export", "kept", "--format", form)
        assert ended.status == 2, (form, ended.err)
        assert len(lines_of(ended)) == 1
    assert with_small_files(tmp_path, 8, "report", "kept").status == 2
    assert not [file for file in (tmp_path / "kept").iterdir() if file.is_dir()]
    assert not list((tmp_path / "kept").glob("*.html"))


def test_a_folder_that_is_removed_in_mid_run_is_made_again(
    ccr_host: CcrHost, short_path: str
) -> None:
    folder = ccr_host.folder / "kept"
    removing = acting(ccr_host.folder, REMOVE, 13)
    ended = ccr_host("track", short_path, *REALTIME, *removing)
    assert ended.status == 0, ended.err
    assert "mean, acting" in ended.out.lower()
    assert json.loads((folder / "run.json").read_text())["metrics"]["steps"] == 26
    assert RunRecording(folder).end.is_complete
    assert len(logged(folder, topics.STEP)) == 26


def test_a_folder_that_is_replaced_in_mid_run_costs_its_files_alone(
    ccr_host: CcrHost, short_path: str
) -> None:
    folder = ccr_host.folder / "kept"
    replacing = acting(ccr_host.folder, f"{REMOVE}; open('kept', 'x').write('mine')", 13)
    ended = ccr_host("track", short_path, *REALTIME, *replacing, "--json")
    assert ended.status == 0, ended.err
    assert ended.summary["steps"] == 26
    (line,) = lines_of(ended)
    assert "run.json" in line
    assert "messages lost" in line
    assert folder.read_text() == "mine"


@pytest.mark.parametrize(
    ("words", "status"),
    [
        (("track", "spiral"), 2),
        (("track", "8shape", "--controller", "mcp"), 2),
        (("track", "8shape", "--device", "tcp://127.0.0.1:1"), 3),
        (("track", "8shape", "--tracker", "ndi+tcp://127.0.0.1:1"), 3),
        (("track", "8shape", "--tracker", "replay:gone"), 2),
        (("track", "short.csv", *PAPERS, "--set", "tracker.latency_ms=1000"), 3),
        (("compare", "--controller", "mcp"), 2),
        (("compare", "--path", "short.csv", *PAPERS, "--device", "tcp://127.0.0.1:1"), 3),
        (("workspace", "spiral"), 2),
        (("sweep", "--path", "spiral"), 2),
        (("sweep", "--scheduler", "here"), 2),
        (("export", "gone"), 2),
        (("report", "gone"), 2),
    ],
)
@pytest.mark.usefixtures("short_path")
def test_a_start_that_fails_leaves_no_folder(
    ccr_host: CcrHost, words: tuple[str, ...], status: int
) -> None:
    ended = ccr_host(*words)
    assert ended.status == status, ended.err
    assert len(lines_of(ended)) == 1
    assert [file.name for file in ccr_host.folder.iterdir()] == ["short.csv"]
    assert "saved in" not in ended.out


def test_a_start_that_fails_leaves_the_earlier_run_in_its_folder(
    ccr_host: CcrHost, short_path: str
) -> None:
    words = ("track", short_path, *PAPERS, *AT_ONCE, "--no-open", "--out", "kept")
    assert ccr_host(*words).status == 0
    before = {file: file.read_bytes() for file in (ccr_host.folder / "kept").iterdir()}
    assert ccr_host(*words, "--device", "tcp://127.0.0.1:1").status == 3
    assert before == {file: file.read_bytes() for file in (ccr_host.folder / "kept").iterdir()}


def test_a_run_that_ended_early_says_how_far_it_came(ccr_host: CcrHost, short_path: str) -> None:
    sets = ("polaris_faults.unplugged_s=[[2, 99]]", "control.coast_s=1", "control.hold_s=0.5")
    lost = ("--tracker", "ndi-emulator:", *(word for key in sets for word in ("--set", key)))
    words = ("track", short_path, *PAPERS, "--no-open", "--rate", "2", *lost)
    ended = ccr_host(*words, "--json", "--out", "kept")
    assert ended.status == 3, ended.err
    steps = ended.summary["steps"]
    assert 0 < steps < ended.summary["planned_steps"] == 11
    assert f"only {steps} of 11 steps" in ended.err
    compared = ccr_host("compare", "--path", short_path, *PAPERS, "--rate", "2", *lost)
    assert compared.status == 3
    assert f"{steps} of 11 steps" in " ".join(compared.out.split())


def test_repeated_ctrl_c_still_leaves_the_robot_safe_and_the_results_saved(
    ccr_host: CcrHost,
) -> None:
    folder = ccr_host.folder / "kept"
    process = ccr_host.start("track", "8shape", *REALTIME, drawn=True)
    wait_until_following(folder, process)
    process.send_signal(signal.SIGINT)
    while process.poll() is None:
        try:
            process.wait(0.05)
        except subprocess.TimeoutExpired:
            process.send_signal(signal.SIGINT)
    _, err = process.communicate()
    assert process.returncode == 130, err
    assert "Traceback" not in err
    assert any(isinstance(message, Disarm | Stop) for message in messages_in(folder, topics.SENT))
    assert events(folder)[-1] == "interrupted"
    metrics = json.loads((folder / "run.json").read_text())["metrics"]
    assert 0 < metrics["steps"] < metrics["planned_steps"] == 400
