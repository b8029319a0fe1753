import signal

import pytest

from ccr_host.link.messages import Disarm, SetTarget, State, Stop, Telemetry
from ccr_host.record.log import topics
from tests.patience import PATIENCE_S
from tests.system.conftest import (
    IN_REAL_TIME,
    PAPERS,
    CcrHost,
    events,
    messages_in,
    wait_until_following,
)


@pytest.mark.parametrize(
    ("number", "beside"),
    [
        (signal.SIGINT, "--with-open"),
        (signal.SIGTERM, "--no-open"),
        (signal.SIGHUP, "--no-open"),
    ],
)
def test_an_interrupted_run_disarms_the_robot_first_and_keeps_its_log(
    ccr_host: CcrHost, number: signal.Signals, beside: str
) -> None:
    words = ("track", "8shape", *PAPERS, *IN_REAL_TIME, "--realtime", "--rate", "5", beside)
    process = ccr_host.start(*words, "--out", "kept")
    folder = ccr_host.folder / "kept"
    wait_until_following(folder, process)
    process.send_signal(number)
    _, err = process.communicate(timeout=PATIENCE_S)
    assert process.returncode == 130
    assert err.endswith("ccr-host: interrupted\n")
    assert "Traceback" not in err
    sent = messages_in(folder, topics.SENT)
    last_target = max(i for i, message in enumerate(sent) if isinstance(message, SetTarget))
    assert any(isinstance(message, Disarm | Stop) for message in sent[last_target:])
    reports = [m.report for m in messages_in(folder, topics.RECEIVED) if isinstance(m, Telemetry)]
    assert reports[-1].state in (State.DISARMED, State.STOPPED)
    assert reports[-1].pulse_half_us == (0, 0), "shown at the pins, not only by the state"
    assert events(folder)[-1] == "interrupted"
    assert (folder / "run.json").exists()
