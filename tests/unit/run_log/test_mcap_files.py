"""Files as the mcap package reads them, whole, cut short and damaged."""

import json
from collections import Counter

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from mcap.reader import NonSeekingReader, make_reader

from ccr_host.errors import ConfigError
from ccr_host.run.log import topics
from ccr_host.run.log.files import LOG_PREFIX, LogFiles, log_files
from ccr_host.run.log.reader import RunRecording
from ccr_host.run.log.sinks import DirectSink
from ccr_host.run.log.topics import LOG_TOPICS


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


def test_damage_in_the_middle_is_noticed(log_file, tmp_path):
    data = bytearray(log_file.read_bytes())
    with log_file.open("rb") as file:
        chunk = make_reader(file).get_summary().chunk_indexes[1]
    data[chunk.chunk_start_offset + chunk.chunk_length // 2] ^= 1
    damaged = tmp_path / "log_0000.mcap"
    damaged.write_bytes(data)
    with pytest.raises(ConfigError, match="damaged"):
        list(RunRecording(damaged).messages())


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
