"""The simulated robot under its simulated camera."""

from __future__ import annotations

from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from ccr_host.sim.board.serial_line import SerialLine
from ccr_host.sim.robot.robot import TwinRobot


class CoSimulation:
    """Wires the board's servo pins to the twin's servos.

    A pulse width holds for a whole frame, so both sides only meet at the frames' starts.
    """

    def __init__(self, line: SerialLine, scene: TwinScene) -> None:
        self._line = line
        self._scene = scene

    @property
    def next_turn_us(self) -> int:
        """When the host may hear something next; what else happens needs no turn of its own."""
        return self._line.next_event_us

    def advance_to(self, time_us: int) -> None:
        """Bring wire, board, servos, structure and camera to ``time_us``."""
        board = self._line.board
        while (frame_us := board.next_frame_us) <= time_us:
            self._line.advance_to(frame_us)
            self._scene.advance_to(frame_us)
            self._scene.set_pulses_half_us(board.pulses_half_us)
        self._line.advance_to(time_us)
        self._scene.advance_to(time_us)


class ExposedCamera(Protocol):
    """A simulated camera, as the scene that it looks at knows it."""

    @property
    def next_exposure_us(self) -> int:
        """When to call ``expose`` next."""

    def expose(self, time_us: int, markers_mm: NDArray[np.float64]) -> None:
        """Take a picture of the markers, (3, 3), one a row, in the robot's frame."""


class TwinScene:
    """Moves the robot in time and lets the camera see it at each exposure."""

    def __init__(self, robot: TwinRobot, camera: ExposedCamera) -> None:
        self._robot = robot
        self._camera = camera

    def set_pulses_half_us(self, pulses_half_us: tuple[int, int]) -> None:
        """Servo pulses from now on, half microseconds; 0 means no pulse."""
        self._robot.set_pulses_half_us(pulses_half_us)

    def advance_to(self, time_us: int) -> None:
        """Bring robot and camera to ``time_us``."""
        while (exposure_us := self._camera.next_exposure_us) <= time_us:
            self._robot.advance_to(exposure_us)
            self._camera.expose(exposure_us, self._robot.markers_mm())
        self._robot.advance_to(time_us)

    def start_path_clock(self, time_us: int) -> None:
        """Zero of the disturbances that the description times."""
        self._robot.start_path_clock(time_us)

    def true_tip_mm(self) -> NDArray[np.float64]:
        """f of (10) as it really is, (3,): M3 - M1 without noise and latency."""
        return self._robot.tip_mm()
