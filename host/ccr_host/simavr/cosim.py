"""Simulated UNO and simulated robot in one order of time."""

from __future__ import annotations

from ccr_host.simavr.line import SimavrLine
from ccr_host.simavr.pulse_meter import Pulse
from ccr_host.twin.scene import TwinScene


class SimavrCoSimulation:
    """Wires the servo pins to the twin's servos.

    A servo knows a pulse when it has ended. Nothing goes from the robot to the board, so the board
    may run ahead by a slice of the clock and the pulses of that slice are then played to the robot.
    """

    def __init__(self, line: SimavrLine, scene: TwinScene) -> None:
        self._line = line
        self._scene = scene
        self._pulses: list[Pulse] = []
        self._half_us = [0, 0]
        line.board.observe_pulses(self._pulses.append)

    def advance_to(self, time_us: int) -> None:
        """Bring wire, board, servos, structure and camera to ``time_us``."""
        self._line.advance_to(time_us)
        for pulse in sorted(self._pulses, key=lambda pulse: pulse.end_cycle):
            self._scene.advance_to(self._line.board.time_us(pulse.end_cycle))
            self._half_us[pulse.pin] = pulse.half_us
            self._scene.set_pulses_half_us((self._half_us[0], self._half_us[1]))
        self._pulses.clear()
        self._scene.advance_to(time_us)
