"""The log's writer thread before disks that stand still or are full."""

import json
import resource
import shutil
from contextlib import contextmanager
from threading import Event, Semaphore

import pytest

from ccr_host.record.log import topics
from ccr_host.record.log.files import LOG_PREFIX, LogFiles, McapFile
from ccr_host.record.log.reader import RunRecording
from ccr_host.record.log.sinks import QUEUE_CHUNKS, BackgroundSink, DirectSink
from ccr_host.record.log.topics import LOG_TOPICS
from tests.patience import PATIENCE_S

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


@contextmanager
def room(size):
    """Files of this process may not grow beyond so many bytes."""
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, before[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)


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
    assert disk.waiting.wait(PATIENCE_S), "the first chunk is in the writer's hands"
    for second in range(2, 12):
        note(sink, second)
    disk.released.set()
    for _ in range(1 + QUEUE):
        assert disk.written.acquire(timeout=PATIENCE_S)
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
@pytest.mark.parametrize("beyond_head", [-10, 500, 4000])
def test_a_full_disk_ends_the_log_but_not_the_run_and_the_loss_is_counted(
    tmp_path, kind, beyond_head
):
    head = McapFile(tmp_path / "head.mcap", LOG_TOPICS).size
    sink = kind(LogFiles(tmp_path, LOG_PREFIX, LOG_TOPICS), LOG_TOPICS)
    with room(head + beyond_head):
        for second in range(QUEUE_CHUNKS):
            note(sink, second)
        sink.close()
    assert "File too large (see the limit of ulimit -f)" in sink.trouble
    told = []
    if beyond_head > 0:
        recording = RunRecording(tmp_path)
        told = [message.content["message"] for message in recording.messages()]
        if recording.end.is_complete:
            assert recording.end.lost_messages == QUEUE_CHUNKS - len(told)
    assert told == [f"second {second}" for second in range(len(told))]
    assert f"{QUEUE_CHUNKS - len(told)} messages lost" in sink.trouble


@pytest.mark.parametrize("kind", [DirectSink, BackgroundSink])
def test_a_log_whose_folder_is_removed_is_written_again(tmp_path, kind):
    folder = tmp_path / "run"
    folder.mkdir()
    disk = StandingDisk(folder)
    disk.released.set()
    sink = kind(disk, LOG_TOPICS)
    for second in range(5):
        note(sink, second)
    for _ in range(4):  # chunks that are full: nothing is being written when the folder goes
        disk.written.acquire()
    shutil.rmtree(folder)
    for second in range(5, 10):
        note(sink, second)
    sink.close()
    assert len(list(RunRecording(folder).messages())) == 10
    assert not sink.trouble


def test_files_of_a_log_that_are_gone_are_counted_as_lost(tmp_path):
    sink = DirectSink(LogFiles(tmp_path, LOG_PREFIX, LOG_TOPICS, file_us=5_000_000), LOG_TOPICS)
    for second in range(12):
        note(sink, second)
    (tmp_path / "log_0000.mcap").unlink()
    sink.close()
    assert "5 messages lost" in sink.trouble
