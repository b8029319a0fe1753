"""The microcontroller simulated by libsimavr, in clock cycles, through the C shim."""

from __future__ import annotations

import ctypes
import hashlib
import os
import re
import shutil
import subprocess
import tempfile
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from ccr_host.core.errors import DeviceError
from ccr_host.core.user_file import cache_folder
from ccr_host.link.messages import ResetCause

_SOURCES = Path(__file__).parent / "shim"
_COMPILE = (
    *("-std=gnu11", "-O2", "-fPIC", "-shared"),
    *("-I/usr/include/simavr", "-I/usr/local/include/simavr", "-L/usr/local/lib", "-lsimavr"),
)
_CURE = "sudo apt install gcc libsimavr-dev libelf-dev"


def built_shim() -> Path:
    """Path of the shared object, built if this version of its source was not built before.

    It links libsimavr and is therefore under the GPL-3: for use on this machine only.

    Raises:
        DeviceError: the compiler or libsimavr is missing.
    """
    return compiled("librig.so", _compiler, sorted(_SOURCES.glob("*.[ch]")), _COMPILE, _CURE)


def _compiler() -> str:
    compiler = os.environ.get("CC") or shutil.which("cc") or shutil.which("gcc")
    if compiler is None:
        raise DeviceError("simavr: no C compiler", _CURE)
    return compiler


def compiled(
    name: str,
    compiler: Callable[[], str],
    sources: Sequence[Path],
    options: Sequence[str],
    cure: str,
) -> Path:
    """What a compiler makes of C files and their headers; once for each version of them.

    ``name`` is that of the result, without the digest of what it is made of; ``compiler`` finds the
    program, which is not needed any more afterwards; ``cure`` is for the message.

    Raises:
        DeviceError: they do not compile.
        CcrError: what ``compiler`` raises.
    """
    digest = hashlib.sha256(" ".join(options).encode())
    for source in sources:
        digest.update(source.read_bytes())
    result = cache_folder() / name
    result = result.with_stem(f"{result.stem}-{digest.hexdigest()[:16]}")
    if result.exists():
        return result
    result.parent.mkdir(parents=True, exist_ok=True)
    files = [str(source) for source in sources if source.suffix == ".c"]
    with tempfile.TemporaryDirectory(dir=result.parent) as scratch:
        unfinished = Path(scratch) / result.name
        done = subprocess.run(
            [compiler(), *files, *options, "-o", str(unfinished)],
            capture_output=True,
            text=True,
            check=False,
        )
        if done.returncode != 0:
            raise DeviceError(f"simavr: {name} does not build: {_gist(done.stderr)}", cure)
        unfinished.replace(result)
    return result


def _gist(messages: str) -> str:
    """The first line that states an error."""
    lines = messages.splitlines() or ["no message from the compiler"]
    return next((line for line in lines if "error:" in line or "cannot find" in line), lines[-1])


CLOCK_HZ: Final = 16_000_000
CYCLES_PER_US: Final = 16
CYCLES_PER_HALF_US: Final = 8
VECTORS: Final = 57
SERVO_SUPPLY_PIN: Final = 12
"""Lower numbers are the servos' pins, numbered as the axes, from 0; an UNO has the first two."""
LED_PIN: Final = 13

_MCUSR_FLAGS: Final = {
    ResetCause.UNKNOWN: 0,
    ResetCause.POWER_ON: 1 << 0,
    ResetCause.EXTERNAL: 1 << 1,
    ResetCause.BROWN_OUT: 1 << 2,
    ResetCause.WATCHDOG: 1 << 3,
}
_ROOM = 4096
_EDGE = np.dtype([("cycle", "u8"), ("pin", "u1"), ("level", "u1")], align=True)
_DEPARTURE = np.dtype([("start_cycle", "u8"), ("end_cycle", "u8"), ("value", "u1")], align=True)
_EEPROM_WRITE = np.dtype([("address", "u2"), ("value", "u1")], align=True)
_ESCAPE_SEQUENCE = re.compile(r"\x1b\[[0-9;]*m")

Records = NDArray[np.void]
_Take = Callable[[int, int, int], int]


