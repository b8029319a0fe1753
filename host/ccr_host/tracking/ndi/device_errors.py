"""What the device's error codes mean and what to do about them."""

from __future__ import annotations

BAD_COMMAND_CRC = 0x04

_CHECK_CAMERA = "power the camera off and on; if it stays, NDI's support knows more"

_CODES: dict[int, tuple[str, str]] = {
    0x01: ("invalid command", "this camera lacks a command that the driver needs; update it"),
    BAD_COMMAND_CRC: ("a command arrived damaged", "check cable and baud rate"),
    0x07: ("wrong number of arguments", "this camera speaks another dialect; report it"),
    0x08: ("invalid port handle", _CHECK_CAMERA),
    0x0C: ("command not allowed in this mode", "another program may use the camera; close it"),
    0x0D: ("no tool on the port handle", "check the .rom file of the tool"),
    0x0E: ("port handle not initialised", "check the .rom file of the tool"),
    0x0F: ("port handle not enabled", "check the .rom file of the tool"),
    0x10: ("camera not initialised", "it was reset in mid-conversation; check its power"),
    0x13: ("tool cannot be initialised", "check the .rom file of the tool"),
    0x15: ("camera cannot be initialised", _CHECK_CAMERA),
    0x1A: ("internal error of the camera", _CHECK_CAMERA),
    0x28: ("too many tools", "a Polaris Vicra takes 6 passive tools"),
    0x2D: ("all port handles taken", "power the camera off and on"),
}


def meaning_of(code: int) -> tuple[str, str]:
    """Cause and cure of `ERRORnn`."""
    cause, cure = _CODES.get(code, ("not known to this driver", "look it up in NDI's API guide"))
    return f"the camera refused a command: ERROR{code:02X}, {cause}", cure
