"""Error replies of the device."""

from __future__ import annotations

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
