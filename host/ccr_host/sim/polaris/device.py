"""The camera's control unit: commands in, replies out, without a serial line."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass, field
from enum import Enum, IntEnum

import numpy as np

from ccr_host.core.wire import crc16_arc
from ccr_host.sim.polaris.sensor import (
    SUPPORTED_MODE,
    TRANSFORMS,
    Image,
    PositionSensor,
    StrayList,
    ToolLine,
    format_tx,
    is_within,
)
from ccr_host.tracking.sources.ndi.replies import VICRA


class ErrorCode(IntEnum):
    """Error codes of `ERRORnn` replies."""

    INVALID_COMMAND = 0x01
    TOO_SHORT = 0x03
    BAD_CRC = 0x04
    NO_SUCH_COMMUNICATION = 0x06
    PARAMETERS = 0x07
    BAD_HANDLE = 0x08
    WRONG_MODE = 0x0C
    NO_TOOL = 0x0D
    NOT_INITIALISED = 0x0E
    NOT_ENABLED = 0x0F
    NO_INIT = 0x10
    PINIT_FAILED = 0x13
    OUT_OF_RANGE = 0x23
    HANDLES_TAKEN = 0x2D


class Refusal(Exception):  # noqa: N818 - an answer, not a failure of the emulator
    """A command that the device answers with an error code."""

    def __init__(self, code: ErrorCode) -> None:
        self.code = code
        super().__init__(code.name)


MEMORY_BYTES = 1024
BLOCK_BYTES = 64
_LAST_HANDLE = 0x0F
"""A Vicra supports few tools; more handles mean that the host leaks them."""
_MAGIC = b"NDI"
_PART_NUMBER = slice(592, 612)

OCCUPIED, INITIALISED, ENABLED = 0x01, 0x10, 0x20


@dataclass
class PortHandle:
    """A port handle and its virtual SROM."""

    number: int
    memory: bytearray = field(default_factory=lambda: bytearray(MEMORY_BYTES))
    written: bool = False
    initialised: bool = False
    enabled: bool = False

    @property
    def status(self) -> int:
        return OCCUPIED * self.written + INITIALISED * self.initialised + ENABLED * self.enabled

    @property
    def part_number(self) -> str:
        """Part number in the tool definition."""
        return self.memory[_PART_NUMBER].split(b"\0")[0].decode("ascii", "replace")

    def write(self, address: int, block: bytes) -> None:
        if address % BLOCK_BYTES or address + BLOCK_BYTES > MEMORY_BYTES:
            raise Refusal(ErrorCode.OUT_OF_RANGE)
        self.memory[address : address + BLOCK_BYTES] = block
        self.written = True

    def initialise(self) -> None:
        """Check and accept the tool definition."""
        if not self.written:
            raise Refusal(ErrorCode.NO_TOOL)
        summed = sum(self.memory[6:]) & 0xFFFF
        stored = int.from_bytes(self.memory[4:6], "little")
        if not self.memory.startswith(_MAGIC) or summed != stored:
            raise Refusal(ErrorCode.PINIT_FAILED)
        self.initialised = True

    def enable(self) -> None:
        if not self.initialised:
            raise Refusal(ErrorCode.NOT_INITIALISED)
        self.enabled = True


RESET_BAUD = 9600
WRONG_FRAMES_OFFSET = 0xFFFF0000
_BAUDS = {
    "0": 9600,
    "1": 14_400,
    "2": 19_200,
    "3": 38_400,
    "4": 57_600,
    "5": 115_200,
    "6": 921_600,
    "7": 1_228_739,
    "A": 230_400,
}
_COMM_8N1 = re.compile(r"([0-7A])000[01]")
_WITH_CRC = re.compile(rb"([A-Z][A-Z0-9]*):(.*)([0-9A-F]{4})", re.DOTALL)
_WITHOUT_CRC = re.compile(rb"([A-Z][A-Z0-9]*)(?: (.*))?", re.DOTALL)
_PASSIVE_PORT = re.compile(r"[*0-9A-F]{8}[*0-9][*1][*0-9A-Z]{2}[*0-9]{2}")

_STATUS_DIAGNOSTIC = 0x0100
_STATUS_TEMPERATURE = 0x0200

_MARKER_PART = re.compile(r"CCR-M([1-9]\d?)")
"""Part number of the tool at a marker of the robot; any other tool is out of sight."""


class Mode(Enum):
    """Operating mode, which determines the allowed commands."""

    OFF = "not initialised"
    SETUP = "setup"
    TRACKING = "tracking"


@dataclass(frozen=True)
class Answer:
    """Reply of the device, and its bit rate after it; None for the same."""

    text: str
    new_baud: int | None = None


class PolarisDevice:
    """A Vicra.

    INIT is refused while tracking: the API guide does not specify it, so the host must cope.
    """

    def __init__(self, sensor: PositionSensor) -> None:
        self.sensor = sensor
        self.reset()
        setup, tracking = Mode.SETUP, Mode.TRACKING
        self._commands: dict[str, tuple[Callable[[str], str | None], tuple[Mode, ...]]] = {
            "INIT": (self._init, (Mode.OFF, setup)),
            "PHSR": (self._phsr, (setup,)),
            "PHF": (self._phf, (setup,)),
            "PHRQ": (self._phrq, (setup,)),
            "PVWR": (self._pvwr, (setup,)),
            "PINIT": (self._pinit, (setup,)),
            "PENA": (self._pena, (setup,)),
            "PDIS": (self._pdis, (setup,)),
            "TSTART": (self._tstart, (setup,)),
            "TX": (self._tx, (tracking,)),
            "TSTOP": (self._tstop, (tracking,)),
            "VER": (self._ver, (setup,)),
        }

    def reset(self) -> None:
        """Return to the power-up state: no tools, not initialised, illuminators off."""
        self.mode = Mode.OFF
        self.handles: dict[int, PortHandle] = {}
        self._image: Image | None = None
        self._count_offset = 0
        self._time_us = 0
        self.sensor.illuminated = False

    def execute(self, line: bytes, time_us: int) -> Answer | None:
        """Execute a command, given without its carriage return; None if it is a reset."""
        self._time_us = time_us
        try:
            name, arguments = _parse(line)
            if name == "RESET":
                return None
            if name == "COMM":
                if self.sensor.faults.comm_refused:
                    raise Refusal(ErrorCode.NO_SUCH_COMMUNICATION)
                return Answer("OKAY", new_baud=_baud(arguments))
            return Answer(self._dispatch(name, arguments))
        except Refusal as refusal:
            return Answer(f"ERROR{refusal.code:02X}")

    def _dispatch(self, name: str, arguments: str) -> str:
        if name not in self._commands:
            raise Refusal(ErrorCode.INVALID_COMMAND)
        action, modes = self._commands[name]
        if self.mode not in modes:
            off = self.mode is Mode.OFF
            raise Refusal(ErrorCode.NO_INIT if off else ErrorCode.WRONG_MODE)
        return action(arguments) or "OKAY"

    def _init(self, _arguments: str) -> None:
        self.mode = Mode.SETUP

    def _ver(self, _arguments: str) -> str:
        return "Polaris Vicra Control Firmware (emulated by ccr-host)"

    def _phsr(self, arguments: str) -> str:
        wanted = _hex(arguments[:2] or "00", 2)
        handles = [handle for handle in self._sorted_handles() if _is_wanted(handle, wanted)]
        return f"{len(handles):02X}" + "".join(f"{h.number:02X}{h.status:03X}" for h in handles)

    def _phf(self, arguments: str) -> None:
        del self.handles[self._handle(arguments).number]

    def _phrq(self, arguments: str) -> str:
        if not _PASSIVE_PORT.fullmatch(arguments):
            raise Refusal(ErrorCode.PARAMETERS)
        free = {*range(0x01, _LAST_HANDLE + 1)} - self.handles.keys()
        if not free:
            raise Refusal(ErrorCode.HANDLES_TAKEN)
        number = min(free)
        self.handles[number] = PortHandle(number)
        return f"{number:02X}"

    def _pvwr(self, arguments: str) -> None:
        handle, address = self._handle(arguments[:2]), _hex(arguments[2:6], 4)
        block = arguments[6:]
        if len(block) != 2 * BLOCK_BYTES:
            raise Refusal(ErrorCode.PARAMETERS)
        handle.write(address, _hex(block, len(block)).to_bytes(BLOCK_BYTES, "big"))

    def _pinit(self, arguments: str) -> str:
        self._handle(arguments).initialise()
        return "WARNING05" if self.sensor.faults.pinit_warning else "OKAY"

    def _pena(self, arguments: str) -> None:
        if arguments[2:] not in ("S", "D", "B"):
            raise Refusal(ErrorCode.PARAMETERS)
        self._handle(arguments[:2]).enable()

    def _pdis(self, arguments: str) -> None:
        handle = self._handle(arguments)
        if not handle.enabled:
            raise Refusal(ErrorCode.NOT_ENABLED)
        handle.enabled = False

    def _tstart(self, arguments: str) -> None:
        self.mode = Mode.TRACKING
        self.sensor.illuminated = bool(self._enabled())
        if arguments == "80":
            image = self.sensor.newest(self._time_us)
            self._count_offset = image.count if image else 0

    def _tstop(self, _arguments: str) -> None:
        self.mode = Mode.SETUP
        self.sensor.illuminated = False

    def _tx(self, arguments: str) -> str:
        mode = _hex(arguments, 4) if arguments else TRANSFORMS
        if mode & ~SUPPORTED_MODE:
            raise Refusal(ErrorCode.OUT_OF_RANGE)
        image = self.sensor.newest(self._time_us)
        tools = [self._tool(handle, image) for handle in self._enabled()]
        faults = self.sensor.faults
        status = (
            _STATUS_TEMPERATURE * faults.too_hot + _STATUS_DIAGNOSTIC * faults.diagnostic_pending
        )
        return format_tx(mode, tools, self._strays(image), status, faults.bit_order)

    def _handle(self, number: str) -> PortHandle:
        handle = self.handles.get(_hex(number, 2))
        if handle is None:
            raise Refusal(ErrorCode.BAD_HANDLE)
        return handle

    def _sorted_handles(self) -> list[PortHandle]:
        return [handle for _, handle in sorted(self.handles.items())]

    def _enabled(self) -> list[PortHandle]:
        """The enabled handles, which TX reports."""
        return [handle for handle in self._sorted_handles() if handle.enabled]

    def _tool(self, handle: PortHandle, image: Image | None) -> ToolLine:
        frame = image.count - self._count_offset if image else 0
        if is_within(self._time_us, self.sensor.faults.wrong_frames_us):
            frame += WRONG_FRAMES_OFFSET
        marker = None if image is None else _marker_of(handle, image)
        if image is None or marker is None or not image.visible[marker]:
            return ToolLine(handle.number, handle.status, frame)
        position_mm = image.markers_mm[marker]
        return ToolLine(
            handle.number,
            handle.status,
            frame,
            position_mm,
            image.quaternion,
            bool(VICRA.contains(position_mm)[0]),
        )

    def _strays(self, image: Image | None) -> StrayList:
        """Markers that belong to no enabled tool, and phantoms."""
        if image is None:
            return StrayList(np.zeros((0, 3)), np.zeros(0, dtype=bool))
        shown = np.append(image.visible, np.ones(len(image.phantoms_mm), dtype=bool))
        for handle in self._enabled():
            if (marker := _marker_of(handle, image)) is not None:
                shown[marker] = False
        order = np.argsort(image.ranks[: len(shown)][shown])
        points_mm = np.vstack([image.markers_mm, image.phantoms_mm])[shown][order]
        return StrayList(points_mm, VICRA.contains(points_mm))


def _marker_of(handle: PortHandle, image: Image) -> int | None:
    """Number of the marker, from 0, at which a tool is; None if it is at none of the robot's."""
    match = _MARKER_PART.fullmatch(handle.part_number)
    number = int(match[1]) - 1 if match else len(image.markers_mm)
    return number if number < len(image.markers_mm) else None


