"""Segment 1 as a chain of hinges at rest, link by link: the judge of the arc that is fitted.

Its tendon loses tension at each hole and is straight between holes; each link has its weight. So it
shares no formula with the arc.
"""

from __future__ import annotations

import numpy as np
from scipy.optimize import root

LENGTH_MM, LENGTH_2_MM, OFFSET_MM, RADIUS_MM = 58.5, 43.5, 15.0, 4.5
STIFFNESS_NM = 0.02
DISK_N, MARKER_N = 0.8e-3 * 9.81, 3e-3 * 9.81
"""Segment 1 weighs as much as six disks, whatever the number of its hinges."""
DISKS_2 = 5


class HingedChain:
    """Segment 1 with its marker, and a straight segment 2.

    Args:
        friction: coefficient of friction of the tendons at each hole.
        taper: share by which it is softer at its end than at its start.
        hinges: number of hinges.
        gravity: direction along -y and z of (10), of length 1 at most.
    """

    def __init__(
        self,
        friction: float = 0.0,
        taper: float = 0.0,
        hinges: int = 6,
        gravity: complex = -1j,
    ) -> None:
        self._friction, self._hinges, self._gravity = friction, hinges, gravity
        middles = (np.arange(hinges) + 0.5) / hinges
        self._stiffness_nm = hinges * STIFFNESS_NM / (1.0 + taper * (middles - 0.5))
        self._half_mm = LENGTH_MM / hinges / 2

    def markers_mm(self, bending_rad: float, way: float) -> np.ndarray:
        """M1, M2 and M3, (3, 3), in the frame of (10).

        Args:
            bending_rad: angle at the end of segment 1.
            way: sign of the last change of the bending.
        """

        def off(unknowns: np.ndarray) -> np.ndarray:
            *bends, pull_n = unknowns
            moments = self._moments_nm(np.array(bends), 10.0 * pull_n, way)
            return np.append(moments, sum(bends) - bending_rad)

        even = np.full(self._hinges, bending_rad / self._hinges)
        found = root(off, np.append(even, 0.4 * bending_rad + 1e-3), tol=1e-12)
        assert np.abs(found.fun).max() < 1e-9
        disks, _, turns = self._places(found.x[:-1])
        tilt = np.exp(1j * turns[-1])
        first, second = 1j * OFFSET_MM, disks[-1] + 1j * OFFSET_MM * tilt
        return np.array(
            [(0, -s.real, s.imag) for s in (first, second, second + LENGTH_2_MM * tilt)]
        )

    def _places(self, bends: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Disks and hinges as -y + iz, and the angles of the disks."""
        turns = np.cumsum(bends)
        before = np.exp(1j * np.append(0.0, turns[:-1]))
        steps = self._half_mm * (before + np.exp(1j * turns))
        disks = np.append(0.0, np.cumsum(steps))
        return disks, disks[:-1] + self._half_mm * before, turns

    def _moments_nm(self, bends: np.ndarray, pull_n: float, way: float) -> np.ndarray:
        """Moments that are left at the hinges, 0 at rest."""
        disks, hinges, turns = self._places(bends)
        side, tilt = np.sign(pull_n), np.exp(1j * turns[-1])
        beyond = LENGTH_2_MM * np.arange(1, DISKS_2 + 1) / DISKS_2
        marker = 1j * OFFSET_MM
        points = np.concatenate(
            [disks[1:], disks[-1] + tilt * np.array([marker, LENGTH_2_MM + marker, *beyond])]
        )
        loads_n = np.array(
            [6 * DISK_N / self._hinges] * self._hinges + [MARKER_N] * 2 + [DISK_N] * DISKS_2
        )
        left = np.empty(self._hinges)
        for number, (bend, hinge) in enumerate(zip(bends, hinges, strict=True)):
            wrapped = np.abs(bends[:number]).sum()
            tension_n = abs(pull_n) * np.exp(-way * side * self._friction * wrapped)
            lever_mm = RADIUS_MM * np.cos(bend / 2) + side * self._half_mm * np.sin(bend / 2)
            arms_mm = points[number:] - hinge
            force_n = loads_n[number:] * self._gravity
            weight_nmm = np.sum(arms_mm.real * force_n.imag - arms_mm.imag * force_n.real)
            spring = self._stiffness_nm[number] * bend
            left[number] = spring - 1e-3 * (side * tension_n * lever_mm + weight_nmm)
        return left
