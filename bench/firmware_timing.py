"""Timing of the firmware in cycles of the real binary in simavr.

``python bench/firmware_timing.py --board mega2560 --axes 12`` builds the firmware with avr-gcc and
prints a table; for an UNO, the default, with the project's targets. Cycles do not depend on the
machine. Needs gcc-avr, avr-libc, libsimavr-dev.
"""

from __future__ import annotations

import argparse
import subprocess
import tempfile
from collections.abc import Callable, Iterator, Sequence
from contextlib import closing, contextmanager
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from rich.console import Console
from rich.table import Table

from ccr_host.core.clock import VirtualClock
from ccr_host.description import schema
from ccr_host.link import messages as m
from ccr_host.link.board_config import board_config
from ccr_host.link.client import Client
from ccr_host.link.framing import Frame, FrameDecoder, encode_frame
from ccr_host.sim.simavr.board import Pulse, SimavrBoard, SimavrLine
from ccr_host.sim.simavr.flash_image import read_flash_image
from ccr_host.sim.simavr.mcu import CYCLES_PER_US

ROOT = Path(__file__).parents[1]
REQUESTS = 500
TARGETS = 200
SATURATED_S = 4
PROFILED_S = 1
VALIDITY_MS = 10_000
REPLY_US = 5_000
"""Duration of the longest reply on the line."""
SESSION = 0xBE4C
USUAL_AXES = {"uno": 2, "mega2560": 12}
AIMS = {
    "last byte of a request to first byte of the reply": "200 us",
    "set_target to the last of its pulses": "20 ms + that",
    "pulse jitter of all pins, link saturated": "0 cycles",
    "  bytes lost": "0",
    "flash": "13824 bytes",
    "static RAM": "1024 bytes",
    "least free stack": "512 bytes",
}
"""Limits for an UNO."""
GAPS_US = np.random.default_rng(2).integers(0, 4, 100_000)
"""Pause between bursts, so that bytes arrive at every phase of the pulses; 0.2 % of the time."""


@dataclass(frozen=True)
class Rig:
    """An armed board, with byte-wise communication."""

    board: SimavrBoard
    clock: VirtualClock
    pulses: list[Pulse]
    axes: int

    def say(self, request: m.Request, sequence: int = 0) -> int:
        """Send now; return the cycle of the end of the last stop bit."""
        self.board.receive(encode_frame(request.ID, sequence, request.pack()))
        self.wait_us(3_000)
        return self.board.mcu.statistics().last_arrival_cycle

    def wait_us(self, duration_us: int) -> None:
        self.clock.sleep_until_us(self.clock.now_us() + duration_us)

    def target(self, angle_cdeg: int = 0) -> m.SetTarget:
        """All axes to one angle; that of 0 keeps the board active and changes nothing."""
        return m.SetTarget(SESSION, (angle_cdeg,) * self.axes, 0, VALIDITY_MS)


