"""A recorded run as a tracker."""

import io

import numpy as np
import pytest

from ccr_host.errors import ConfigError
from ccr_host.run.json_log import JsonLog
from ccr_host.tracking.replay import ReplayTracker
from ccr_host.tracking.sample import Sample

LATENCY_US = 40_000


@pytest.fixture
def log(tmp_path):
    """Three samples as a run records them, among other lines."""
    text = io.StringIO()
    recorder = JsonLog(text)
    for exposed_us in (1_000_000, 1_050_000, 1_200_000):
        recorder.event(exposed_us, "something else")
        markers_mm = np.arange(9.0).reshape(3, 3) + exposed_us
        recorder.sample(Sample(exposed_us, markers_mm))
    path = tmp_path / "log.jsonl"
    path.write_text(text.getvalue())
    return path


def test_samples_come_in_order_at_their_pace_and_after_the_latency(log):
    tracker = ReplayTracker(log, LATENCY_US)
    seen = {}
    with tracker:
        for time_us in range(500_000, 1_000_000, 1000):
            tracker.advance_to(time_us)
            frame = tracker.newest_frame()
            if frame is not None:
                seen.setdefault(frame.exposed_us, time_us)
    assert seen == {500_000: 540_000, 550_000: 590_000, 700_000: 740_000}
    markers_mm = np.arange(9.0).reshape(3, 3) + 1_200_000
    for name, marker_mm in zip(("M1", "M2", "M3"), markers_mm, strict=True):
        np.testing.assert_array_equal(tracker.newest_frame().tools[name].position_mm, marker_mm)


def test_health_tells_the_end_of_the_recording(log):
    tracker = ReplayTracker(log)
    tracker.start()
    tracker.advance_to(0)
    assert tracker.health.tracking
    tracker.advance_to(10_000_000)
    assert tracker.health.state == "at the end of the recording"
    assert tracker.health.frames == 3


@pytest.mark.parametrize(
    ("text", "cause"),
    [
        ("", "no samples"),
        ('{"kind":"run"}\n', "no samples"),
        ("not json\n", "not the log"),
        ('{"kind":"sample"}\n', "not the log"),
        ('{"kind":"sample","exposed_us":1,"markers_mm":[[1,2]]}\n', "not the log"),
        ("[1,2]\n", "not the log"),
    ],
)
def test_files_that_are_no_recording_are_refused(tmp_path, text, cause):
    path = tmp_path / "log.jsonl"
    path.write_text(text)
    with pytest.raises(ConfigError, match=cause):
        ReplayTracker(path)


def test_missing_file_is_refused(tmp_path):
    with pytest.raises(ConfigError, match="No such file"):
        ReplayTracker(tmp_path / "missing")
