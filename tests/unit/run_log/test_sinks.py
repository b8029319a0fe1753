"""The log's writer thread before disks that stand still or are full."""

import errno
import json
from threading import Event, Semaphore

import pytest

from ccr_host.run.log import topics
from ccr_host.run.log.files import LOG_PREFIX, LogFiles
from ccr_host.run.log.reader import RunRecording
from ccr_host.run.log.sinks import BackgroundSink, DirectSink
from ccr_host.run.log.topics import LOG_TOPICS

QUEUE = 3


class StandingDisk(LogFiles):
    """Takes nothing until it is released."""

    def __init__(self, folder):
        super().__init__(folder, LOG_PREFIX, LOG_TOPICS)
        self.waiting, self.released, self.written = Event(), Event(), Semaphore(0)

    def write(self, chunk, repeated):
        self.waiting.set()
        self.released.wait()
        super().write(chunk, repeated)
        self.written.release()


class FullDisk(LogFiles):
    def write(self, chunk, repeated):
        raise OSError(errno.ENOSPC, "No space left on device")


def note(sink, second):
    content = json.dumps({"message": f"second {second}"}).encode()
    sink.write(topics.EVENT, second * 1_000_000, content)


def test_messages_written_meanwhile_are_kept_while_the_disk_stands(tmp_path):
    disk = StandingDisk(tmp_path)
    sink = BackgroundSink(disk, LOG_TOPICS)
    for second in range(20):
        note(sink, second)
    disk.released.set()
    sink.close()
    assert not sink.trouble
    told = [message.content["message"] for message in RunRecording(tmp_path).messages()]
    assert told == [f"second {second}" for second in range(20)]


def test_what_is_lost_is_counted_and_told(tmp_path):
    disk = StandingDisk(tmp_path)
    sink = BackgroundSink(disk, LOG_TOPICS, queue_chunks=QUEUE)
    note(sink, 0)
    note(sink, 1)
    assert disk.waiting.wait(10), "the first chunk is in the writer's hands"
    for second in range(2, 12):
        note(sink, second)
    disk.released.set()
    for _ in range(1 + QUEUE):
        assert disk.written.acquire(timeout=10)
    note(sink, 20)
    note(sink, 21)
    sink.close()
    recording = RunRecording(tmp_path)
    told = [message.content["message"] for message in recording.messages()]
    kept = [text for text in told if text.startswith("second")]
    lost = recording.end.lost_messages
    assert lost > 0
    assert len(kept) + lost == 14
    assert any(f"{lost} messages lost before this" in text for text in told)
    assert str(lost) in sink.trouble


@pytest.mark.parametrize("kind", [DirectSink, BackgroundSink])
def test_a_full_disk_ends_the_log_but_not_the_run(tmp_path, kind):
    sink = kind(FullDisk(tmp_path, LOG_PREFIX, LOG_TOPICS), LOG_TOPICS)
    for second in range(5):
        note(sink, second)
    sink.close()
    assert "No space left" in sink.trouble
