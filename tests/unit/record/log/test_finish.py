"""A log that was cut short, made whole for other readers."""

import pytest
from mcap.exceptions import McapError
from mcap.reader import make_reader

from ccr_host.core.errors import ConfigError
from ccr_host.record.export import finish_log
from ccr_host.record.log.reader import RunRecording


def test_a_cut_log_gets_a_summary_and_keeps_its_messages(log_file, tmp_path):
    cut = tmp_path / "log_0000.mcap"
    whole = log_file.read_bytes()
    cut.write_bytes(whole[: len(whole) // 2])
    with cut.open("rb") as file, pytest.raises(McapError):
        make_reader(file).get_summary()
    count = finish_log(RunRecording(cut), tmp_path / "finished")
    finished = RunRecording(tmp_path / "finished")
    assert list(finished.messages()) == list(RunRecording(cut).messages())
    with (tmp_path / "finished" / "log_0000.mcap").open("rb") as file:
        assert make_reader(file).get_summary().statistics.message_count == count


def test_what_was_missing_is_still_missing_in_the_copy(log_file, tmp_path):
    cut, whole = tmp_path / "log_0000.mcap", bytearray(log_file.read_bytes())
    cut.write_bytes(whole[: len(whole) // 2])
    finish_log(RunRecording(cut), tmp_path / "of cut")
    copy = RunRecording(tmp_path / "of cut").end
    assert not copy.is_complete
    assert RunRecording(cut).end.trouble in copy.trouble
    whole[whole.rindex(b"zstd", 0, len(whole) // 2) + 300] ^= 1
    cut.write_bytes(whole)
    finish_log(RunRecording(cut), tmp_path / "of damaged")
    assert RunRecording(tmp_path / "of damaged").end.lost_messages == (
        RunRecording(cut).end.lost_messages
    )


def test_no_log_is_written_over(recording):
    with pytest.raises(ConfigError, match="holds a log"):
        finish_log(recording, recording.source)
