"""Tables, read back by others."""

import csv
import json
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest
import scipy

from ccr_host.description.schema import Robot
from ccr_host.link.messages import SetTarget
from ccr_host.record.export import Format, export, write_mat
from ccr_host.record.log import topics
from ccr_host.record.log.tables import arrays, dictionary, tables_of
from ccr_host.robot.paths import read_path_file

TABLES = tables_of(Robot())
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


@pytest.mark.long
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
    axes = ("y", "x", "z")  # as a path names the components of f
    logged = [message.content for message in recording.messages(topics.SAMPLE)]
    for row, content in zip(rows_of(tmp_path, form, "samples"), logged, strict=True):
        markers = [[float(row[f"{m}_{axis}_mm"]) for axis in axes] for m in ("m1", "m2", "m3")]
        np.testing.assert_array_equal(markers, content["markers_mm"])
    steps = [message.content for message in recording.messages(topics.STEP)]
    for row, content in zip(rows_of(tmp_path, form, "steps"), steps, strict=True):
        assert [float(row["q_1_rad"]), float(row["q_2_rad"])] == content["q_rad"]
        assert [float(row[f"target_{axis}_mm"]) for axis in axes] == content["target_mm"]
    assert any(float(row["solve_us"]) > 0 for row in rows_of(tmp_path, form, "steps"))


def test_a_paths_y_and_z_are_those_of_the_table(recording, tmp_path):
    export(recording, Format.CSV, tmp_path)
    path = read_path_file(Path(recording.options.path))
    rows = rows_of(tmp_path, Format.CSV, "steps")
    times_s = np.array([float(row["time_s"]) for row in rows])
    for axis in ("y", "z"):
        wanted = getattr(path.resampled(times_s), f"{axis}_mm")
        assert [float(row[f"target_{axis}_mm"]) for row in rows] == pytest.approx(wanted)


def test_the_dictionary_of_columns_is_current():
    committed = (Path(__file__).parents[4] / "docs" / "logs.md").read_text(encoding="utf-8")
    assert committed.endswith(dictionary()), "renew it: python -m ccr_host.record.log.tables"
    assert all(column.meaning for table in TABLES for column in table.columns.values())


def test_parquet_carries_the_meaning_of_its_columns(recording, tmp_path):
    export(recording, Format.PARQUET, tmp_path)
    field = pq.read_schema(tmp_path / "steps.parquet").field("target_y_mm")
    assert field.metadata[b"description"] == b"desired tip, y"


def test_frames_are_told_in_words(recording, tmp_path):
    export(recording, Format.JSONL, tmp_path)
    frames = rows_of(tmp_path, Format.JSONL, "frames")
    targets = [row for row in frames if row["name"] == SetTarget.NAME]
    assert targets
    assert all(row["direction"] == "sent" for row in targets)
    assert all(row["message"].startswith("SetTarget(session=") for row in targets)


def test_a_mat_file_holds_the_tables_as_structs_of_columns(recording, tmp_path):
    assert write_mat(recording, tmp_path) == {
        table.name: len(list(recording.messages(*table.topics))) for table in TABLES
    }
    read = scipy.io.loadmat(tmp_path / "run.mat", simplify_cells=True)
    for table in TABLES:
        assert list(read[table.name]) == list(table.columns)
        for name, column in arrays(recording, table).items():
            cells = read[table.name][name]
            if column.dtype.kind == "U":  # scipy reads an empty text as an empty array
                cells = [text if len(text) else "" for text in np.atleast_1d(cells)]
            np.testing.assert_array_equal(cells, column)
