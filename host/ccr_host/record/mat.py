"""The tables of a log as one MAT file, for MATLAB and Octave."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import scipy
from numpy.typing import NDArray

from ccr_host.core.errors import ConfigError
from ccr_host.core.user_file import replacing
from ccr_host.record.log.reader import RunRecording
from ccr_host.record.log.tables import arrays, tables_of

MAT_FILE = "run.mat"


def write_mat(recording: RunRecording, folder: Path) -> dict[str, int]:
    """Write ``run.mat``: one struct a table, one column vector a field, texts as cells.

    Args:
        recording: of a run.
        folder: exists.

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
        raise ConfigError(
            f"--out {folder}: {error.strerror}", "name a folder that can be written"
        ) from None
    return {name: len(next(iter(columns.values()))) for name, columns in structs.items()}


def _column(column: NDArray[Any]) -> NDArray[Any]:
    """Texts as an array of objects, which becomes a cell array."""
    return column.astype(np.object_) if column.dtype.kind == "U" else column