class News:
    """Bits for events while running, as in rig.h; plain integers for speed."""

    TROUBLE: Final = 1 << 0
    EDGES: Final = 1 << 1
    EEPROM_WRITES: Final = 1 << 2
    LINE_BUSY: Final = 1 << 3


class Statistics(ctypes.Structure):
    """Counts since the start or since :meth:`Mcu.forget_statistics`, as in rig.h.

    Attributes:
        cycle: clock cycles since the start.
        slept_cycles: cycles of these spent asleep.
        resets: resets of any cause.
        overruns: bytes lost by the receiver because they were not read in time.
        last_arrival_cycle: end of the last stop bit sent to the board.
        interrupts: interrupts served, per vector number.
        longest_masked_cycles: longest time with interrupts off; only while profiling.
        longest_masked_pc: byte address at which that time began; only while profiling.
        least_stack_pointer: lowest stack pointer; only while profiling.
    """

    _fields_ = (
        ("cycle", ctypes.c_uint64),
        ("slept_cycles", ctypes.c_uint64),
        ("resets", ctypes.c_uint64),
        ("overruns", ctypes.c_uint64),
        ("last_arrival_cycle", ctypes.c_uint64),
        ("interrupts", ctypes.c_uint64 * VECTORS),
        ("longest_masked_cycles", ctypes.c_uint64),
        ("longest_masked_pc", ctypes.c_uint32),
        ("least_stack_pointer", ctypes.c_uint16),
    )


class Mcu:
    """The chip of a board at 16 MHz with erased flash and EEPROM, held at cycle 0.

    ``flash``, ``eeprom`` and ``memory`` are views of the simulator, which last no longer than it.

    Raises:
        DeviceError: the shim cannot be built or loaded.
    """

    def __init__(self, board: str) -> None:
        self._shim = _load()
        self._rig = self._shim.rig_new(board.encode())
        if not self._rig:
            raise DeviceError(f"simavr: libsimavr has no {board}", "install another libsimavr")
        self.servos: int = self._shim.rig_servos(self._rig)
        """Number of servo pins."""
        self._departures = np.empty(_ROOM, _DEPARTURE)
        self._edges = np.empty(_ROOM, _EDGE)
        self._eeprom_writes = np.empty(_ROOM, _EEPROM_WRITE)
        self.flash = self._view("flash")
        self.eeprom = self._view("eeprom")
        self.memory = self._view("memory")
        """Registers, I/O and SRAM by data address; writing has no side effects."""

    def close(self) -> None:
        """Free the simulator; no other method may be called afterwards."""
        if self._rig:
            self._shim.rig_free(self._rig)
            self._rig = None

    def __del__(self) -> None:
        self.close()

    def start_at(self, address: int) -> None:
        """Set the byte address at which the program starts after a reset (fuse BOOTRST)."""
        self._shim.rig_set_reset_vector(self._rig, address)

    def profile(self, on: bool) -> None:
        """Monitor stack and interrupt mask after each instruction; several times slower."""
        self._shim.rig_set_profiling(self._rig, on)

    def reset(self, cause: ResetCause) -> None:
        """Reset; SRAM and EEPROM keep their content."""
        self._shim.rig_reset(self._rig, _MCUSR_FLAGS[cause])

    def fill_sram(self, value: int) -> None:
        """Set all registers and SRAM to one value."""
        self._shim.rig_fill_sram(self._rig, value)

    def run_until(self, cycle: int) -> int:
        """Run to `cycle`, excluding events of that cycle; return bits of :class:`News`.

        Raises:
            DeviceError: the program crashed.
        """
        news: int = self._shim.rig_run_until(self._rig, cycle)
        if news & News.TROUBLE:
            text = self._shim.rig_trouble(self._rig).decode("utf-8", "replace")
            text = " ".join(_ESCAPE_SEQUENCE.sub("", text).split())
            raise DeviceError(f"simavr: the firmware crashed: {text}", "look at that address")
        return news

    def send(self, cycle: int, data: bytes, bit_cycles: int) -> None:
        """Transmit bytes to the board from `cycle` on; `bit_cycles` 0 is the board's bit rate."""
        self._shim.rig_send(self._rig, cycle, data, len(data), bit_cycles)

    def open_switch(self, is_open: bool) -> None:
        self._shim.rig_open_switch(self._rig, is_open)

    def set_voltage_mv(self, voltage_mv: int) -> None:
        """Set the voltage at pin A0."""
        self._shim.rig_set_voltage(self._rig, voltage_mv)

    def forget_unsent(self) -> None:
        """Drop bytes to the board whose transmission has not started."""
        self._shim.rig_forget_unsent(self._rig)

    def take_departures(self) -> Records:
        """Bytes sent by the board: `start_cycle` of the start bit, `end_cycle` of the stop bit."""
        return self._take(self._shim.rig_take_departures, self._departures)

    def take_edges(self) -> Records:
        """Edges at the pins: `cycle`, `pin`, `level`."""
        return self._take(self._shim.rig_take_edges, self._edges)

    def take_eeprom_writes(self) -> Records:
        """Bytes written to EEPROM: `address`, `value`."""
        return self._take(self._shim.rig_take_eeprom_writes, self._eeprom_writes)

    def wear_out_eeprom(self, address: int) -> None:
        self._shim.rig_wear_out_eeprom(self._rig, address)

    def statistics(self) -> Statistics:
        """Statistics since the start or the last :meth:`forget_statistics`."""
        statistics = Statistics()
        self._shim.rig_statistics(self._rig, ctypes.byref(statistics))
        return statistics

    def forget_statistics(self) -> None:
        self._shim.rig_forget_statistics(self._rig)

    def _take(self, take: _Take, room: Records) -> Records:
        count = take(self._rig, room.ctypes.data, len(room))
        if count < len(room):
            return room[:count].copy() if count else room[:0]
        return np.concatenate((room.copy(), self._take(take, room)))

    def _view(self, name: str) -> NDArray[np.uint8]:
        size = getattr(self._shim, f"rig_{name}_size")(self._rig)
        return np.ctypeslib.as_array(getattr(self._shim, f"rig_{name}")(self._rig), (size,))


