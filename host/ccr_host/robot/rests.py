"""Measured rest poses of the robot."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Rests:
    """Rests in the order in which the robot visited them, moving straight from one to the next."""

    start_rad: FloatArray
    """Motor angles before the first rest, (2,)."""
    q_rad: FloatArray
    """Motor angles commanded at each rest, (N, 2)."""
    markers_mm: FloatArray
    """M1, M2 and M3, one per row, (N, 3, 3), in any common frame; NaN for markers not seen."""
    count: FloatArray
    """Number of exposures averaged at each rest, (N,)."""

    @classmethod
    def of_vectors(
        cls, start_rad: FloatArray, q_rad: FloatArray, vectors_mm: FloatArray, count: FloatArray
    ) -> Rests:
        """Rests from M2 and M3 relative to M1, (N, 2, 3), with M1 as the origin."""
        q_rad, vectors_mm = q_rad.reshape(-1, 2), vectors_mm.reshape(-1, 2, 3)
        markers_mm = np.concatenate([np.zeros_like(vectors_mm[:, :1]), vectors_mm], axis=1)
        return cls(start_rad, q_rad, markers_mm, count)

    @property
    def vectors_mm(self) -> FloatArray:
        """M2 and M3 relative to M1, (N, 2, 3)."""
        vectors: FloatArray = self.markers_mm[:, 1:] - self.markers_mm[:, :1]
        return vectors

    @property
    def tip_mm(self) -> FloatArray:
        """M3 relative to M1, (N, 3)."""
        return self.vectors_mm[:, 1]

    def turned(self, rotation: FloatArray) -> Rests:
        """The rests in another frame; ``rotation`` (3, 3) maps vectors of this frame to it."""
        return replace(self, markers_mm=self.markers_mm @ rotation.T)
