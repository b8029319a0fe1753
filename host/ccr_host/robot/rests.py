"""The robot at rest, as a camera saw it."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Rests:
    """Rests in the order in which the robot came to them, straight from one to the next."""

    start_rad: FloatArray
    """Motor angles that the robot came from, (2,)."""
    q_rad: FloatArray
    """Motor angles commanded at each rest, (N, 2)."""
    markers_mm: FloatArray
    """M1, M2 and M3, one a row, (N, 3, 3), in any one frame; NaN where a marker was not seen."""
    count: FloatArray
    """Exposures of which each is the mean, (N,)."""

    @classmethod
    def of_vectors(
        cls, start_rad: FloatArray, q_rad: FloatArray, vectors_mm: FloatArray, count: FloatArray
    ) -> Rests:
        """With M1 as the origin: M2 and M3 against it, (N, 2, 3)."""
        q_rad, vectors_mm = q_rad.reshape(-1, 2), vectors_mm.reshape(-1, 2, 3)
        markers_mm = np.concatenate([np.zeros_like(vectors_mm[:, :1]), vectors_mm], axis=1)
        return cls(start_rad, q_rad, markers_mm, count)

    @property
    def vectors_mm(self) -> FloatArray:
        """M2 and M3 against M1, (N, 2, 3)."""
        vectors: FloatArray = self.markers_mm[:, 1:] - self.markers_mm[:, :1]
        return vectors

    @property
    def tip_mm(self) -> FloatArray:
        """M3 against M1, (N, 3)."""
        return self.vectors_mm[:, 1]

    def turned(self, rotation: FloatArray) -> Rests:
        """The same in another frame: (3, 3) turns vectors of this one into it."""
        return replace(self, markers_mm=self.markers_mm @ rotation.T)
