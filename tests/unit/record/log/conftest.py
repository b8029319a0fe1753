from pathlib import Path

import pytest

from ccr_host.record.keep import execute_logged
from ccr_host.record.log.reader import RunRecording
from ccr_host.run.options import RunOptions


@pytest.fixture(scope="session")
def recording(tmp_path_factory: pytest.TempPathFactory) -> RunRecording:
    """Three seconds in virtual time, at 10 Hz, with samples missing now and then."""
    folder = tmp_path_factory.mktemp("run")
    path = folder / "short.csv"
    path.write_text("t_s,y_mm,z_mm\n0,0,30\n3,10,35\n")
    options = RunOptions(str(path), "mpc", rate_hz=10.0, overrides=("tracker.dropout=0.3",))
    result = execute_logged(options, folder, lambda *_: None)
    assert result.failure is None
    return RunRecording(folder)


@pytest.fixture
def log_file(recording: RunRecording) -> Path:
    return recording.source / "log_0000.mcap"
