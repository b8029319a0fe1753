"""The board under test, from outside only: bytes, time, reset; in step also pins and EEPROM."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Protocol

from ccr_host.link import messages as m
from ccr_host.sim.board.board import SerialLine, UnoEmulator
from ccr_host.sim.board.eeprom import EepromImage
from ccr_host.sim.simavr.board import Pulse, SimavrBoard, SimavrLine
from ccr_host.sim.simavr.flash_image import read_flash_image
from tests.conformance.firmware_build import firmware_elf

AXES = 2
"""Axes of the boards under test."""

PULSES_OVER_US = 3_000
"""Into a frame, when every pulse of an UNO has ended."""
FIRST_START_US, STAGGER_US = 2_000, 3_500
"""Delay from a frame's start to the first pulses of a Mega, and between those of its timers."""

_ANSWER_TIMEOUT_US = 15_000
"""Response time of TIM-5."""


Pulses = tuple[int, ...]
"""Pulses of each axis, in 0.5 us; 0 is no pulse."""


def pulse_start_us(board: str, axis: int) -> int:
    """Delay from the start of a frame to that of the axis's pulse (docs/firmware.md)."""
    if board == "uno":
        return 0
    return FIRST_START_US + STAGGER_US * ((axis if axis < 8 else axis + 1) % 4)


def _axes_flags(board: str, axes: int) -> tuple[str, ...]:
    usual = {"uno": 2, "mega2560": 12}[board]
    return () if axes == usual else ("-UCCR_AXES", f"-DCCR_AXES={axes}")


class Device(Protocol):
    """A board and its wire; time counts from the start of its first frame after a reset.

    It has been started, and listens.
    """

    in_step: bool
    """Whether its time is that of the test, to a tick."""
    answer_timeout_us: int
    """Time after which an answer counts as missing."""

    def send(self, data: bytes) -> None: ...

    def advance_to(self, since_reset_us: int) -> None: ...

    def since_reset_us(self) -> int: ...

    def read(self) -> bytes: ...

    def reset(self, cause: m.ResetCause) -> None: ...

    def close(self) -> None: ...


class SteppedDevice(Device, Protocol):
    """A simulated board with access to its pins and EEPROM."""

    eeprom: EepromImage

    def pulses_in_frame(self, frame: int) -> Pulses:
        """Pulses on the pins in a frame since the reset, 0.5 us; goes on until they have ended."""


class EmulatedDevice:
    """The emulator as a device."""

    in_step = True
    answer_timeout_us = _ANSWER_TIMEOUT_US

    def __init__(self, eeprom: EepromImage, **start_values: int) -> None:
        self.eeprom = eeprom
        self.board = UnoEmulator(eeprom, **start_values)
        self._line = SerialLine(self.board)
        self._reset_us = 0
        self.advance_to(m.LISTENS_AFTER_US)

    def send(self, data: bytes) -> None:
        self._line.write(data)

    def advance_to(self, since_reset_us: int) -> None:
        self._line.advance_to(self._reset_us + since_reset_us)

    def since_reset_us(self) -> int:
        return self.board.now_us - self._reset_us

    def read(self) -> bytes:
        return self._line.read()

    def pulses_in_frame(self, frame: int) -> Pulses:
        self.advance_to(frame * m.TICK_US + PULSES_OVER_US)
        return self.board.pulses_half_us

    def reset(self, cause: m.ResetCause) -> None:
        self.board.reset(cause)
        self._reset_us = self.board.now_us
        self.advance_to(m.LISTENS_AFTER_US)

    def close(self) -> None:
        pass


_GTCCR = 0x43
_TIMERS_HELD = 0x80
_TCCR1B = 0x81
_CLOCK_SELECT = 0x07
_PROBE_US = 1
_START_UP_LIMIT_US = 20_000


