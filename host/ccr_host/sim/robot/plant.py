"""The interface of a simulated robot: the twin, or a user's plug-in."""

from __future__ import annotations

from abc import abstractmethod
from typing import Any, Protocol

import numpy as np

from ccr_host.core.arrays import Array
from ccr_host.core.plugins import Guard

TWIN = "twin"
"""Name of the default plant."""


class Plant(Protocol):
    """A simulated robot: servo pulses in, marker positions out.

    A plug-in is constructed with the robot description. It derives from this class, or has the same
    methods, of which the last two are then optional. It starts at time 0, without pulses.
    """

    @abstractmethod
    def set_pulses_half_us(self, pulses_half_us: tuple[int, ...]) -> None:
        """Set the pulse widths from now on, in half microseconds, one per servo; 0: no pulse."""

    @abstractmethod
    def advance_to(self, time_us: int) -> None:
        """Simulate up to a time in us, which never decreases."""

    @abstractmethod
    def markers_mm(self) -> Array:
        """Positions of M1 (base) and the marker at the end of each of S segments, (S + 1, 3), mm.

        The frame is the robot's, that of (10).
        """

    def tip_mm(self) -> Array:
        """True tip f of (10) in mm, (3,), used for the metrics only."""
        markers_mm = self.markers_mm()
        tip: Array = markers_mm[-1] - markers_mm[0]
        return tip

    def start_path_clock(self, time_us: int) -> None:
        """Set the time, us, at which the path starts: zero of disturbances such as a payload."""


class GuardedPlant(Plant):
    """A plug-in whose failures are reported as such.

    It has at least the abstract methods of `Plant`, and as many markers as are given.
    """

    def __init__(self, plant: Plant, name: str, markers: int) -> None:
        self._plant = plant
        self._guard = Guard(f"{name}: {type(plant).__name__}", "plant")
        self._answers: dict[str, Array] = {
            "markers_mm": np.zeros((markers, 3)),
            "tip_mm": np.zeros(3),
        }

    def set_pulses_half_us(self, pulses_half_us: tuple[int, ...]) -> None:
        self._call("set_pulses_half_us", pulses_half_us)

    def advance_to(self, time_us: int) -> None:
        self._call("advance_to", time_us)

    def markers_mm(self) -> Array:
        self._call("markers_mm")
        return self._answers["markers_mm"]

    def tip_mm(self) -> Array:
        if not hasattr(self._plant, "tip_mm"):
            return super().tip_mm()
        self._call("tip_mm")
        return self._answers["tip_mm"]

    def start_path_clock(self, time_us: int) -> None:
        if hasattr(self._plant, "start_path_clock"):
            self._call("start_path_clock", time_us)

    def _call(self, method: str, *arguments: Any) -> None:  # noqa: ANN401 - those of the method
        if self._guard.has_failed:
            return
        with self._guard.blamed(method):
            answer = getattr(self._plant, method)(*arguments)
            if method in self._answers:
                self._answers[method] = _checked(answer, self._answers[method].shape)


def _checked(answer: object, shape: tuple[int, ...]) -> Array:
    """A copy of an answer as an array.

    Raises:
        TypeError, ValueError: no real numbers, wrong shape, or not finite.
    """
    array = np.asarray(answer).astype(np.float64, casting="same_kind")
    if array.shape != shape:
        raise ValueError(f"the answer has the shape {array.shape} instead of {shape}")
    if not np.isfinite(array).all():
        raise ValueError(f"the answer is not finite: {array.tolist()}")
    return array
