"""The reference that a controller tracks."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ccr_host.core.arrays import Array, BoolArray
from ccr_host.core.errors import ConfigError

REACHABLE_MM = 0.01
"""Points closer than this count as reachable: far above rounding (1e-12 mm), far below what the
robot can resolve (half a microsecond of servo pulse moves the tip 0.1 mm, the camera's noise is
0.25 mm)."""

PATH_AXES = {"x": 1, "y": 0, "z": 2}
"""Component of f in (10) that a path, and every file with named axes, calls x, y and z."""

MAX_SAMPLES = 100_000
"""About a thousand samples per second of the longest built-in path; servos take 50."""
_SMALL_GAP_MM = 1.0
"""Gap allowed between the ends of any closed path, however finely it is sampled."""
_SAME_POINT_MM = 1e-6


def is_closed(points_mm: Array) -> bool:
    """Whether the end of a path, (N, 2 or 3), is as close to its start as its points are."""
    steps_mm = np.linalg.norm(np.diff(points_mm, axis=0), axis=1)
    gap_mm = float(np.linalg.norm(points_mm[-1] - points_mm[0]))
    # With a margin for rounding: where a path is symmetric, the gap is as long as its steps.
    return gap_mm <= max(1.000001 * float(steps_mm.max()), _SMALL_GAP_MM)


@dataclass(frozen=True)
class Reference:
    """A desired path, one sample per control period.

    ``time_s`` (N,) starts at 0. ``target_mm`` (N, 3) is the desired tip in the frame of (10): the
    path's own coordinates even where they cannot be reached: f[0] and f[2], and f[1] if it has
    that too. ``q_rad`` (N, n) are the nearest reachable motor angles, ``unavoidable_mm`` (N,) the
    distance that remains there, in the path's own coordinates, according to the surface on which
    the path was laid. ``in_space``: the path gives all three coordinates. All laps are identical.
    """

    name: str
    period_s: float
    time_s: Array
    target_mm: Array
    q_rad: Array
    unavoidable_mm: Array
    laps: int = 1
    in_space: bool = False

    def __len__(self) -> int:
        return len(self.time_s)

    @property
    def lap_steps(self) -> int:
        """Number of samples of one lap."""
        return len(self) // self.laps

    def repeated(self, laps: int) -> Reference:
        """The path repeated `laps` times without a stop.

        A last sample equal to the first one is left out, as the next lap starts with it.

        Raises:
            ConfigError: the gap between end and start is larger than that between samples.
        """
        if laps == 1:
            return self
        gap_mm = float(np.linalg.norm(self.target_mm[-1] - self.target_mm[0]))
        if not is_closed(self.target_mm):
            raise ConfigError(
                f"path {self.name} ends {gap_mm:.1f} mm from its start: {laps} laps are impossible",
                "close the path, or omit --laps",
            )
        kept = slice(0, len(self) - (gap_mm < _SAME_POINT_MM))
        lap = self.time_s[kept]
        if laps * len(lap) > MAX_SAMPLES:
            raise ConfigError(
                f"{laps} laps of path {self.name} have more than {MAX_SAMPLES} samples",
                "lower --laps or --rate",
            )
        return replace(
            self,
            time_s=np.arange(laps * len(lap), dtype=np.float64) * self.period_s,
            target_mm=np.tile(self.target_mm[kept], (laps, 1)),
            q_rad=np.tile(self.q_rad[kept], (laps, 1)),
            unavoidable_mm=np.tile(self.unavoidable_mm[kept], laps),
            laps=laps,
        )

    @property
    def reachable(self) -> BoolArray:
        """Which samples can be reached, (N,)."""
        return self.unavoidable_mm <= REACHABLE_MM

    @property
    def unreachable_steps(self) -> int:
        return int(np.count_nonzero(~self.reachable))

    @property
    def floor_mean_mm(self) -> float:
        """Mean error that remains with the best motor angles, according to the surface."""
        return float(np.mean(self.unavoidable_mm))
