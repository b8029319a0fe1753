"""Writes an unfinished log again, so that readers find their way in it without reading all."""

from __future__ import annotations

from pathlib import Path

from pydantic_core import to_json

from ccr_host.errors import ConfigError
from ccr_host.run.log.files import LOG_PREFIX, LogFiles, log_files
from ccr_host.run.log.reader import RunRecording
from ccr_host.run.log.sinks import DirectSink
from ccr_host.run.log.topics import LOG_TOPICS


def finish_log(recording: RunRecording, folder: Path) -> int:
    """Write all messages that are whole into finished files.

    Args:
        recording: left as it is.
        folder: another one than the recording's.

    Returns:
        The number of messages.

    Raises:
        ConfigError: the folder holds a log or cannot be written, or the log cannot be read.
    """
    by_name = {topic.name: topic for topic in LOG_TOPICS}
    count = 0
    if any(folder.glob("*.mcap")):
        raise ConfigError(f"--out {folder}: holds a log", "name another folder")
    sink = DirectSink(LogFiles(folder, LOG_PREFIX, LOG_TOPICS), LOG_TOPICS)
    try:
        try:
            for message in recording.messages():
                sink.write(by_name[message.topic], message.time_us, to_json(message.content))
                count += 1
        finally:
            end = recording.end
            sink.close(end.lost_messages, end.trouble)
        if sink.trouble:
            raise ConfigError(f"--out {folder}: {sink.trouble}", "name a folder with room")
    except BaseException:
        for file in log_files(folder, LOG_PREFIX):
            file.unlink()
        raise
    return count
