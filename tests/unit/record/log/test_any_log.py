"""Whatever a log holds, every reader reads it or raises an error of ours."""

import json
import random
import shutil

import pytest

from ccr_host.core.errors import CcrError
from ccr_host.description.schema import Description
from ccr_host.record.export import Format, export, finish_log
from ccr_host.record.folder import METRICS_FILE
from ccr_host.record.log.reader import RunRecording, play_run
from ccr_host.record.recorded_tracker import ReplayTracker
from ccr_host.record.replay import replay
from ccr_host.record.report import write_report
from ccr_host.view.history import RunHistory
from ccr_host.view.page import status_html
from tests.unit.record.replay.rewrite import rewritten

ODD = (
    *(None, True, 0, -1, 2**63, 10**400, 1e308, float("nan"), "", "x", "\ud800", "0" * 5000, "zz"),
    *([], {}, [[]], [None], {"a": 1}, [1, 2], [1, 2, 3], [[1, 2, 3]] * 3),
)


def view(folder):
    history = RunHistory()
    play_run(folder, history)
    for share in (0, 0.5, 1, 1e9):
        status_html(history.setup, history.at(share * history.end_us))


READERS = {
    "messages": lambda folder: list(RunRecording(folder).messages()),
    "end": lambda folder: RunRecording(folder).end,
    **{
        str(form): lambda folder, form=form: export(RunRecording(folder), form, folder / "tables")
        for form in Format
    },
    "finish": lambda folder: finish_log(RunRecording(folder), folder / "finished"),
    "replay": lambda folder: replay(RunRecording(folder)),
    "view": view,
    "tracker": lambda folder: ReplayTracker(Description(), str(folder)),
}


def read_by_all(folder):
    for read in READERS.values():
        try:
            read(folder)
        except CcrError as error:
            assert error.cause
            assert "\n" not in str(error)


def mutated(value, draw):
    """The same with one thing in it changed at random."""
    if not isinstance(value, dict | list) or not value or draw.random() < 0.2:
        return draw.choice(ODD)
    keys = list(value) if isinstance(value, dict) else range(len(value))
    key, changed = draw.choice(keys), value.copy()
    if draw.random() < 0.15:
        del changed[key]
    else:
        changed[key] = mutated(value[key], draw)
    return changed


@pytest.mark.long
@pytest.mark.parametrize("seed", range(20))
def test_messages_of_wrong_content(recording, tmp_path, seed):
    draw = random.Random(seed)
    topic = draw.choice(sorted({message.topic for message in recording.messages()}))
    chosen = draw.randrange(sum(message.topic == topic for message in recording.messages()))
    seen = 0

    def change(message):
        nonlocal seen
        seen += message.topic == topic
        is_it = message.topic == topic and seen == chosen + 1
        return mutated(message.content, draw) if is_it else message.content

    rewritten(recording.source, tmp_path, change)
    read_by_all(tmp_path)


@pytest.mark.long
@pytest.mark.parametrize("seed", range(20))
def test_bytes_changed_lost_and_added(log_file, tmp_path, seed):
    draw = random.Random(seed)
    data = bytearray(log_file.read_bytes())
    for _ in range(draw.choice((1, 3, 30))):
        at = draw.randrange(len(data))
        match draw.randrange(4):
            case 0:
                del data[at : at + draw.choice((1, 8, 1000))]
            case 1:
                data[at:at] = draw.randbytes(draw.choice((1, 9, 300)))
            case _:
                data[at] = draw.randrange(256)
    (tmp_path / "log_0000.mcap").write_bytes(data)
    read_by_all(tmp_path)


@pytest.mark.long
@pytest.mark.parametrize("seed", range(6))
def test_a_report_needs_no_summary_that_makes_sense(recording, tmp_path, seed):
    draw = random.Random(seed)
    shutil.copy(recording.source / "log_0000.mcap", tmp_path)
    metrics = {"faults": ["x"], "mean_error_mm": 1.0, "link": {"sent": 1}, "missed_deadlines": 0}
    text = json.dumps(mutated({"metrics": metrics}, draw)) if seed else "[" * 99_999
    (tmp_path / METRICS_FILE).write_text(text)
    write_report([tmp_path], tmp_path / "report.html")
    assert (tmp_path / "report.html").stat().st_size > 10_000