def _load() -> ctypes.CDLL:
    path = built_shim()
    try:
        shim = ctypes.CDLL(str(path))
    except OSError as error:
        raise DeviceError(f"simavr: {error}", "sudo apt install libsimavr-dev libelf-dev") from None
    rig, size, count = ctypes.c_void_p, ctypes.c_size_t, ctypes.c_uint32
    bytes_of_rig = ctypes.POINTER(ctypes.c_uint8)
    signatures: dict[str, tuple[Any, tuple[Any, ...]]] = {
        "rig_new": (rig, (ctypes.c_char_p,)),
        "rig_servos": (ctypes.c_uint, (rig,)),
        "rig_free": (None, (rig,)),
        "rig_flash_size": (count, (rig,)),
        "rig_flash": (bytes_of_rig, (rig,)),
        "rig_eeprom_size": (count, (rig,)),
        "rig_eeprom": (bytes_of_rig, (rig,)),
        "rig_memory_size": (count, (rig,)),
        "rig_memory": (bytes_of_rig, (rig,)),
        "rig_set_reset_vector": (None, (rig, count)),
        "rig_set_profiling": (None, (rig, ctypes.c_bool)),
        "rig_reset": (None, (rig, ctypes.c_int)),
        "rig_fill_sram": (None, (rig, ctypes.c_uint8)),
        "rig_run_until": (ctypes.c_uint, (rig, ctypes.c_uint64)),
        "rig_trouble": (ctypes.c_char_p, (rig,)),
        "rig_send": (None, (rig, ctypes.c_uint64, ctypes.c_char_p, size, count)),
        "rig_forget_unsent": (None, (rig,)),
        "rig_open_switch": (None, (rig, ctypes.c_bool)),
        "rig_set_voltage": (None, (rig, count)),
        "rig_take_departures": (size, (rig, ctypes.c_void_p, size)),
        "rig_take_edges": (size, (rig, ctypes.c_void_p, size)),
        "rig_take_eeprom_writes": (size, (rig, ctypes.c_void_p, size)),
        "rig_wear_out_eeprom": (None, (rig, ctypes.c_uint16)),
        "rig_statistics": (None, (rig, ctypes.c_void_p)),
        "rig_forget_statistics": (None, (rig,)),
    }
    for name, (result, arguments) in signatures.items():
        function = getattr(shim, name)
        function.restype = result
        function.argtypes = arguments
    return shim
