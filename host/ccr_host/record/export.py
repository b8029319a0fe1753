"""Writes the tables of a log into files that other programs read: one a table, or one MAT file."""

from __future__ import annotations

import csv
import json
from collections.abc import Callable, Iterator, Sequence
from contextlib import AbstractContextManager, ExitStack, contextmanager
from enum import StrEnum
from pathlib import Path
from typing import Any

import numpy as np
import scipy
from numpy.typing import NDArray
from pydantic_core import to_json

from ccr_host.core.errors import ConfigError, why
from ccr_host.core.plugins import import_optional
from ccr_host.core.user_file import replacing
from ccr_host.record.folder import unwritable
from ccr_host.record.log.files import LOG_PREFIX, LogFiles, log_files
from ccr_host.record.log.reader import RunRecording
from ccr_host.record.log.sinks import DirectSink
from ccr_host.record.log.tables import Row, Table, arrays, rows, tables_of


def finish_log(recording: RunRecording, folder: Path) -> int:
    """Write all messages that are whole into finished files, and return their number.

    The recording is left as it is; ``folder`` is not its own.

    Raises:
        ConfigError: the folder holds a log or cannot be written, or the log cannot be read.
    """
    by_name = {topic.name: topic for topic in recording.topics}
    count = 0
    if any(folder.glob("*.mcap")):
        raise ConfigError(f"--out {folder}: holds a log", "name another folder")
    sink = DirectSink(LogFiles(folder, LOG_PREFIX, recording.topics), recording.topics)
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


Add = Callable[[Row], object]
"""Adds a row to a file."""

_ROW_GROUP = 20_000


class Format(StrEnum):
    """Format of the exported files."""

    CSV = "csv"
    PARQUET = "parquet"
    JSONL = "jsonl"


def export(recording: RunRecording, form: Format, folder: Path) -> Sequence[tuple[Path, int]]:
    """Write one file a table, all of them or none.

    Returns:
        Each file with its number of rows.

    Raises:
        ConfigError: a file cannot be written, the log cannot be read, or a package is missing.
    """
    tables = tables_of(recording.description.robot)
    counts = dict.fromkeys((table.name for table in tables), 0)
    try:
        with ExitStack() as stack:
            drafts = [stack.enter_context(replacing(folder / f"{t.name}.{form}")) for t in tables]
            add = {
                table.name: stack.enter_context(_FILES[form](draft, table))
                for table, draft in zip(tables, drafts, strict=True)
            }
            for table, row in rows(recording, tables):
                add[table.name](row)
                counts[table.name] += 1
    except OSError as error:
        raise unwritable(folder, why(error)) from None
    return [(folder / f"{name}.{form}", count) for name, count in counts.items()]


@contextmanager
def _csv_file(path: Path, table: Table) -> Iterator[Add]:
    with path.open("w", newline="", encoding="utf-8", errors="backslashreplace") as file:
        writer = csv.DictWriter(file, list(table.columns))
        writer.writeheader()
        yield writer.writerow


@contextmanager
def _json_lines_file(path: Path, _: Table) -> Iterator[Add]:
    with path.open("w", encoding="utf-8") as file:
        yield lambda row: file.write(json.dumps(row) + "\n")


@contextmanager
def _parquet_file(path: Path, table: Table) -> Iterator[Add]:
    arrow: Any = import_optional("pyarrow", "export", "--format parquet")
    parquet: Any = import_optional("pyarrow.parquet", "export", "--format parquet")
    types = {int: arrow.int64(), float: arrow.float64(), bool: arrow.bool_(), str: arrow.string()}
    schema = arrow.schema(
        [
            arrow.field(name, types[column.kind], metadata={"description": column.meaning})
            for name, column in table.columns.items()
        ]
    )
    waiting: list[Row] = []
    with parquet.ParquetWriter(str(path), schema) as writer:

        def write() -> None:
            writer.write_table(arrow.Table.from_pylist(waiting, schema=schema))
            waiting.clear()

        def add(row: Row) -> None:
            waiting.append(row)
            if len(waiting) >= _ROW_GROUP:
                write()

        yield add
        write()


_FILES: dict[Format, Callable[[Path, Table], AbstractContextManager[Add]]] = {
    Format.CSV: _csv_file,
    Format.JSONL: _json_lines_file,
    Format.PARQUET: _parquet_file,
}


MAT_FILE = "run.mat"


def write_mat(recording: RunRecording, folder: Path) -> dict[str, int]:
    """Write ``run.mat``: one struct a table, one column vector a field, texts as cells.

    Returns:
        The number of rows by table.

    Raises:
        ConfigError: the file cannot be written, or the log cannot be read.
    """
    structs = {
        table.name: {name: _column(column) for name, column in arrays(recording, table).items()}
        for table in tables_of(recording.description.robot)
    }
    try:
        with replacing(folder / MAT_FILE) as draft, draft.open("wb") as file:
            scipy.io.savemat(
                file, structs, long_field_names=True, do_compression=True, oned_as="column"
            )
    except OSError as error:
        raise unwritable(folder, why(error)) from None
    return {name: len(next(iter(columns.values()))) for name, columns in structs.items()}


def _column(column: NDArray[Any]) -> NDArray[Any]:
    """Texts as an array of objects, which becomes a cell array."""
    return column.astype(np.object_) if column.dtype.kind == "U" else column
