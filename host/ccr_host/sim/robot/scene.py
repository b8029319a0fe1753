"""The simulated robot observed by its simulated camera."""

from __future__ import annotations

from typing import Protocol

from ccr_host.core.arrays import Array
from ccr_host.core.plugins import is_plugin, make_plugin, unknown_plugin
from ccr_host.description.schema import Description
from ccr_host.sim.board.board import SerialLine
from ccr_host.sim.robot.plant import TWIN, GuardedPlant, Plant
from ccr_host.sim.robot.robot import TwinRobot


class CoSimulation:
    """Connects the board's servo pins to the twin's servos.

    A pulse width is constant during a frame, so both sides are coupled only at frame starts.
    """

    def __init__(self, line: SerialLine, scene: TwinScene) -> None:
        self._line = line
        self._scene = scene

    @property
    def next_turn_us(self) -> int:
        """Time at which the host may next receive something; other events need no turn."""
        return self._line.next_event_us

    def advance_to(self, time_us: int) -> None:
        """Advance line, board, servos, structure and camera to ``time_us``."""
        board = self._line.board
        while (frame_us := board.next_frame_us) <= time_us:
            self._line.advance_to(frame_us)
            self._scene.advance_to(frame_us)
            self._scene.set_pulses_half_us(board.pulses_half_us)
        self._line.advance_to(time_us)
        self._scene.advance_to(time_us)


def make_plant(name: str, description: Description) -> Plant:
    """Construct the simulated robot that ``--plant`` names.

    Raises:
        ConfigError: unknown name, or a description that the twin cannot simulate.
        CodeError: the plug-in cannot be constructed.
    """
    if name == TWIN:
        return TwinRobot(description.twin)
    if not is_plugin("plant", name):
        raise unknown_plugin("plant", name, [TWIN])
    methods = ("set_pulses_half_us", "advance_to", "markers_mm")
    plant = make_plugin("plant", name, methods, description)
    return GuardedPlant(plant, name, len(description.robot.markers))


class ExposedCamera(Protocol):
    """A simulated camera as seen by the scene."""

    @property
    def next_exposure_us(self) -> int:
        """Time of the next call of ``expose``."""

    def expose(self, time_us: int, markers_mm: Array) -> None:
        """Expose the markers, (S + 1, 3), in the robot frame."""


class TwinScene:
    """Advances the robot and exposes the camera at the times of its exposures."""

    def __init__(self, robot: Plant, camera: ExposedCamera) -> None:
        self._robot = robot
        self._camera = camera

    def set_pulses_half_us(self, pulses_half_us: tuple[int, ...]) -> None:
        self._robot.set_pulses_half_us(pulses_half_us)

    def advance_to(self, time_us: int) -> None:
        while (exposure_us := self._camera.next_exposure_us) <= time_us:
            self._robot.advance_to(exposure_us)
            self._camera.expose(exposure_us, self._robot.markers_mm())
        self._robot.advance_to(time_us)

    def start_path_clock(self, time_us: int) -> None:
        self._robot.start_path_clock(time_us)

    def true_tip_mm(self) -> Array:
        """True f of (10), (3,): last marker - M1 without noise and latency."""
        return self._robot.tip_mm()
