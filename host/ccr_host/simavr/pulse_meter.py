"""Servo pulses as a servo sees them: from the edges on its pin."""

from __future__ import annotations

from dataclasses import dataclass

from ccr_host.link.messages import TICK_US
from ccr_host.simavr.mcu import CYCLES_PER_HALF_US, CYCLES_PER_US, SERVO_PINS

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
