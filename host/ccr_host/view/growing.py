"""Rows of numbers that arrive one by one and are read as one array."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]

_FIRST_CAPACITY = 256


class GrowingTable:
    """Rows ordered by their first column, a time in us."""

    def __init__(self, columns: int) -> None:
        self._storage = np.empty((_FIRST_CAPACITY, columns))
        self._count = 0

    def __len__(self) -> int:
        return self._count

    def append(self, row: Sequence[float] | FloatArray) -> None:
        """Add one row; amortised constant time."""
        if self._count == len(self._storage):
            self._storage = np.concatenate([self._storage, np.empty_like(self._storage)])
        self._storage[self._count] = row
        self._count += 1

    @property
    def rows(self) -> FloatArray:
        """All rows so far, (N, columns); a view."""
        return self._storage[: self._count]

    def until(self, time_us: float) -> FloatArray:
        """The rows up to a time, (n, columns); a view."""
        count = int(np.searchsorted(self.rows[:, 0], time_us, side="right"))
        return self._storage[:count]
