"""What every tracker delivers."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True, eq=False)
class Sample:
    """One exposure of the three markers."""

    exposed_us: int
    """When the markers were there, on the run's clock."""
    markers_mm: NDArray[np.float64]
    """(3, 3): the positions of M1 (base), M2 (end of segment 1) and M3 (tip), one a row."""

    @property
    def tip_mm(self) -> NDArray[np.float64]:
        """(3,): f_m of the paper, M3 - M1."""
        tip: NDArray[np.float64] = self.markers_mm[2] - self.markers_mm[0]
        return tip

    @property
    def middle_mm(self) -> NDArray[np.float64]:
        """(3,): the end of segment 1, M2 - M1."""
        middle: NDArray[np.float64] = self.markers_mm[1] - self.markers_mm[0]
        return middle
