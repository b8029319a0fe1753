"""Port handles: where tool definitions are loaded, initialised and enabled."""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import IntEnum


class ErrorCode(IntEnum):
    """Of `ERRORnn`."""

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
"""A Vicra holds few tools; more handles are a leak of the host."""
_MAGIC = b"NDI"
_PART_NUMBER = slice(592, 612)

OCCUPIED, INITIALISED, ENABLED = 0x01, 0x10, 0x20


@dataclass
class PortHandle:
    """One handle and the virtual memory behind it."""

    number: int
    memory: bytearray = field(default_factory=lambda: bytearray(MEMORY_BYTES))
    written: bool = False
    initialised: bool = False
    enabled: bool = False

    @property
    def status(self) -> int:
        """Port status bits."""
        return OCCUPIED * self.written + INITIALISED * self.initialised + ENABLED * self.enabled

    @property
    def part_number(self) -> str:
        """Of the tool definition."""
        return self.memory[_PART_NUMBER].split(b"\0")[0].decode("ascii", "replace")

    def write(self, address: int, block: bytes) -> None:
        """Store a block of the definition."""
        if address % BLOCK_BYTES or address + BLOCK_BYTES > MEMORY_BYTES:
            raise Refusal(ErrorCode.OUT_OF_RANGE)
        self.memory[address : address + BLOCK_BYTES] = block
        self.written = True

    def initialise(self) -> None:
        """Accept the definition."""
        if not self.written:
            raise Refusal(ErrorCode.NO_TOOL)
        summed = sum(self.memory[6:]) & 0xFFFF
        stored = int.from_bytes(self.memory[4:6], "little")
        if not self.memory.startswith(_MAGIC) or summed != stored:
            raise Refusal(ErrorCode.PINIT_FAILED)
        self.initialised = True

    def enable(self) -> None:
        """Let the tool be tracked."""
        if not self.initialised:
            raise Refusal(ErrorCode.NOT_INITIALISED)
        self.enabled = True


class PortHandles:
    """All handles, by number."""

    def __init__(self) -> None:
        self._handles: dict[int, PortHandle] = {}

    def request(self) -> PortHandle:
        """A new handle for a passive tool."""
        for number in range(0x01, _LAST_HANDLE + 1):
            if number not in self._handles:
                self._handles[number] = handle = PortHandle(number)
                return handle
        raise Refusal(ErrorCode.HANDLES_TAKEN)

    def __getitem__(self, number: int) -> PortHandle:
        if number not in self._handles:
            raise Refusal(ErrorCode.BAD_HANDLE)
        return self._handles[number]

    def free(self, number: int) -> None:
        """Forget a handle and its tool."""
        self[number]
        del self._handles[number]

    def all(self) -> list[PortHandle]:
        """In the order of their numbers."""
        return [self._handles[number] for number in sorted(self._handles)]

    def enabled(self) -> list[PortHandle]:
        """Those that TX reports."""
        return [handle for handle in self.all() if handle.enabled]
