"""An UNO or a Mega 2560 with the real firmware, its serial line, and the robot at its pins.

Bytes in, bytes and servo pulses out, in us.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from ccr_host.core.errors import ConfigError
from ccr_host.link.messages import BAUD, EEPROM_SIZE, TICK_US, ResetCause
from ccr_host.sim.board.core import Inputs
from ccr_host.sim.board.eeprom import EepromImage
from ccr_host.sim.simavr.flash_image import FlashImage
from ccr_host.sim.simavr.mcu import (
    CLOCK_HZ,
    CYCLES_PER_HALF_US,
    CYCLES_PER_US,
    LED_PIN,
    SERVO_SUPPLY_PIN,
    Mcu,
    News,
)

if TYPE_CHECKING:  # the board alone needs no MuJoCo
    from ccr_host.sim.robot.scene import TwinScene

_MISSING_CYCLES = TICK_US * CYCLES_PER_US * 3 // 2
"""A pulse counts as missing half a frame after it was due."""


@dataclass(frozen=True, slots=True)
class Edge:
    """Edge at a servo pin; a pin that is not driven counts as low."""

    cycle: int
    pin: int
    level: bool


@dataclass(frozen=True, slots=True)
class Pulse:
    """A pulse that has ended, or the absence of one."""

    pin: int
    end_cycle: int
    width_cycles: int
    """0: there was no pulse for 1.5 frames."""

    @property
    def half_us(self) -> int:
        """Width, rounded to 0.5 us."""
        return (self.width_cycles + CYCLES_PER_HALF_US // 2) // CYCLES_PER_HALF_US


class PulseMeter:
    """Turns edges into pulses."""

    def __init__(self, pins: int) -> None:
        self._rise_cycle: list[int | None] = [None] * pins
        self._newest: list[Pulse | None] = [None] * pins

    def take(self, edge: Edge) -> Pulse | None:
        """Process the next edge; return the pulse that it ends, if any."""
        rise_cycle = self._rise_cycle[edge.pin]
        self._rise_cycle[edge.pin] = edge.cycle if edge.level else None
        if edge.level or rise_cycle is None:
            return None
        pulse = Pulse(edge.pin, edge.cycle, edge.cycle - rise_cycle)
        self._newest[edge.pin] = pulse
        return pulse

    def missing(self, cycle: int) -> list[Pulse]:
        """Pulses missing at `cycle`, one per pin, each reported once."""
        found = []
        for pin, pulse in enumerate(self._newest):
            if pulse and cycle - pulse.end_cycle > _MISSING_CYCLES:
                self._newest[pin] = None
                found.append(Pulse(pin, pulse.end_cycle + _MISSING_CYCLES, 0))
        return found

    @property
    def half_us(self) -> tuple[int, ...]:
        """Newest pulse of each pin, in 0.5 us; 0 if there is none."""
        return tuple(pulse.half_us if pulse else 0 for pulse in self._newest)


EdgeObserver = Callable[[Edge], None]
PulseObserver = Callable[[Pulse], None]

_SRAM_AT_POWER_ON = 0xA5
"""Real SRAM powers up with arbitrary content; zeros would hide missing initialisation."""


@dataclass(frozen=True, slots=True)
class Departure:
    """A byte sent by the board: start of its start bit, end of its stop bit."""

    start_cycle: int
    end_cycle: int
    value: int


class SimavrBoard:
    """The whole board, in lockstep with the caller's clock: 16 cycles per microsecond.

    Resets start the ``boot_loader``, if there is one. ``eeprom`` is the content at the start and
    receives what the firmware writes. ``profiling`` also monitors stack and interrupt mask; it is
    several times slower.

    Raises:
        DeviceError: the simulator is not available.
    """

    def __init__(
        self,
        firmware: FlashImage,
        *,
        boot_loader: FlashImage | None = None,
        eeprom: EepromImage | None = None,
        reset_cause: ResetCause = ResetCause.POWER_ON,
        start_us: int = 0,
        profiling: bool = False,
    ) -> None:
        self.mcu = Mcu(firmware.board)
        """The chip, to look inside."""
        self._symbols = firmware.symbols
        self._eeprom = eeprom if eeprom is not None else EepromImage()
        self._start_us = start_us
        self._now_us = start_us
        self.line_is_busy = False
        """Whether a byte is being transmitted in either direction."""
        self._meter = PulseMeter(self.mcu.servos)
        self._output_is_high = {SERVO_SUPPLY_PIN: False, LED_PIN: False}
        self._edge_observers: list[EdgeObserver] = []
        self._pulse_observers: list[PulseObserver] = []
        self.load_eeprom()
        self._load(firmware)
        if boot_loader:
            self._load(boot_loader)
            self.mcu.start_at(boot_loader.start)
        self.mcu.profile(profiling)
        self.set_supply_pin_mv(Inputs.supply_pin_mv)
        self.reset(reset_cause)

    def close(self) -> None:
        """Free the simulator; no other method may be called afterwards."""
        self.mcu.close()

    # Time

    @property
    def now_us(self) -> int:
        """Time to which the board has been advanced."""
        return self._now_us

    @property
    def cycle(self) -> int:
        """Cycles since the first start, at `now_us`."""
        return (self._now_us - self._start_us) * CYCLES_PER_US

    def time_us(self, cycle: int) -> int:
        """Time of a cycle on the caller's clock, rounded down."""
        return self._start_us + cycle // CYCLES_PER_US

    def advance_to(self, time_us: int) -> None:
        """Run up to and including `time_us`.

        Raises:
            DeviceError: the program crashed.
        """
        if time_us < self._now_us:
            return
        self._now_us = time_us
        news = self.mcu.run_until(self.cycle + 1)
        self.line_is_busy = bool(news & News.LINE_BUSY)
        if news & News.EDGES:
            self._watch_pins()
        for pulse in self._meter.missing(self.cycle):
            self._notify(pulse)
        if news & News.EEPROM_WRITES:
            self._keep_eeprom_writes()

    def reset(self, cause: ResetCause) -> None:
        """Reset; only a power-up overwrites the SRAM."""
        if cause is ResetCause.POWER_ON:
            self.mcu.fill_sram(_SRAM_AT_POWER_ON)
        self.mcu.reset(cause)

    # Wire

    def receive(self, data: bytes, baud: int | None = BAUD) -> None:
        """Start to transmit bytes to the board, after those being transmitted.

        ``baud`` is the sender's bit rate; None for the rate that the firmware has set.
        """
        self.mcu.send(self.cycle, data, CLOCK_HZ // baud if baud else 0)

    def take_output(self) -> bytes:
        """Remove and return the bytes that the board has sent."""
        return self.mcu.take_departures()["value"].tobytes()

    def take_departures(self) -> list[Departure]:
        """Remove and return the bytes that the board has sent, with their times."""
        return [Departure(*map(int, departure)) for departure in self.mcu.take_departures()]

    # Pins

    def observe_edges(self, observer: EdgeObserver) -> None:
        """Call `observer` for each edge of the servo pins, in order of time."""
        self._edge_observers.append(observer)

    def observe_pulses(self, observer: PulseObserver) -> None:
        """Call `observer` for each pulse when it ends, and once when pulses stop."""
        self._pulse_observers.append(observer)

    @property
    def pulses_half_us(self) -> tuple[int, ...]:
        """Last pulses measured at the servo pins, in 0.5 us; 0 is no pulse."""
        return self._meter.half_us

    def open_emergency_stop(self, is_open: bool = True) -> None:
        """Open or close the switch between the input and ground; initially closed."""
        self.mcu.open_switch(is_open)

    def set_supply_pin_mv(self, voltage_mv: int) -> None:
        """Set the output of the servo supply's divider; initially 3000."""
        self.mcu.set_voltage_mv(voltage_mv)

    @property
    def servo_supply_on(self) -> bool:
        """Level of the pin that enables the servos' supply."""
        return self._output_is_high[SERVO_SUPPLY_PIN]

    @property
    def led_on(self) -> bool:
        """Level of the LED's pin."""
        return self._output_is_high[LED_PIN]

    def _watch_pins(self) -> None:
        for record in self.mcu.take_edges():
            edge = Edge(int(record["cycle"]), int(record["pin"]), bool(record["level"]))
            if edge.pin in self._output_is_high:
                self._output_is_high[edge.pin] = edge.level
                continue
            for observe_edge in self._edge_observers:
                observe_edge(edge)
            if pulse := self._meter.take(edge):
                self._notify(pulse)

    def _notify(self, pulse: Pulse) -> None:
        for observe_pulse in self._pulse_observers:
            observe_pulse(pulse)

    def load_eeprom(self) -> None:
        """Reload the EEPROM from the one given at the start."""
        self.mcu.eeprom[:EEPROM_SIZE] = np.frombuffer(self._eeprom.read(0, EEPROM_SIZE), np.uint8)

    def symbol(self, name: str) -> int:
        """Address of a variable or function of the firmware.

        Raises:
            ConfigError: there is no such symbol, or the firmware is not an ELF file.
        """
        if name not in self._symbols:
            raise ConfigError(f"firmware: no symbol {name}", "see avr-nm firmware.elf")
        return self._symbols[name]

    def _keep_eeprom_writes(self) -> None:
        for write in self.mcu.take_eeprom_writes():
            self._eeprom.write(int(write["address"]), int(write["value"]))

    def _load(self, image: FlashImage) -> None:
        for address, data in image.segments:
            self.mcu.flash[address : address + len(data)] = np.frombuffer(data, np.uint8)


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
        self.board.mcu.forget_unsent()
        self.board.reset(ResetCause.EXTERNAL)
