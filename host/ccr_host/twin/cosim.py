"""Emulated board and simulated robot in one order of time."""

from __future__ import annotations

from ccr_host.emulator.serial_line import SerialLine
from ccr_host.twin.scene import TwinScene


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
