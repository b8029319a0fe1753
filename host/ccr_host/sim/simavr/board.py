"""An UNO with the real firmware: bytes in, bytes and servo pulses out, on one microsecond clock."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from ccr_host.core.errors import ConfigError
from ccr_host.link.messages import BAUD, EEPROM_SIZE, TICK_US, ResetCause
from ccr_host.sim.board.core import Inputs
from ccr_host.sim.board.eeprom import Eeprom, EepromImage
from ccr_host.sim.simavr.flash_image import FlashImage
from ccr_host.sim.simavr.mcu import (
    CLOCK_HZ,
    CYCLES_PER_HALF_US,
    CYCLES_PER_US,
    LED_PIN,
    SERVO_PINS,
    SERVO_SUPPLY_PIN,
    Mcu,
    News,
    Statistics,
)

_MISSING_CYCLES = TICK_US * CYCLES_PER_US * 3 // 2
"""Half a frame after one was due, a pulse is taken to be missing."""


@dataclass(frozen=True, slots=True)
class Edge:
    """Change of a servo pin; a pin that is not driven counts as low."""

    cycle: int
    pin: int
    level: bool


@dataclass(frozen=True, slots=True)
class Pulse:
    """A pulse that has ended, or the absence of one."""

    pin: int
    end_cycle: int
    width_cycles: int
    """0: there was none for a frame and a half."""

    @property
    def half_us(self) -> int:
        """Width, rounded to 0.5 us."""
        return (self.width_cycles + CYCLES_PER_HALF_US // 2) // CYCLES_PER_HALF_US


class PulseMeter:
    """Turns edges into pulses."""

    def __init__(self) -> None:
        self._rise_cycle: list[int | None] = [None] * SERVO_PINS
        self._newest: list[Pulse | None] = [None] * SERVO_PINS

    def take(self, edge: Edge) -> Pulse | None:
        """Next edge; the pulse that it ends."""
        rise_cycle = self._rise_cycle[edge.pin]
        self._rise_cycle[edge.pin] = edge.cycle if edge.level else None
        if edge.level or rise_cycle is None:
            return None
        pulse = Pulse(edge.pin, edge.cycle, edge.cycle - rise_cycle)
        self._newest[edge.pin] = pulse
        return pulse

    def missing(self, cycle: int) -> list[Pulse]:
        """What has been missing since the last pulse, found out at `cycle`; told once."""
        found = []
        for pin, pulse in enumerate(self._newest):
            if pulse and cycle - pulse.end_cycle > _MISSING_CYCLES:
                self._newest[pin] = None
                found.append(Pulse(pin, pulse.end_cycle + _MISSING_CYCLES, 0))
        return found

    @property
    def half_us(self) -> tuple[int, int]:
        """Newest pulse of both pins, 0.5 us; 0 where there is none."""
        first, second = (pulse.half_us if pulse else 0 for pulse in self._newest)
        return first, second


EdgeObserver = Callable[[Edge], None]
PulseObserver = Callable[[Pulse], None]

_SRAM_AT_POWER_ON = 0xA5
"""SRAM comes up with anything; not with zeros, which would hide what is never initialised."""


@dataclass(frozen=True, slots=True)
class Departure:
    """A byte from the board: cycles of the start bit's begin and of the stop bit's end."""

    start_cycle: int
    end_cycle: int
    value: int


class SimavrBoard:
    """The whole board, in lockstep with the caller's clock: 16 cycles a microsecond.

    Args:
        firmware: the program.
        boot_loader: where resets lead, if there is one.
        eeprom: its content at the start; what the firmware writes goes there.
        reset_cause: of the first start.
        start_us: when it starts for the first time, on the caller's clock.
        profiling: also watch stack and interrupt mask; several times slower.

    Raises:
        DeviceError: the simulator is not there.
    """

    def __init__(
        self,
        firmware: FlashImage,
        *,
        boot_loader: FlashImage | None = None,
        eeprom: Eeprom | None = None,
        reset_cause: ResetCause = ResetCause.POWER_ON,
        start_us: int = 0,
        profiling: bool = False,
    ) -> None:
        self._mcu = Mcu()
        self._symbols = firmware.symbols
        self._eeprom = eeprom if eeprom is not None else EepromImage()
        self._start_us = start_us
        self._now_us = start_us
        self.line_is_busy = False
        """Whether a byte is on the wire, either way."""
        self._meter = PulseMeter()
        self._output_is_high = {SERVO_SUPPLY_PIN: False, LED_PIN: False}
        self._edge_observers: list[EdgeObserver] = []
        self._pulse_observers: list[PulseObserver] = []
        self.load_eeprom()
        self._load(firmware)
        if boot_loader:
            self._load(boot_loader)
            self._mcu.start_at(boot_loader.start)
        self._mcu.profile(profiling)
        self.set_supply_pin_mv(Inputs.supply_pin_mv)
        self.reset(reset_cause)

    def close(self) -> None:
        """Free the simulator; nothing else may be called any more."""
        self._mcu.close()

    # Time

    @property
    def now_us(self) -> int:
        """How far the board has been advanced."""
        return self._now_us

    @property
    def cycle(self) -> int:
        """The same in cycles since the first start."""
        return (self._now_us - self._start_us) * CYCLES_PER_US

    def time_us(self, cycle: int) -> int:
        """Time of a cycle on the caller's clock, rounded down."""
        return self._start_us + cycle // CYCLES_PER_US

    def advance_to(self, time_us: int) -> None:
        """Run up to and including `time_us`.

        Raises:
            DeviceError: the program has left its memory.
        """
        if time_us < self._now_us:
            return
        self._now_us = time_us
        news = self._mcu.run_until(self.cycle + 1)
        self.line_is_busy = bool(news & News.LINE_BUSY)
        if news & News.EDGES:
            self._watch_pins()
        for pulse in self._meter.missing(self.cycle):
            self._tell(pulse)
        if news & News.EEPROM_WRITES:
            self._keep_eeprom_writes()

    def reset(self, cause: ResetCause) -> None:
        """Start again; only a power-up spoils the SRAM."""
        if cause is ResetCause.POWER_ON:
            self._mcu.fill_sram(_SRAM_AT_POWER_ON)
        self._mcu.reset(cause)

    # Wire

    def receive(self, data: bytes, baud: int | None = BAUD) -> None:
        """Put bytes onto the wire now, after those that are on it.

        Args:
            data: the bytes.
            baud: of the sender; None for that which the firmware has set.
        """
        self._mcu.send(self.cycle, data, CLOCK_HZ // baud if baud else 0)

    def forget_unsent(self) -> None:
        """Drop what waits for the wire to the board."""
        self._mcu.forget_unsent()

    def take_output(self) -> bytes:
        """Bytes that have left the board and were not taken yet."""
        return self._mcu.take_departures()["value"].tobytes()

    def take_departures(self) -> list[Departure]:
        """The same with their times."""
        return [Departure(*map(int, departure)) for departure in self._mcu.take_departures()]

    # Pins

    def observe_edges(self, observer: EdgeObserver) -> None:
        """Tell each edge of the servo pins, in order of time."""
        self._edge_observers.append(observer)

    def observe_pulses(self, observer: PulseObserver) -> None:
        """Tell each pulse when it has ended, and once that there are none any more."""
        self._pulse_observers.append(observer)

    @property
    def pulses_half_us(self) -> tuple[int, int]:
        """Last pulses measured on the pins, 0.5 us; 0 is none."""
        return self._meter.half_us

    def open_emergency_stop(self, is_open: bool = True) -> None:
        """Open or close the switch between its input and ground; closed at first."""
        self._mcu.open_switch(is_open)

    def set_supply_pin_mv(self, voltage_mv: int) -> None:
        """Output of the servo supply's divider; 3000 at first."""
        self._mcu.set_voltage_mv(voltage_mv)

    @property
    def servo_supply_on(self) -> bool:
        """Level of the pin that enables the servos' supply."""
        return self._output_is_high[SERVO_SUPPLY_PIN]

    @property
    def led_on(self) -> bool:
        """Level of the LED's pin."""
        return self._output_is_high[LED_PIN]

    def _watch_pins(self) -> None:
        for record in self._mcu.take_edges():
            edge = Edge(int(record["cycle"]), int(record["pin"]), bool(record["level"]))
            if edge.pin in self._output_is_high:
                self._output_is_high[edge.pin] = edge.level
                continue
            for observe_edge in self._edge_observers:
                observe_edge(edge)
            if pulse := self._meter.take(edge):
                self._tell(pulse)

    def _tell(self, pulse: Pulse) -> None:
        for observe_pulse in self._pulse_observers:
            observe_pulse(pulse)

    # Inside

    def statistics(self) -> Statistics:
        """Cycles, sleep, interrupts; with profiling also stack and interrupt mask."""
        return self._mcu.statistics()

    def forget_statistics(self) -> None:
        """Count again."""
        self._mcu.forget_statistics()

    def eeprom_content(self) -> bytes:
        """All bytes of the EEPROM."""
        return self._mcu.eeprom.tobytes()

    def load_eeprom(self) -> None:
        """Take over what the EEPROM given at the start holds now."""
        self._mcu.eeprom[:] = np.frombuffer(self._eeprom.read(0, EEPROM_SIZE), np.uint8)

    def wear_out_eeprom(self, *addresses: int) -> None:
        """From now on writes to these addresses do not take."""
        for address in addresses:
            self._mcu.wear_out_eeprom(address)

    def read_memory(self, address: int, count: int) -> bytes:
        """Registers, I/O and SRAM by data address, without side effects."""
        return self._mcu.memory[address : address + count].tobytes()

    def write_memory(self, address: int, data: bytes) -> None:
        """Preset SRAM, for instance a clock shortly before it wraps."""
        self._mcu.memory[address : address + len(data)] = np.frombuffer(data, np.uint8)

    def symbol(self, name: str) -> int:
        """Address of a variable or function of the firmware.

        Raises:
            ConfigError: there is none, or the firmware is not an ELF file.
        """
        if name not in self._symbols:
            raise ConfigError(f"firmware: no symbol {name}", "see avr-nm firmware.elf")
        return self._symbols[name]

    def flash_content(self) -> bytes:
        """All bytes of the flash, as a boot loader may have changed them."""
        return self._mcu.flash.tobytes()

    def _keep_eeprom_writes(self) -> None:
        for write in self._mcu.take_eeprom_writes():
            self._eeprom.write(int(write["address"]), int(write["value"]))

    def _load(self, image: FlashImage) -> None:
        for address, data in image.segments:
            self._mcu.flash[address : address + len(data)] = np.frombuffer(data, np.uint8)