def main() -> None:
    """Command line of the bench."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--board", choices=USUAL_AXES, default="uno")
    parser.add_argument("--axes", type=int, help="servos of the board; 2 (UNO) or 12 by default")
    words = parser.parse_args()
    axes = words.axes or USUAL_AXES[words.board]
    with tempfile.TemporaryDirectory() as folder:
        Console().print(measure(words.board, axes, Path(folder)))


def measure(board: str, axes: int, folder: Path) -> Table:
    """Build and measure a board; its table."""
    rng = np.random.default_rng(1)
    title = f"Firmware on a board {board} with {axes} axes, from cycles"
    table = Table(title=title, title_justify="left")
    for heading, justify in (("what", "left"), ("measured", "right"), ("aim", "right")):
        table.add_column(heading, justify=justify)
    elf = build_firmware(folder, board, axes)
    flash, ram = sizes(elf)
    with armed(elf, axes) as rig:
        reply_us = reply_latencies_us(rig, rng)
        latch_us = target_latencies_us(rig, rng)
    with armed(elf, axes) as rig:
        busy = saturate(rig, SATURATED_S, [m.GetState(), rig.target()])
        free_stack = free_stack_bytes(rig)
    with armed(elf, axes) as rig:
        busy_with_targets = saturate(rig, SATURATED_S, [rig.target()])
    with armed(elf, axes, profiling=True) as rig:
        saturate(rig, PROFILED_S, [m.GetState(), rig.target()])
        masked_us = rig.board.mcu.statistics().longest_masked_cycles / CYCLES_PER_US
    aims = AIMS if board == "uno" else {}

    def add(what: str, measured: str) -> None:
        table.add_row(what, measured, aims.get(what, ""))

    add("last byte of a request to first byte of the reply", spread(reply_us))
    add("set_target to the last of its pulses", spread(latch_us, 1e-3, "ms"))
    jitter_of_all = max(busy.jitter_cycles, busy_with_targets.jitter_cycles)
    add("pulse jitter of all pins, link saturated", f"{jitter_of_all} cycles")
    if board == "uno":
        with closing(SimavrBoard(read_flash_image(build_peer(folder)))) as peer:
            add("  the same with timer interrupts", f"{jitter_of_peer(peer)} cycles")
    add("processor busy, link saturated", f"{busy.share:.0%}")
    add("  with targets alone", f"{busy_with_targets.share:.0%}")
    add("  bytes lost", f"{busy.overruns + busy_with_targets.overruns}")
    add("longest time with interrupts off", f"{masked_us:.1f} us")
    add("flash", f"{flash} bytes")
    add("static RAM", f"{ram} bytes")
    add("least free stack", f"{free_stack} bytes")
    return table


def build_firmware(folder: Path, board: str, axes: int) -> Path:
    """Build the firmware of this checkout."""
    script = ROOT / "scripts" / "build-firmware"
    flags = ["-UCCR_AXES", f"-DCCR_AXES={axes}"]
    subprocess.run(
        [str(script), "--board", board, str(folder), *flags], check=True, capture_output=True
    )
    return folder / "firmware.elf"


def build_peer(folder: Path) -> Path:
    """Build a program that generates servo pulses in a timer interrupt."""
    elf = folder / "peer.elf"
    source = Path(__file__).parent / "peers" / "interrupt_servo.c"
    flags = ["-mmcu=atmega328p", "-DF_CPU=16000000UL", "-Os", "-Wall", "-Werror"]
    subprocess.run(["avr-gcc", *flags, str(source), "-o", str(elf)], check=True)
    return elf


def sizes(elf: Path) -> tuple[int, int]:
    """Bytes of flash and of static RAM."""
    out = subprocess.run(["avr-size", str(elf)], check=True, capture_output=True, text=True).stdout
    text, data, bss = (int(number) for number in out.splitlines()[1].split()[:3])
    return text + data, data + bss


@contextmanager
def armed(elf: Path, axes: int, *, profiling: bool = False) -> Iterator[Rig]:
    """A board that is configured and armed."""
    with closing(SimavrBoard(read_flash_image(elf), profiling=profiling)) as board:
        pulses: list[Pulse] = []
        board.observe_pulses(pulses.append)
        line, clock = SimavrLine(board), VirtualClock()
        clock.attach(line)
        client = Client(line, clock, session=0x7923)
        client.connect(telemetry_period_ticks=0)
        client.configure(board_config(schema.load()))
        client.arm()
        rig = Rig(board, clock, pulses, axes)
        rig.say(m.OpenSession(m.SPEC_HASH, SESSION))
        rig.say(rig.target())
        board.take_output()
        yield rig


def reply_latencies_us(rig: Rig, rng: np.random.Generator) -> np.ndarray:
    """Time from the end of the request to the first start bit of its answer, at random phases."""
    kinds: list[Callable[[], m.Request]] = [m.GetState, m.GetCounters, m.GetLimits, rig.target]
    latencies = []
    for n in range(REQUESTS):
        rig.wait_us(REPLY_US + int(rng.integers(0, m.TICK_US)))
        rig.board.take_departures()
        heard = rig.say(kinds[n % len(kinds)](), n % 256)
        first = rig.board.take_departures()[0]
        latencies.append((first.start_cycle - heard) / CYCLES_PER_US)
    return np.array(latencies)


def target_latencies_us(rig: Rig, rng: np.random.Generator) -> np.ndarray:
    """Time from the end of the request until each axis has begun a pulse with its effect."""
    latencies = []
    angle_cdeg = 0
    for n in range(TARGETS):
        rig.wait_us(60_000 + int(rng.integers(0, m.TICK_US)))
        before = {pulse.pin: pulse.width_cycles for pulse in rig.pulses}
        angle_cdeg = 300 - angle_cdeg
        rig.pulses.clear()
        heard = rig.say(rig.target(angle_cdeg), n % 256)
        rig.wait_us(60_000)
        changed = [p for p in rig.pulses if p.width_cycles != before.get(p.pin)]
        begins = [
            next(p.end_cycle - p.width_cycles for p in changed if p.pin == pin)
            for pin in range(rig.axes)
        ]
        latencies.append((max(begins) - heard) / CYCLES_PER_US)
        rig.board.take_output()
    return np.array(latencies)


@dataclass(frozen=True)
class Busy:
    """A board on a saturated line."""

    jitter_cycles: int
    share: float
    overruns: int


def saturate(rig: Rig, duration_s: float, requests: Sequence[m.Request]) -> Busy:
    """Send requests in turn, back to back at 250000 baud."""
    rig.wait_us(100_000)
    rig.pulses.clear()
    rig.board.mcu.forget_statistics()
    begin_cycle = rig.board.cycle
    bytes_wanted = round(duration_s * m.BAUD / 10)
    burst = b"".join(encode_frame(one.ID, 2, one.pack()) for one in requests)
    slice_us = len(burst) * 10 * 1_000_000 // m.BAUD
    for gap_us in GAPS_US[: bytes_wanted // len(burst)]:
        rig.board.receive(burst)
        rig.wait_us(slice_us + int(gap_us))
    rig.board.take_output()
    statistics = rig.board.mcu.statistics()
    cycles = rig.board.cycle - begin_cycle
    return Busy(
        jitter_cycles=jitter_cycles(rig.pulses, rig.axes),
        share=1 - statistics.slept_cycles / cycles,
        overruns=statistics.overruns,
    )


def jitter_cycles(pulses: list[Pulse], axes: int) -> int:
    """Spread of the widths or of the periods, whichever is larger."""
    spreads = []
    for pin in range(axes):
        own = [pulse for pulse in pulses if pulse.pin == pin]
        assert len(own) > 40, "the board has made pulses"
        widths = np.array([pulse.width_cycles for pulse in own])
        begins = np.array([pulse.end_cycle for pulse in own]) - widths
        spreads += [np.ptp(widths), np.ptp(np.diff(begins))]
    return int(max(spreads))


def jitter_of_peer(board: SimavrBoard) -> int:
    """The same jitter for the timer-interrupt technique on a saturated line."""
    pulses: list[Pulse] = []
    board.observe_pulses(pulses.append)
    board.advance_to(100_000)
    pulses.clear()
    for gap_us in GAPS_US[:2_000]:
        board.receive(bytes(range(25)))
        board.advance_to(board.now_us + 1_000 + int(gap_us))
    return jitter_cycles(pulses, 2)


def free_stack_bytes(rig: Rig) -> int:
    """Least free stack, as reported by the board."""
    rig.wait_us(200_000)
    rig.board.take_output()
    rig.say(m.GetState())
    rig.wait_us(REPLY_US)
    decoded = SimavrLine(rig.board).read()
    return last_report(decoded).free_stack_bytes


def last_report(data: bytes) -> m.StateReport:
    """State replies in these bytes."""
    frames = [f for f in FrameDecoder().feed(data) if isinstance(f, Frame)]
    return m.StateReply.unpack(frames[-1].payload).report


def spread(values: np.ndarray, scale: float = 1.0, unit: str = "us") -> str:
    """Median and maximum as one cell."""
    return f"{np.median(values) * scale:.1f}, at most {values.max() * scale:.1f} {unit}"


if __name__ == "__main__":
    main()
