"""Files as the mcap package reads them, whole, cut short and damaged."""

import json
import random
import re
import struct
import tracemalloc
from collections import Counter
from io import BytesIO

import pytest
import zstandard
from hypothesis import given, settings
from hypothesis import strategies as st
from mcap.opcode import Opcode
from mcap.reader import NonSeekingReader, make_reader
from mcap.writer import MCAP0_MAGIC

from ccr_host.core.errors import ConfigError
from ccr_host.record.log import topics
from ccr_host.record.log.files import LOG_PREFIX, LogFiles, log_files
from ccr_host.record.log.reader import RunRecording
from ccr_host.record.log.sinks import DirectSink
from ccr_host.record.log.topics import LOG_TOPICS


def told(reader) -> list[tuple[str, int, int, bytes]]:
    return [
        (channel.topic, message.log_time, message.sequence, message.data)
        for _, channel, message in reader.iter_messages(log_time_order=False)
    ]


def test_the_packages_readers_find_the_same_by_index_and_in_sequence(log_file):
    with log_file.open("rb") as file:
        indexed = told(make_reader(file, validate_crcs=True))
    with log_file.open("rb") as file:
        sequential = told(NonSeekingReader(file, validate_crcs=True))
    assert indexed == sequential
    ours = [(m.topic, m.time_us * 1000) for m in RunRecording(log_file).messages()]
    assert [(topic, time_ns) for topic, time_ns, _, _ in indexed] == ours


def test_the_summary_counts_what_is_there(log_file):
    with log_file.open("rb") as file:
        reader = make_reader(file)
        summary = reader.get_summary()
        messages = told(reader)
    counted = summary.statistics.channel_message_counts
    counts = Counter(topic for topic, *_ in messages)
    assert {summary.channels[number].topic: n for number, n in counted.items()} == counts
    assert summary.statistics.message_count == len(messages)
    assert summary.statistics.message_start_time == min(time for _, time, _, _ in messages)
    assert summary.statistics.message_end_time == max(time for _, time, _, _ in messages)


def test_sequence_numbers_show_that_nothing_is_missing(log_file):
    with log_file.open("rb") as file:
        messages = told(make_reader(file))
    for topic in {topic for topic, *_ in messages}:
        numbers = [sequence for name, _, sequence, _ in messages if name == topic]
        assert numbers == list(range(1, len(numbers) + 1))


@pytest.mark.long
@settings(max_examples=40, deadline=None)
@given(share=st.floats(0, 1))
def test_a_file_cut_anywhere_gives_all_chunks_that_are_whole(recording, tmp_path_factory, share):
    whole = (recording.source / "log_0000.mcap").read_bytes()
    header = 20_000  # schemas and channels; without them it is no log
    cut = tmp_path_factory.mktemp("cut") / "log_0000.mcap"
    cut.write_bytes(whole[: header + int(share * (len(whole) - header))])
    messages = list(recording.messages())
    found = list(RunRecording(cut).messages())
    assert found == messages[: len(found)]
    with (recording.source / "log_0000.mcap").open("rb") as file:
        chunks = make_reader(file).get_summary().chunk_indexes
    size = cut.stat().st_size
    kept = [c for c in chunks if c.chunk_start_offset + c.chunk_length <= size]
    last_ns = max((c.message_end_time for c in kept), default=0)
    assert max((m.time_us for m in found), default=0) * 1000 == last_ns


def chunk_starts(data: bytes) -> list[int]:
    return [c.chunk_start_offset for c in make_reader(BytesIO(data)).get_summary().chunk_indexes]


def with_change(folder, data: bytes, at: int, change: bytes) -> RunRecording:
    file = folder / "log_0000.mcap"
    file.write_bytes(data[:at] + change + data[at + len(change) :])
    return RunRecording(file)


def as_read(recording: RunRecording) -> list[tuple[str, int, str]]:
    return [(m.topic, m.time_us, json.dumps(m.content)) for m in recording.messages()]


def record_starts(data: bytes) -> list[int]:
    """Where each record of all that a killed run leaves behind begins."""
    starts, at = [], len(MCAP0_MAGIC)
    while data[at] != Opcode.METADATA:
        starts.append(at)
        at += 9 + struct.unpack_from("<Q", data, at + 1)[0]
    return [*starts, at]


