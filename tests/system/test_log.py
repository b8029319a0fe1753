"""The log of a run from the user's point of view: after a kill, replayed, exported."""

import shutil
import signal
import time
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import pytest

from ccr_host.link.framing import decode_single_frame, encode_frame
from ccr_host.link.messages import Fault, SetTarget, State
from ccr_host.record.log import topics
from ccr_host.record.log.reader import LogMessage, RunRecording
from tests.system.board_tap import BoardTap
from tests.system.conftest import (
    PAPERS,
    PATIENCE_S,
    CcrHost,
    logged,
    wait_until_following,
    write_short_path,
)
from tests.system.test_emulate import served_uri
from tests.unit.record.replay.rewrite import rewritten

RELAX_AFTER = "link.relax_after_ms=300"


def test_a_killed_host_leaves_its_log_and_a_robot_that_comes_to_rest(ccr_host: CcrHost) -> None:
    board = ccr_host.start("emulate", "--tcp", "127.0.0.1:0")
    tap = BoardTap(served_uri(board))
    folder = ccr_host.folder / "killed"
    try:
        host = ccr_host.start(
            "track", "8shape", *PAPERS, "--device", tap.uri, "--rate", "5", "--no-open",
            "--realtime", "--out", str(folder), "--set", RELAX_AFTER,
        )  # fmt: skip
        wait_until_following(folder, host)
        time.sleep(2)
        assert tap.reports[-1].state is State.ACTIVE
        before, killed_s = len(tap.reports), time.monotonic()
        host.kill()
        host.communicate(timeout=PATIENCE_S)
        assert tap.wait_for(lambda report: report.fault is Fault.LINK_LOSS, timeout_s=PATIENCE_S)
    finally:
        board.send_signal(signal.SIGINT)
        board.communicate(timeout=PATIENCE_S)
    states = [report.state for report in tap.reports[before:]]
    in_order = [state for i, state in enumerate(states) if i == 0 or states[i - 1] != state]
    assert in_order == [State.ACTIVE, State.HOLD, State.RELAXING, State.FAULT]
    held = [report for report in tap.reports[before:] if report.state is State.HOLD]
    assert len({report.pulse_half_us for report in held}) == 1
    assert tap.reports[-1].pulse_half_us == (0, 0)

    recording = RunRecording(folder)
    assert not recording.end.is_complete
    sent = [bytes.fromhex(content["hex"]) for content in logged(folder, topics.SENT)]
    logged_frames = [decode_single_frame(data) for data in sent]
    due = [frame for arrived_s, frame in tap.from_host if arrived_s < killed_s - 1.0]
    assert logged_frames[: len(due)] == due, "all up to the last second"
    replayed = ccr_host("replay", str(folder))
    assert replayed.status == 0, replayed.err
    assert "never closed" in replayed.out


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> Path:
    ccr_host = CcrHost(tmp_path_factory.mktemp("recorded"))
    path = write_short_path(ccr_host.folder)
    assert ccr_host("track", path, *PAPERS, "--no-open", "--out", "kept").status == 0
    return ccr_host.folder / "kept"


@pytest.fixture
def run_folder(ccr_host: CcrHost, recorded: Path) -> Path:
    """Copy of a run in the folder "kept"."""
    return Path(shutil.copytree(recorded, ccr_host.folder / "kept"))


def test_replay_says_that_all_is_equal_or_where_it_is_not(
    ccr_host: CcrHost, run_folder: Path
) -> None:
    equal = ccr_host("replay", "kept", "--json")
    assert equal.status == 0, equal.err
    assert equal.summary["equal"] is True
    assert equal.summary["steps"] == 6
    assert equal.summary["frames"] == len(logged(run_folder, topics.SENT))
    (ccr_host.folder / "tampered").mkdir()
    *_, fifth, _ = RunRecording(run_folder).messages(topics.STEP)
    change = partial(_turned_targets, fifth.time_us)
    rewritten(run_folder, ccr_host.folder / "tampered", change)
    different = ccr_host("replay", "tampered", "--json")
    assert different.status == 3
    assert different.summary["equal"] is False
    assert different.summary["difference"]["steps_done"] == 5
    assert "recorded SetTarget" in different.err
    assert "now SetTarget" in different.err
    assert len(different.err.splitlines()) == 1


def _turned_targets(since_us: int, message: LogMessage) -> dict[str, Any]:
    content = message.content
    if message.topic != topics.SENT.name or content["name"] != SetTarget.NAME:
        return content
    frame = decode_single_frame(bytes.fromhex(content["hex"]))
    assert frame is not None
    target = SetTarget.unpack(frame.payload)
    if message.time_us < since_us:
        return content
    turned = replace(target, target_cdeg=(target.target_cdeg[0] + 1, target.target_cdeg[1]))
    data = encode_frame(frame.id, frame.sequence, turned.pack())
    return {**content, "hex": data.hex()}


def test_a_run_of_another_version_is_named(ccr_host: CcrHost, run_folder: Path) -> None:
    def age(message: LogMessage) -> dict[str, Any]:
        content = message.content
        if message.topic == topics.SETUP.name:
            return {**content, "versions": {**content["versions"], "ccr_host": "0.0.9"}}
        return content

    (ccr_host.folder / "older").mkdir()
    rewritten(run_folder, ccr_host.folder / "older", age)
    ended = ccr_host("replay", "older")
    assert ended.status == 0
    assert "written by other versions: ccr_host 0.0.9" in ended.out


def test_export_writes_tables_beside_the_log(ccr_host: CcrHost, run_folder: Path) -> None:
    ended = ccr_host("export", "kept", "--json")
    assert ended.status == 0, ended.err
    assert ended.summary[str(Path("kept/tables/steps.csv"))] == 6
    lines = (run_folder / "tables" / "steps.csv").read_text().splitlines()
    assert len(lines) == 7
    assert lines[0].startswith("time_us,step,time_s,")


def test_replay_and_export_reject_what_is_not_a_run(ccr_host: CcrHost) -> None:
    for command in ("replay", "export"):
        ended = ccr_host(command, "missing")
        assert ended.status == 2
        assert ended.err == (
            "ccr-host: error: recording missing: No such file or directory; "
            "give the folder of a run, or one of its files\n"
        )
