"""Writes a log again with some of its messages changed."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

from ccr_host.record.log.files import LOG_PREFIX, LogFiles
from ccr_host.record.log.reader import LogMessage, RunRecording
from ccr_host.record.log.sinks import DirectSink
from ccr_host.record.log.topics import LOG_TOPICS

Change = Callable[[LogMessage], dict[str, Any] | None]
"""Gives the content to write, None to leave the message out."""


def rewritten(source: Path, target: Path, change: Change, trouble: str = "") -> RunRecording:
    """A log with a trouble counts as cut short."""
    by_name = {topic.name: topic for topic in LOG_TOPICS}
    sink = DirectSink(LogFiles(target, LOG_PREFIX, LOG_TOPICS), LOG_TOPICS)
    for message in RunRecording(source).messages():
        content = change(message)
        if content is not None:
            sink.write(by_name[message.topic], message.time_us, json.dumps(content).encode())
    sink.close(trouble=trouble)
    return RunRecording(target)
