"""A recorded run as a tracker."""

import json

import numpy as np
import pytest

from ccr_host.core.errors import ConfigError
from ccr_host.description.schema import Description
from ccr_host.description.simulation import Tracker
from ccr_host.record.log import topics
from ccr_host.record.log.files import LOG_PREFIX, LogFiles
from ccr_host.record.log.sinks import DirectSink
from ccr_host.record.log.topics import LOG_TOPICS
from ccr_host.record.recorded_tracker import ReplayTracker
from tests.exposer import running


def replaying(path, latency_ms=40.0):
    return ReplayTracker(Description(tracker=Tracker(latency_ms=latency_ms)), str(path))


def write_log(path, contents):
    """A log with these samples among other messages."""
    sink = DirectSink(LogFiles(path, LOG_PREFIX, LOG_TOPICS), LOG_TOPICS)
    for index, content in enumerate(contents):
        time_us = 1_000_000 + 100_000 * index
        sink.write(topics.EVENT, time_us, b'{"message":"something else"}')
        sink.write(topics.SAMPLE, time_us, json.dumps(content).encode())
    sink.close()


def sample(exposed_us):
    markers_mm = np.arange(9.0).reshape(3, 3) + exposed_us
    return {"exposed_us": exposed_us, "markers_mm": markers_mm.tolist()}


@pytest.fixture
def log(tmp_path):
    """Three samples as a run records them."""
    write_log(tmp_path, map(sample, (1_000_000, 1_050_000, 1_200_000)))
    return tmp_path


def test_samples_come_in_order_at_their_pace_and_after_the_latency(log):
    tracker = replaying(log)
    seen = {}
    with running(tracker):
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
    tracker = replaying(log)
    tracker.start()
    tracker.advance_to(0)
    assert tracker.health.tracking
    tracker.advance_to(10_000_000)
    assert tracker.health.state == "at the end of the recording"
    assert tracker.health.frames == 3


def test_one_file_of_a_log_does_as_well(log):
    tracker = replaying(log / "log_0000.mcap")
    with running(tracker):
        tracker.advance_to(0)
        tracker.advance_to(10_000_000)
    assert tracker.health.frames == 3


def test_a_lost_marker_stays_lost(tmp_path):
    content = sample(0)
    content["markers_mm"][1] = [None, None, None]
    write_log(tmp_path, [content])
    tracker = replaying(tmp_path, latency_ms=0)
    with running(tracker):
        tracker.advance_to(0)
    assert np.isnan(tracker.newest_frame().tools["M2"].position_mm).all()
    assert np.isfinite(tracker.newest_frame().tools["M3"].position_mm).all()


@pytest.mark.parametrize(
    ("contents", "cause"),
    [
        ([], "no samples"),
        ([{}], "not the log"),
        ([{"exposed_us": 1, "markers_mm": [[1, 2]]}], "not the log"),
        ([{"exposed_us": "1", "markers_mm": [[0, 0, 0]] * 3}], "not the log"),
    ],
)
def test_logs_without_samples_are_refused(tmp_path, contents, cause):
    write_log(tmp_path, contents)
    with pytest.raises(ConfigError, match=cause):
        replaying(tmp_path)


def test_what_is_no_log_is_refused(tmp_path):
    path = tmp_path / "log.jsonl"
    path.write_text('{"kind":"sample"}')
    with pytest.raises(ConfigError, match="not an MCAP file"):
        replaying(path)


def test_missing_file_is_refused(tmp_path):
    with pytest.raises(ConfigError, match="No such file"):
        replaying(tmp_path / "missing")
