"""Tables, read back by others."""

import csv
import json

import numpy as np
import pyarrow.parquet as pq
import pytest

from ccr_host.link.messages import SetTarget
from ccr_host.run.log import topics
from ccr_host.run.log.export import Format, export
from ccr_host.run.log.tables import TABLES

COUNTED = {table.name: table.topics for table in TABLES}


def rows_of(folder, form, name):
    path = folder / f"{name}.{form}"
    match form:
        case Format.CSV:
            with path.open(newline="", encoding="utf-8") as file:
                return list(csv.DictReader(file))
        case Format.JSONL:
            return [json.loads(line) for line in path.read_text(encoding="utf-8").splitlines()]
        case Format.PARQUET:
            return pq.read_table(path).to_pylist()


@pytest.mark.parametrize("form", list(Format))
def test_every_message_has_a_row_with_every_column(recording, tmp_path, form):
    written = export(recording, form, tmp_path)
    assert {path.name for path, _ in written} == {f"{name}.{form}" for name in COUNTED}
    for table in TABLES:
        rows = rows_of(tmp_path, form, table.name)
        assert len(rows) == len(list(recording.messages(*table.topics))) > 0
        assert all(list(row) == list(table.columns) for row in rows)


@pytest.mark.parametrize("form", list(Format))
def test_numbers_come_back_as_they_were_logged(recording, tmp_path, form):
    export(recording, form, tmp_path)
    axes = ("x", "y", "z")
    logged = [message.content for message in recording.messages(topics.SAMPLE)]
    for row, content in zip(rows_of(tmp_path, form, "samples"), logged, strict=True):
        markers = [[float(row[f"{m}_{axis}_mm"]) for axis in axes] for m in ("m1", "m2", "m3")]
        np.testing.assert_array_equal(markers, content["markers_mm"])
    steps = [message.content for message in recording.messages(topics.STEP)]
    for row, content in zip(rows_of(tmp_path, form, "steps"), steps, strict=True):
        assert [float(row["q_1_rad"]), float(row["q_2_rad"])] == content["q_rad"]
        assert [float(row[f"target_{axis}_mm"]) for axis in axes] == content["target_mm"]
    assert any(float(row["solve_us"]) > 0 for row in rows_of(tmp_path, form, "steps"))


def test_frames_are_told_in_words(recording, tmp_path):
    export(recording, Format.JSONL, tmp_path)
    frames = rows_of(tmp_path, Format.JSONL, "frames")
    targets = [row for row in frames if row["name"] == SetTarget.NAME]
    assert targets
    assert all(row["direction"] == "sent" for row in targets)
    assert all(row["message"].startswith("SetTarget(session=") for row in targets)