class SimavrDevice:
    """The firmware's binary in simavr; pulses are measured between the edges on the pins."""

    in_step = True
    answer_timeout_us = _ANSWER_TIMEOUT_US

    def __init__(
        self,
        eeprom: EepromImage,
        elf: Path | None = None,
        *,
        board: str = "uno",
        axes: int = AXES,
        **start_values: int,
    ) -> None:
        flags = {
            "board_time_at_reset_us": "CCR_TIME_AT_RESET_US",
            "tick_offset": "CCR_TICK_AT_RESET",
        }
        given = (f"-D{flags[name]}={value}UL" for name, value in start_values.items())
        elf = elf or firmware_elf(*given, *_axes_flags(board, axes), board=board)
        self._axes = axes
        self._start_us = tuple(pulse_start_us(board, axis) for axis in range(axes))
        self.eeprom = eeprom
        self.board = SimavrBoard(read_flash_image(elf), eeprom=eeprom)
        for address in eeprom.worn_out:
            self.board.mcu.wear_out_eeprom(address)
        self._line = SimavrLine(self.board)
        self._pulses: dict[tuple[int, int], int] = {}
        self._in_reset = False
        self.board.observe_pulses(self._note)
        self._wait_for_first_frame()

    def send(self, data: bytes) -> None:
        self._line.write(data)

    def advance_to(self, since_reset_us: int) -> None:
        self._line.advance_to(self._first_frame_us + since_reset_us)

    def since_reset_us(self) -> int:
        return self.board.now_us - self._first_frame_us

    def read(self) -> bytes:
        return self._line.read()

    def pulses_in_frame(self, frame: int) -> Pulses:
        self.advance_to(frame * m.TICK_US + max(self._start_us) + PULSES_OVER_US)
        return self.seen_in_frame(frame)

    def seen_in_frame(self, frame: int) -> Pulses:
        """Pulses in a frame that is over."""
        return tuple(self._pulses.get((frame, axis), 0) for axis in range(self._axes))

    def reset(self, cause: m.ResetCause) -> None:
        self.board.load_eeprom()
        self._in_reset = True  # which may cut a pulse
        self.board.reset(cause)
        self.board.advance_to(self.board.now_us + _PROBE_US)
        self._in_reset = False
        self._pulses.clear()
        self._wait_for_first_frame()

    def close(self) -> None:
        self.board.close()

    def _note(self, pulse: Pulse) -> None:
        # Pin 13 of a Mega, which comes last, shows the LED on a board of fewer axes.
        if pulse.width_cycles and not self._in_reset and pulse.pin < self._axes:
            begin_us = self.board.time_us(pulse.end_cycle - pulse.width_cycles)
            begin_us -= self._first_frame_us + self._start_us[pulse.pin]
            frame = round(begin_us / m.TICK_US)
            assert abs(begin_us - frame * m.TICK_US) <= _PROBE_US, "pulses begin with their frame"
            assert pulse.width_cycles % 8 == 0, "pulses have no jitter"
            self._pulses[frame, pulse.pin] = pulse.half_us

    def _wait_for_first_frame(self) -> None:
        """Frames begin when the firmware lets the timers go."""
        begin_us = self.board.now_us
        while not self._timers_run():
            assert self.board.now_us < begin_us + _START_UP_LIMIT_US, "the firmware does not start"
            self.board.advance_to(self.board.now_us + _PROBE_US)
        self._first_frame_us = self.board.now_us - _PROBE_US
        self.advance_to(m.LISTENS_AFTER_US)

    def _timers_run(self) -> bool:
        memory = self.board.mcu.memory
        return not memory[_GTCCR] & _TIMERS_HELD and bool(memory[_TCCR1B] & _CLOCK_SELECT)


IN_STEP: dict[str, Callable[..., SteppedDevice]] = {
    "emulator:": EmulatedDevice,
    "simavr:": SimavrDevice,
    "mega2560:": partial(SimavrDevice, board="mega2560"),
}
"""Boards whose time is that of the test."""
