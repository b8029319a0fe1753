"""What a peer has to bring: a control law; ``loop.PeerLoop`` makes a controller of it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from ccr_host.robot.reference import Reference

FloatArray = NDArray[np.float64]

LONGEST_ERROR_MM = 40.0
"""A larger error counts as this: above the 30 mm by which the model alone misses the path, below
what a marker taken for another one shows."""


def shortened(error_mm: FloatArray, longest_mm: float) -> FloatArray:
    """The vector, scaled down to a length where it is longer."""
    length_mm = float(np.linalg.norm(error_mm))
    return error_mm if length_mm <= longest_mm else error_mm * (longest_mm / length_mm)


class PathView:
    """A reference between its samples; positions are fractional step indices, held at the ends."""

    def __init__(self, reference: Reference) -> None:
        self._reference = reference
        self._samples = np.arange(len(reference), dtype=np.float64)
        self.period_s = reference.period_s
        self.last = len(reference) - 1.0

    def target_mm(self, index: float) -> FloatArray:
        """Desired tip, (3,)."""
        return self._between(index, self._reference.target_mm)

    def reachable_rad(self, index: float) -> FloatArray:
        """Nearest reachable motor angles by the model, (2,)."""
        return self._between(index, self._reference.q_rad)

    def _between(self, index: float, rows: FloatArray) -> FloatArray:
        return np.array([np.interp(index, self._samples, column) for column in rows.T])


@dataclass(frozen=True)
class Sight:
    """One new measurement, and what was commanded when it was taken."""

    tip_mm: FloatArray
    """(3,), finite."""
    setpoint_rad: FloatArray
    """In effect at the exposure, command delay taken off, (2,)."""
    index: float | None
    """Step index that this setpoint aimed at; None where it followed no path."""
    elapsed_s: float
    """Since the sight before; the control period for the first one."""


@dataclass(frozen=True)
class Plan:
    """Motor angles to go to, (2,), and the tips they should lead to, (k, 3)."""

    q_rad: FloatArray
    predicted_mm: FloatArray


class Law(Protocol):
    """A feedback law with time, limits and lost markers taken care of by ``loop.PeerLoop``."""

    def start(self, path: PathView) -> None:
        """Forget everything; a new path begins."""
        ...

    def observe(self, sight: Sight) -> None:
        """Take in a measurement."""
        ...

    def plan(self, index: float, commanded_rad: FloatArray) -> Plan:
        """Where to go so as to be at step ``index`` of the path when it has taken effect."""
        ...
