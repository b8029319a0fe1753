"""The folder of a sweep: its plan, and a row for each run.

Rows are written as they arrive, one Parquet file per twin; ``runs.parquet`` gathers them. If the
sweep is killed, only the twins that were running are lost.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any
from zlib import crc32

import pyarrow as pa
import pyarrow.parquet as pq

from ccr_host.core.errors import ConfigError
from ccr_host.core.stop_signals import signals_deferred
from ccr_host.core.user_file import read_bytes, read_text, replacing
from ccr_host.record.folder import versions, write_json
from ccr_host.tools.sweep.job import Row
from ccr_host.tools.sweep.plan import SweepPlan, TwinJob

_PLAN = "sweep.json"
GATHERED = "runs.parquet"
"""All rows."""
_PARTS = "parts"

_MILLIMETRES = (
    "mean_error_mm", "rmse_mm", "p95_error_mm", "max_error_mm", "mean_lateral_error_mm",
    "true_mean_error_mm", "true_rmse_mm", "true_p95_error_mm", "true_max_error_mm",
    "true_mean_lateral_error_mm", "floor_mean_error_mm", "twin_floor_mean_error_mm",
)  # fmt: skip
_SCHEMA = pa.schema(
    [
        ("index", pa.int64()),
        ("path", pa.string()),
        ("rate_hz", pa.float64()),
        ("controller", pa.string()),
        ("seed", pa.int64()),
        ("steps", pa.int64()),
        *((name, pa.float64()) for name in _MILLIMETRES),
        ("ratio", pa.float64()),
        ("end_error_mm", pa.float64()),
        ("diverged", pa.bool_()),
        ("within_limits", pa.bool_()),
        ("violations", pa.string()),
        ("fault", pa.string()),
        ("unreachable_steps", pa.int64()),
        ("missed_deadlines", pa.int64()),
        ("tracker_lost_steps", pa.int64()),
        ("coasted_steps", pa.int64()),
        ("held_steps", pa.int64()),
        *((f"link_{name}", pa.int64()) for name in ("sent", "received", "crc_errors", "retries")),
        *((f"link_rtt_us_{name}", pa.float64()) for name in ("median", "p99")),
        *((f"solve_us_{name}", pa.float64()) for name in ("median", "p99", "max")),
        ("wall_s", pa.float64()),
        *(
            (f"cpu_{part}s", pa.float64())
            for part in ("", "twin_", "emulator_", "controller_", "rest_")
        ),
        ("overrides", pa.string()),
        ("command", pa.string()),
    ]
)
_KEY = ("index", "rate_hz", "controller")
_ALWAYS_KNOWN = (*_KEY, "path", "diverged", "within_limits", "fault", "command")
_OF_A_RATIO = ("true_mean_error_mm", "twin_floor_mean_error_mm")
_MOST_BYTES = 256_000_000
_MOST_ROWS = 1_000_000
_ABSURD = 1e12


class SweepFolder:
    """Stores and loads the rows of one sweep.

    ``folder`` exists and is empty, or that of a sweep over the same twins to continue.

    Raises:
        ConfigError: the folder contains another sweep, or cannot be read.
    """

    def __init__(self, folder: Path, plan: SweepPlan) -> None:
        self._folder = folder
        self._plan = json.loads(json.dumps(plan.as_json()))
        self._require_same()
        files = [folder / GATHERED, *sorted((folder / _PARTS).glob("*.parquet"))]
        self._rows = {_key(row): row for file in files if file.exists() for row in _read(file)}

    def rows(self) -> list[Row]:
        """All rows, sorted by index, rate and controller."""
        return [self._rows[key] for key in sorted(self._rows)]

    def missing(self, jobs: Sequence[TwinJob]) -> list[TwinJob]:
        """Those parts of the jobs that have no row yet."""
        left = [
            replace(job, drives=tuple(d for d in job.drives if (job.index, *d) not in self._rows))
            for job in jobs
        ]
        return [job for job in left if job.drives]

    def keep(self, rows: Sequence[Row]) -> None:
        """Write the rows of one twin; they are on disk when this returns.

        Raises:
            OSError: they cannot be written and must be run again.
        """
        self._make_folder()
        # A checksum, as names of controllers may contain slashes and together be too long.
        drives = json.dumps(sorted((row["rate_hz"], row["controller"]) for row in rows))
        name = f"{rows[0]['index']:06d}-{crc32(drives.encode()):08x}.parquet"
        part = self._folder / _PARTS / name
        with signals_deferred():
            _write(part, rows)
            self._rows |= {_key(row): row for row in rows}

    def gather(self) -> None:
        """Move all rows into one file.

        Raises:
            OSError: it cannot be written; the rows stay in their files.
        """
        self._make_folder()
        _write(self._folder / GATHERED, self.rows())
        for part in (self._folder / _PARTS).glob("*.parquet"):
            part.unlink()

    def _make_folder(self) -> None:
        """Create the folder and its plan, also if they were deleted meanwhile.

        The plan comes first: a sweep that ends here, however it ends, leaves no folder that is
        refused.
        """
        self._folder.mkdir(parents=True, exist_ok=True)
        file = self._folder / _PLAN
        if not file.exists():
            write_json(file, {"plan": self._plan, "versions": versions()})
        (self._folder / _PARTS).mkdir(exist_ok=True)

    def _require_same(self) -> None:
        file, wanted = self._folder / _PLAN, self._plan
        if not file.exists():
            if any((self._folder / name).exists() for name in (GATHERED, _PARTS)):
                raise ConfigError(
                    f"--out {self._folder}: contains a sweep without its {_PLAN}",
                    "name another folder",
                )
            return
        try:
            text, _ = read_text(file, "plan of a sweep", "name another folder", _MOST_BYTES)
            there: Any = json.loads(text)["plan"]
            differing = [key for key in wanted if there[key] != wanted[key]]
        except (ValueError, KeyError, TypeError, RecursionError):
            raise ConfigError(f"{file} cannot be read", "name another folder") from None
        if differing:
            raise ConfigError(
                f"--out {self._folder}: contains a sweep of other twins ({', '.join(differing)})",
                "name another folder, or repeat its --seed, --path, --robot, --set and --twins",
            )


def _key(row: Row) -> tuple[Any, ...]:
    return tuple(row[name] for name in _KEY)


def _read(file: Path) -> list[Row]:
    cure = "delete it: its runs are repeated"
    content = read_bytes(file, "rows of a sweep", cure, _MOST_BYTES)
    try:
        parquet = pq.ParquetFile(pa.BufferReader(content), page_checksum_verification=True)
        if parquet.metadata.num_rows > _MOST_ROWS:
            raise ConfigError(f"{file}: more than {_MOST_ROWS} rows", cure)
        table = parquet.read().select(_SCHEMA.names).cast(_SCHEMA)
        rows: list[Row] | None = table.to_pylist()
    except (OSError, KeyError, ValueError, pa.ArrowException):
        rows = None
    if rows is None or not all(map(_is_possible, rows)):
        raise ConfigError(f"{file} cannot be read", cure)
    return rows


def _is_possible(row: Row) -> bool:
    """Whether a run may have left this row; false for gaps, NaN and absurd numbers."""
    known = _ALWAYS_KNOWN if row["ratio"] is None else (*_ALWAYS_KNOWN, *_OF_A_RATIO)
    numbers = (value for value in row.values() if isinstance(value, float))
    return (
        all(row[name] is not None for name in known)
        and all(abs(number) < _ABSURD for number in numbers)
        and row["rate_hz"] > 0
    )


def _write(file: Path, rows: Sequence[Row]) -> None:
    with replacing(file) as draft, draft.open("wb") as opened:
        table = pa.Table.from_pylist(list(rows), schema=_SCHEMA)
        pq.write_table(table, opened, write_page_checksum=True)
