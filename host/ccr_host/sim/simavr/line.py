"""The serial line between host and simulated UNO; its host end is a transport."""

from __future__ import annotations

from ccr_host.link.messages import BAUD, ResetCause
from ccr_host.sim.robot.scene import TwinScene
from ccr_host.sim.simavr.board import Pulse, SimavrBoard


class SimavrCoSimulation:
    """Connects the servo pins to the twin's servos.

    A servo acts on a pulse when it has ended. The robot has no effect on the board, so the board
    runs ahead by a slice of the clock, and the pulses of that slice are then applied to the robot.
    ``servos`` are those of the robot, at the first pins.
    """

    def __init__(self, line: SimavrLine, scene: TwinScene, servos: int = 2) -> None:
        self._line = line
        self._scene = scene
        self._pulses: list[Pulse] = []
        self._half_us = [0] * servos
        line.board.observe_pulses(self._pulses.append)

    def advance_to(self, time_us: int) -> None:
        self._line.advance_to(time_us)
        fitting = [pulse for pulse in self._pulses if pulse.pin < len(self._half_us)]
        for pulse in sorted(fitting, key=lambda pulse: pulse.end_cycle):
            self._scene.advance_to(self._line.board.time_us(pulse.end_cycle))
            self._half_us[pulse.pin] = pulse.half_us
            self._scene.set_pulses_half_us(tuple(self._half_us))
        self._pulses.clear()
        self._scene.advance_to(time_us)


_BUSY_US = 100
"""Polling period in real time while bytes are transmitted; a byte takes at least 40 us."""
_QUIET_US = 1000
_ANSWER_US = 2000
"""Time after the last byte within which an answer may be on its way."""


class SimavrLine:
    """Same interface as the emulator's line; the timing of bytes is that of the simulated UART.

    ``baud`` is the host's bit rate; None follows the board, as a boot loader uses another rate.
    """

    name = "simavr"

    def __init__(self, board: SimavrBoard, *, baud: int | None = BAUD) -> None:
        self.board = board
        self._baud = baud
        self._quiet_since_us = board.now_us

    def advance_to(self, time_us: int) -> None:
        self.board.advance_to(time_us)
        if self.board.line_is_busy:
            self._quiet_since_us = time_us

    @property
    def next_event_us(self) -> int:
        """Time of the next poll if the host sends nothing."""
        now_us = self.board.now_us
        talking = now_us - self._quiet_since_us < _ANSWER_US
        return now_us + (_BUSY_US if talking else _QUIET_US)

    def write(self, data: bytes) -> None:
        self.board.receive(data, self._baud)
        self._quiet_since_us = self.board.now_us

    def read(self) -> bytes:
        return self.board.take_output()

    def close(self) -> None:
        """Do nothing: the board keeps running, like an UNO on a power supply."""

    def open_port(self, boot_loader_us: int = 0) -> None:
        """Reset the board, as DTR resets an UNO when its port is opened.

        ``boot_loader_us`` is ignored: the board has a real boot loader or none.
        """
        self.board.forget_unsent()
        self.board.reset(ResetCause.EXTERNAL)