@pytest.mark.long
@pytest.mark.parametrize("is_finished", [True, False])
def test_a_damaged_byte_costs_no_more_than_its_chunk(log_file, tmp_path, is_finished):
    data = log_file.read_bytes()
    starts = record_starts(data)
    data = data if is_finished else data[: starts[-1]]
    whole = as_read(with_change(tmp_path, data, 0, b""))
    longest = max(Counter(time_us // 850_000 for _, time_us, _ in whole).values())
    draw = random.Random(1)
    heads = [
        start + byte for start in draw.sample(starts[:-1], 15) for byte in (0, draw.randrange(1, 9))
    ]
    for at in (*heads, *(draw.randrange(len(data)) for _ in range(30))):
        damaged = with_change(tmp_path, data, at, bytes([data[at] ^ 1 << draw.randrange(8)]))
        left, end = as_read(damaged), damaged.end
        lost = len(whole) - len(left)
        assert lost <= 2 * longest
        assert Counter(whole) >= Counter(left)
        assert end.lost_messages == lost if is_finished else end.lost_messages <= lost
        assert not lost or "damaged" in end.trouble or "cut off" in end.trouble


def test_where_the_damage_is_and_what_it_costs_is_told(log_file, tmp_path):
    data = log_file.read_bytes()
    start, end = chunk_starts(data)[1:3]
    damaged = with_change(tmp_path, data, start + 200, bytes([data[start + 200] ^ 1]))
    lost = len(as_read(RunRecording(log_file))) - len(as_read(damaged))
    assert lost > 0
    assert damaged.end.is_complete
    assert damaged.end.lost_messages == lost
    told = re.fullmatch(
        r"the log is damaged: bytes (\d+) to (\d+) of log_0000.mcap, (\S+) s into the run "
        rf"\(.+\); {lost} messages were lost",
        damaged.end.trouble,
    )
    assert told
    assert (int(told[1]), int(told[2]) <= end) == (start, True)


def test_never_closed_cut_off_and_in_another_file_are_told_apart(log_file, tmp_path):
    data = log_file.read_bytes()
    starts = chunk_starts(data)
    for size, told in (
        (len(data), ""),
        (starts[3], "the run never closed its log"),
        (starts[3] + 100, "the log is cut off at byte"),
        (len(data) - 10, ""),  # the closing record is there
    ):
        assert with_change(tmp_path, data[:size], 0, b"").end.trouble.startswith(told)
        assert bool(RunRecording(tmp_path).end.trouble) == bool(told)


def test_a_file_that_is_missing_in_the_middle_is_told(tmp_path):
    files = LogFiles(tmp_path, LOG_PREFIX, LOG_TOPICS, file_us=10_000_000)
    sink = DirectSink(files, LOG_TOPICS)
    for second in range(35):
        sink.write(topics.EVENT, second * 1_000_000, b'{"n":1}')
    sink.close()
    (tmp_path / "log_0001.mcap").unlink()
    end = RunRecording(tmp_path).end
    assert end.lost_messages == 10
    assert end.trouble == "the log lacks its file number 1; 10 messages were lost"


def chunk(content: bytes, size: int, compressed: int) -> bytes:
    head = struct.pack("<QQQII", 0, 0, size, 0, 4) + b"zstd" + struct.pack("<Q", compressed)
    return struct.pack("<BQ", 6, len(head) + len(content)) + head + content


@pytest.mark.long
@pytest.mark.parametrize(
    "content",
    [
        struct.pack("<BQ", 6, 2**40),
        struct.pack("<BQ", 4, 2**63),
        chunk(b"", 2**40, 2**40),
        chunk(zstandard.compress(bytes(70_000_000)), 70_000_000, 0),
        chunk(b"\x28\xb5\x2f\xfd\xe0" + struct.pack("<Q", 2**40) + bytes(8), 2**40, 21),
    ],
    ids=["chunk of 1 TB", "channel", "size of 1 TB", "bomb", "frame of 1 TB"],
)
def test_a_length_that_is_too_great_takes_no_memory(log_file, tmp_path, content):
    data = log_file.read_bytes()
    start = chunk_starts(data)[1]
    long = with_change(tmp_path, data[:start] + content + data[start:], 0, b"")
    tracemalloc.start()
    assert as_read(long) == as_read(RunRecording(log_file))
    assert "damaged" in long.end.trouble
    assert tracemalloc.get_traced_memory()[1] < 100_000_000
    tracemalloc.stop()


def test_a_log_is_cut_into_files_that_each_open_alone(tmp_path):
    files = LogFiles(tmp_path, LOG_PREFIX, LOG_TOPICS, file_us=10_000_000)
    sink = DirectSink(files, LOG_TOPICS)
    sink.write(topics.SETUP, 0, b'{"what":"setup"}')
    for second in range(35):
        sink.write(topics.EVENT, second * 1_000_000, json.dumps({"n": second}).encode())
    sink.close()
    paths = log_files(tmp_path, LOG_PREFIX)
    assert [path.name for path in paths] == [f"log_{n:04d}.mcap" for n in range(4)]
    seconds = []
    for path in paths:
        with path.open("rb") as file:
            reader = make_reader(file, validate_crcs=True)
            assert {s.name for s in reader.get_summary().schemas.values()} == {
                topic.schema_name for topic in LOG_TOPICS
            }
            first, *others = told(reader)
        assert first[0] == topics.SETUP.name
        seconds += [json.loads(data)["n"] for *_, data in others]
    assert seconds == list(range(35))
    whole = [m.content for m in RunRecording(tmp_path).messages()]
    assert whole == [{"what": "setup"}, *({"n": n} for n in range(35))]
    assert RunRecording(tmp_path).end.is_complete
    assert not RunRecording(paths[0]).end.is_complete


def test_a_file_that_has_grown_large_is_the_last_but_one(tmp_path):
    files = LogFiles(tmp_path, LOG_PREFIX, LOG_TOPICS, file_bytes=20_000)
    sink = DirectSink(files, LOG_TOPICS)
    for second in range(100):
        content = {"message": " ".join(str(second * n * 7919 % 9973) for n in range(100))}
        sink.write(topics.EVENT, second * 1_000_000, json.dumps(content).encode())
    sink.close()
    sizes = [path.stat().st_size for path in log_files(tmp_path, LOG_PREFIX)]
    assert len(sizes) > 2
    assert max(sizes) < 50_000, "the limit, a chunk, and the summary"


@pytest.mark.parametrize("content", [b"", b"not a log", bytes(1000)])
def test_what_is_no_log_is_refused_in_one_line(tmp_path, content):
    path = tmp_path / "log_0000.mcap"
    path.write_bytes(content)
    with pytest.raises(ConfigError, match="not an MCAP file"):
        list(RunRecording(path).messages())


def test_a_folder_without_a_log_is_refused(tmp_path):
    with pytest.raises(ConfigError, match="no log in it"):
        RunRecording(tmp_path)
    with pytest.raises(ConfigError, match="No such file"):
        RunRecording(tmp_path / "missing")
