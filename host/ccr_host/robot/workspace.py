"""The reachable surface of two motors, and the configuration nearest to any point.

A path is given in two lateral coordinates, f[0] and f[2] of (10). f[0] depends on theta_2 alone
and folds where V(theta_2) peaks, at 133.6 deg; f[2], at a given theta_2, folds again in theta_1.
The workspace used here is the sheet around the straight robot, up to the folds or the motor
limits, whichever come first. On it the lateral map is one-to-one, so the nearest configuration
is a function of the point alone: neighbouring points have neighbouring configurations however
finely a path is sampled, and a closed path is closed in motor angles too.

Stopping at the folds loses no reach while the limits are about symmetric about zero: a segment
bent beyond its fold rolls up further and reaches less far to the side.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ccr_host.description.schema import Servo
from ccr_host.robot.arc import arc_derivatives
from ccr_host.robot.kinematics import ConstantCurvature

FloatArray = NDArray[np.float64]

# Halving an interval of a full turn this many times leaves less than one unit in the last place.
_HALVINGS = 54
# A monotone piece spans about a quarter turn or more; a much smaller step finds its end.
_MARCH_STEP_RAD = math.radians(5.0)
# The distance along the rim is smooth; the grid only picks the valley to bisect.
_RIM_GRID = 65
# The rim table is accurate to 1e-3 rad; two Newton steps square that twice, the third is margin.
_NEWTON_STEPS = 3
# Rounding of the bisections, with margin: below it a height counts as reached exactly.
_EXACT_MM = 1e-9


@dataclass(frozen=True)
class MotorLimits:
    """Interval of both motor angles, (2,) each, rad."""

    lower_rad: FloatArray
    upper_rad: FloatArray

    @classmethod
    def of(cls, servo: Servo) -> MotorLimits:
        """The limits that the board enforces."""
        return cls(np.radians(servo.angle_min_deg), np.radians(servo.angle_max_deg))

    def clip(self, q_rad: ArrayLike) -> FloatArray:
        """Motor angles clipped to the limits, rad; shape of ``q_rad``."""
        return np.clip(np.asarray(q_rad, dtype=np.float64), self.lower_rad, self.upper_rad)


@dataclass(frozen=True)
class Nearest:
    """Nearest reachable configurations: ``q_rad`` (N, 2), ``distance_mm`` (N,)."""

    q_rad: FloatArray
    distance_mm: FloatArray


class Workspace:
    """The reachable surface of one robot between its motor limits."""

    def __init__(self, model: ConstantCurvature, limits: MotorLimits) -> None:
        self.model = model
        self.limits = limits
        bending = model.bending_per_motor
        self._lateral = _LateralMap(model)
        self._sheet = _Sheet(
            self._lateral,
            _window(bending * limits.lower_rad[0], bending * limits.upper_rad[0]),
            _window(bending * limits.lower_rad[1], bending * limits.upper_rad[1]),
        )

    def nearest(self, lateral_mm: ArrayLike) -> Nearest:
        """Project points onto the workspace.

        Args:
            lateral_mm: desired f[0] and f[2], (N, 2), any finite numbers.

        Returns:
            The configuration of least lateral distance for each point, and that distance.
        """
        across, height = np.asarray(lateral_mm, dtype=np.float64).T
        # Points near the largest float overflow to infinite distance, which is acceptable.
        with np.errstate(over="ignore"):
            theta_1, theta_2 = self._sheet.project(across, height)
            miss = np.hypot(
                self._lateral.across_mm(theta_2) - across,
                self._lateral.height_mm(theta_1, theta_2) - height,
            )
        return Nearest(self._motor_rad(theta_1, theta_2), miss)

    def surface_mm(self, points: tuple[int, int] = (61, 61)) -> FloatArray:
        """The workspace as a mesh, (rows, columns, 3): rows over theta_1, columns over theta_2."""
        return self.model.tip_mm(self.mesh_rad(points))

    def mesh_rad(self, points: tuple[int, int] = (61, 61)) -> FloatArray:
        """Motor angles of ``surface_mm``, (rows, columns, 2)."""
        sheet = self._sheet
        theta_2 = np.linspace(*sheet.theta_2_range, points[1])
        low, high = sheet.theta_1_range(theta_2)
        share = np.linspace(0.0, 1.0, points[0])[:, None]
        theta_1 = low + share * (high - low)
        return self._motor_rad(theta_1, np.broadcast_to(theta_2, theta_1.shape))

    def boundary_mm(self, points: int = 61) -> FloatArray:
        """The rim of the workspace as a closed line, (4 * points - 3, 3)."""
        mesh = self.surface_mm((points, points))
        return np.concatenate(
            [mesh[0], mesh[1:, -1], mesh[-1, -2::-1], mesh[-2::-1, 0]],
        )

    def _motor_rad(self, theta_1: FloatArray, theta_2: FloatArray) -> FloatArray:
        bending = np.stack([theta_1, theta_2], axis=-1)
        return self.limits.clip(bending / self.model.bending_per_motor)


class _LateralMap:
    """f[0] and f[2] of (10) as functions of the bending angles, and their slopes.

    S, V and V' of the unit arc in a form without 0/0 at zero: S = sinc(t),
    V = t/2 sinc(t/2)^2, V' = S - sinc(t/2)^2 / 2.
    """

    def __init__(self, model: ConstantCurvature) -> None:
        self._length_1, self._length_2 = model.lengths_mm
        self._offset = model.marker_offset_mm

    def across_mm(self, theta_2: FloatArray) -> FloatArray:
        return self._length_2 * 0.5 * theta_2 * _sinc(0.5 * theta_2) ** 2

    def across_slope(self, theta_2: FloatArray) -> FloatArray:
        return self._length_2 * (_sinc(theta_2) - 0.5 * _sinc(0.5 * theta_2) ** 2)

    def height_mm(self, theta_1: FloatArray, theta_2: FloatArray) -> FloatArray:
        rise = self._length_1 * 0.5 * theta_1 * _sinc(0.5 * theta_1) ** 2
        drop = self._offset * (1.0 - np.cos(theta_1))
        return rise - drop + self._length_2 * _sinc(theta_2) * np.sin(theta_1)

    def height_slope(self, theta_1: FloatArray, theta_2: FloatArray) -> FloatArray:
        rise = self._length_1 * (_sinc(theta_1) - 0.5 * _sinc(0.5 * theta_1) ** 2)
        drop = self._offset * np.sin(theta_1)
        return rise - drop + self._length_2 * _sinc(theta_2) * np.cos(theta_1)

    def height_curvature(self, theta_1: FloatArray, theta_2: FloatArray) -> FloatArray:
        rise = self._length_1 * arc_derivatives(theta_1)[2].imag
        drop = self._offset * np.cos(theta_1)
        return rise - drop - self._length_2 * _sinc(theta_2) * np.sin(theta_1)

    def height_slope_2(self, theta_1: FloatArray, theta_2: FloatArray) -> FloatArray:
        """df[2]/dtheta_2."""
        return self._length_2 * arc_derivatives(theta_2)[1].real * np.sin(theta_1)


class _Sheet:
    """The part of the workspace, around the straightest pose, with a one-to-one lateral map."""

    def __init__(
        self, lateral: _LateralMap, window_1: tuple[float, float], window_2: tuple[float, float]
    ) -> None:
        self._lateral = lateral
        self._window_1 = window_1
        low, high = _monotone_piece(lateral.across_slope, window_2)
        self.theta_2_range = float(low[0]), float(high[0])
        self._rim_theta_2 = np.linspace(*self.theta_2_range, _RIM_GRID)
        self._rim_theta_1 = _monotone_piece(
            lambda theta_1: lateral.height_slope(theta_1, self._rim_theta_2), window_1
        )

    def theta_1_range(self, theta_2: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Ends of the monotone piece of f[2] at each theta_2."""
        low, high = (self._rim(ends, theta_2) for ends in self._rim_theta_1)
        return low, high

    def _rim(self, tabulated: FloatArray, theta_2: FloatArray) -> FloatArray:
        theta_1 = np.interp(theta_2, self._rim_theta_2, tabulated)
        at_limit = np.interp(theta_2, self._rim_theta_2, np.isin(tabulated, self._window_1)) == 1.0
        for _ in range(_NEWTON_STEPS):
            slope = self._lateral.height_slope(theta_1, theta_2)
            curvature = self._lateral.height_curvature(theta_1, theta_2)
            step = np.where(
                at_limit | (curvature == 0.0),
                0.0,
                slope / np.where(curvature == 0.0, 1.0, curvature),
            )
            theta_1 = np.clip(theta_1 - step, *self._window_1)
        return theta_1

    def project(self, across: FloatArray, height: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Bending angles of the nearest points, (N,) each."""
        low, high = (np.full(across.shape, end) for end in self.theta_2_range)
        theta_2 = _solve_monotone(self._lateral.across_mm, across, low, high)
        theta_1 = self._reach_height(theta_2, height)
        excess = height - self._lateral.height_mm(theta_1, theta_2)
        beyond = np.abs(excess) > _EXACT_MM
        if np.any(beyond):
            theta_2[beyond] = self._along_rim(across[beyond], height[beyond])
            theta_1[beyond] = self._reach_height(theta_2[beyond], height[beyond])
        return theta_1, theta_2

    def _reach_height(self, theta_2: FloatArray, height: FloatArray) -> FloatArray:
        def height_at(theta_1: FloatArray) -> FloatArray:
            return self._lateral.height_mm(theta_1, theta_2)

        return _solve_monotone(height_at, height, *self.theta_1_range(theta_2))

    def _along_rim(self, across: FloatArray, height: FloatArray) -> FloatArray:
        """theta_2 of least distance for points whose height is not reachable at the exact f[0]."""
        grid = self._rim_theta_2
        ends = [self._lateral.height_mm(theta_1, grid) for theta_1 in self._rim_theta_1]
        reached = np.clip(height[:, None], np.minimum(*ends), np.maximum(*ends))
        distance = np.hypot(
            self._lateral.across_mm(grid) - across[:, None], reached - height[:, None]
        )
        nearest = np.argmin(distance, axis=1)
        left = grid[np.maximum(nearest - 1, 0)]
        right = grid[np.minimum(nearest + 1, _RIM_GRID - 1)]

        def growing(theta_2: FloatArray) -> FloatArray:
            # Slope of the distance. theta_1 is either at a limit or where df[2]/dtheta_1 = 0, so
            # it drops out.
            theta_1 = self._reach_height(theta_2, height)
            across_error = self._lateral.across_mm(theta_2) - across
            height_error = self._lateral.height_mm(theta_1, theta_2) - height
            distance = np.maximum(np.hypot(across_error, height_error), _EXACT_MM)
            return across_error / distance * self._lateral.across_slope(
                theta_2
            ) + height_error / distance * self._lateral.height_slope_2(theta_1, theta_2)

        return _solve_monotone(growing, np.zeros(across.shape), left, right)


def _window(lower: float, upper: float) -> tuple[float, float]:
    """Bending angles to search: up to a full turn beyond the straightest allowed.

    Beyond that the backbone only winds up and reaches less far.
    """
    straightest = _straightest(lower, upper)
    turn = 2.0 * math.pi
    return max(lower, straightest - turn), min(upper, straightest + turn)


def _straightest(lower: float, upper: float) -> float:
    return min(max(0.0, lower), upper)


def _sinc(x: FloatArray) -> FloatArray:
    """sin(x) / x."""
    return np.asarray(np.sinc(x / np.pi), dtype=np.float64)


def _monotone_piece(
    slope: Callable[[FloatArray], FloatArray], window: tuple[float, float]
) -> tuple[FloatArray, FloatArray]:
    """Largest interval around the straightest pose of the window where the slope keeps its sign.

    ``slope`` maps (N,) or (grid, 1) angles to (N,) or (grid, N) slopes.
    """
    anchor = _straightest(*window)
    return _first_turn(slope, anchor, window[0]), _first_turn(slope, anchor, window[1])


def _first_turn(slope: Callable[[FloatArray], FloatArray], anchor: float, end: float) -> FloatArray:
    steps = max(1, math.ceil(abs(end - anchor) / _MARCH_STEP_RAD))
    grid = np.linspace(anchor, end, steps + 1)
    slopes = slope(grid[:, None])
    sign = np.where(slopes[0] == 0.0, np.sign(slopes[1]), np.sign(slopes[0]))
    turned = slopes * sign < 0.0
    turned[-1] = True
    first = np.argmax(turned, axis=0)
    inside, outside = grid[first - 1], grid[first]
    for _ in range(_HALVINGS):
        middle = 0.5 * (inside + outside)
        keeps = slope(middle) * sign >= 0.0
        inside = np.where(keeps, middle, inside)
        outside = np.where(keeps, outside, middle)
    piece_end: FloatArray = np.where(slope(outside) * sign >= 0.0, outside, inside)
    return piece_end


def _solve_monotone(
    function: Callable[[FloatArray], FloatArray],
    value: FloatArray,
    low: FloatArray,
    high: FloatArray,
) -> FloatArray:
    """Argument at which a monotone function takes the value; the nearer end if there is none."""
    rising = function(high) >= function(low)
    below, above = np.where(rising, low, high), np.where(rising, high, low)
    for _ in range(_HALVINGS):
        middle = 0.5 * (below + above)
        too_low = function(middle) < value
        below = np.where(too_low, middle, below)
        above = np.where(too_low, above, middle)
    return 0.5 * (below + above)
