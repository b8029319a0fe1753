import signal
import subprocess
import time
from pathlib import Path

import pytest

from ccr_host.link.messages import Disarm, SetTarget, State, Stop, Telemetry
from tests.system.conftest import CcrHost, log_lines, messages_in


def wait_until_following(folder: Path, process: subprocess.Popen[str]) -> None:
    deadline = time.monotonic() + 30
    while process.poll() is None and time.monotonic() < deadline:
        log = folder / "log.jsonl"
        if log.exists() and '"following the path"' in log.read_text():
            return
        time.sleep(0.05)
    pytest.fail(f"the run did not start: {process.communicate()}")


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_an_interrupted_run_disarms_the_robot_first_and_keeps_its_log(
    ccr_host: CcrHost, number: signal.Signals
) -> None:
    process = ccr_host.start("track", "8shape", "--realtime", "--rate", "5", "--out", "kept")
    folder = ccr_host.folder / "kept"
    wait_until_following(folder, process)
    process.send_signal(number)
    _, err = process.communicate(timeout=20)
    assert process.returncode == 130
    assert err.endswith("ccr-host: interrupted\n")
    assert "Traceback" not in err
    sent = messages_in(folder, "sent")
    last_target = max(i for i, message in enumerate(sent) if isinstance(message, SetTarget))
    assert any(isinstance(message, Disarm | Stop) for message in sent[last_target:])
    reports = [m.report for m in messages_in(folder, "received") if isinstance(m, Telemetry)]
    assert reports[-1].state in (State.DISARMED, State.STOPPED)
    assert reports[-1].pulse_half_us == (0, 0), "shown at the pins, not only by the state"
    assert log_lines(folder)[-1] == {
        "kind": "event",
        "t_us": log_lines(folder)[-1]["t_us"],
        "text": "interrupted",
    }
    assert (folder / "run.json").exists()
