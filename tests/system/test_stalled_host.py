"""A host that is stopped in mid-run, as by Ctrl-Z or a computer that sleeps."""

import json
import signal
import time
from pathlib import Path

import numpy as np
import pytest

from ccr_host.link.messages import SetTarget, State, Telemetry
from ccr_host.record.log import topics
from ccr_host.record.log.reader import RunRecording
from tests.patience import PATIENCE_S, becomes_true
from tests.system.conftest import AT_ONCE, CcrHost, acting, events, logged, messages_in

RATE_HZ = 20
STOPS_AT_STEP = 10
BURST = 4
"""More targets at once are a burst: one a period, one that fed the board, one late one."""


def is_stopped(pid: int) -> bool:
    return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] == "T"


def stopped_run(ccr_host: CcrHost, device: str, path: str, seconds: float):
    """Status, errors, summary and times of the targets of a run that was stopped for a while."""
    stops = acting(ccr_host.folder, "os.kill(os.getpid(), signal.SIGSTOP)", STOPS_AT_STEP)
    process = ccr_host.start(
        *("track", path, *stops, "--rate", str(RATE_HZ), "--realtime", *AT_ONCE),
        *("--device", device, "--no-open", "--out", "kept", "--json"),
    )
    assert becomes_true(lambda: process.poll() is not None or is_stopped(process.pid))
    time.sleep(seconds)
    process.send_signal(signal.SIGCONT)
    out, err = process.communicate(timeout=PATIENCE_S)
    return process.returncode, err, json.loads(out), ccr_host.folder / "kept"


@pytest.mark.parametrize("device", ["emulator:", "emulator+pty:"])
def test_a_short_stop_skips_its_steps_counts_them_and_sends_no_burst(
    ccr_host: CcrHost, short_path: str, device: str
) -> None:
    status, err, summary, folder = stopped_run(ccr_host, device, short_path, 1.0)
    assert status == 0, err
    assert summary["steps"] == 5 * RATE_HZ + 1
    assert summary["skipped_steps"] >= 0.7 * RATE_HZ
    assert summary["missed_deadlines"] >= summary["skipped_steps"]
    assert summary["board_holds"] >= 1
    assert summary["board_relaxes"] == 0
    assert "skipped" in err
    assert any("steps skipped" in text for text in events(folder))
    assert any("the board holds the pose" in text for text in events(folder))
    sent = RunRecording(folder).messages(topics.SENT)
    sent_us = np.array([one.time_us for one in sent if one.content["name"] == SetTarget.NAME])
    in_a_period = np.searchsorted(sent_us, sent_us + 1e6 / RATE_HZ) - np.arange(len(sent_us))
    assert in_a_period.max() <= BURST
    skipped = [step for step in logged(folder, topics.STEP) if step["outcome"] == "skipped"]
    assert len(skipped) == summary["skipped_steps"]
    assert all(step["measured_mm"] is None and step["late"] for step in skipped)


@pytest.mark.parametrize("seconds", [3.0, 10.0])
@pytest.mark.parametrize("device", ["emulator:", "emulator+pty:"])
def test_a_stall_in_which_the_board_moves_the_robot_to_rest_ends_the_run_and_says_why(
    ccr_host: CcrHost, short_path: str, device: str, seconds: float
) -> None:
    status, err, summary, folder = stopped_run(ccr_host, device, short_path, seconds)
    assert status == 3
    last = err.strip().splitlines()[-1]
    assert "the host stalled" in last
    assert "line of sight" not in last
    assert summary["missed_deadlines"] >= 0.7 * RATE_HZ * min(seconds, 4.0)
    assert summary["board_relaxes"] == 1
    assert (folder / "figure.png").exists()
    reports = [m.report for m in messages_in(folder, topics.RECEIVED) if isinstance(m, Telemetry)]
    assert reports[-1].state in (State.DISARMED, State.FAULT)
    assert reports[-1].pulse_half_us == (0, 0)