def _parse(line: bytes) -> tuple[str, str]:
    """Name and arguments of a command; the CRC is checked if the format has one."""
    if match := _WITH_CRC.fullmatch(line):
        if crc16_arc(line[:-4]) != int(match[3], 16):
            raise Refusal(ErrorCode.BAD_CRC)
    elif b":" in line:
        raise Refusal(ErrorCode.BAD_CRC)
    elif not (match := _WITHOUT_CRC.fullmatch(line)):
        raise Refusal(ErrorCode.INVALID_COMMAND)
    return match[1].decode("ascii"), (match[2] or b"").decode("ascii", "replace")


def _baud(arguments: str) -> int:
    match = _COMM_8N1.fullmatch(arguments)
    if match is None:
        raise Refusal(ErrorCode.OUT_OF_RANGE)
    return _BAUDS[match[1]]


def _hex(text: str, digits: int) -> int:
    if not re.fullmatch(rf"[0-9A-F]{{{digits}}}", text):
        raise Refusal(ErrorCode.PARAMETERS)
    return int(text, 16)


def _is_wanted(handle: PortHandle, mode: int) -> bool:
    """Whether PHSR selects a handle: all, to be freed, initialised or enabled, or enabled."""
    match mode:
        case 0x00:
            return True
        case 0x01:
            return False
        case 0x02:
            return not handle.initialised
        case 0x03:
            return handle.initialised and not handle.enabled
        case 0x04:
            return handle.enabled
    raise Refusal(ErrorCode.OUT_OF_RANGE)
