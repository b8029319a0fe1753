"""The meaning of the device's error codes, and their cures."""

from __future__ import annotations

BAD_COMMAND_CRC = 0x04
NOT_INITIALISED = 0x10

_RESTART = "power the camera off and on; if it stays, NDI's support knows more"
_SERVICE = "have the camera serviced: NDI's support"
_CABLE = "check cable and baud rate"
_DIALECT = "this camera speaks another dialect; report it"
_UPDATE = "update the camera's firmware"
_TOOL = "check the .rom file of the tool"
_OTHERS = "another program may use the camera; close it"

_CODES: dict[int, tuple[str, str]] = {
    0x01: ("invalid command", "this camera lacks a command that the driver needs; update it"),
    0x02: ("a command too long", _CABLE),
    0x03: ("a command too short", _CABLE),
    BAD_COMMAND_CRC: ("a command arrived damaged", _CABLE),
    0x05: ("it ran out of time for a command", _RESTART),
    0x06: (
        "it cannot set such communication parameters",
        "it can be tracked at the rate it has; try another adapter or port",
    ),
    0x07: ("wrong number of arguments", _DIALECT),
    0x08: ("invalid port handle", _RESTART),
    0x09: ("invalid tracking priority", _DIALECT),
    0x0A: ("invalid LED", _DIALECT),
    0x0B: ("invalid state of an LED", _DIALECT),
    0x0C: ("command not allowed in this mode", _OTHERS),
    0x0D: ("no tool on the port handle", _TOOL),
    0x0E: ("port handle not initialised", _TOOL),
    0x0F: ("port handle not enabled", _TOOL),
    NOT_INITIALISED: (
        "camera not initialised",
        "it was reset in mid-conversation; check its power",
    ),
    0x11: ("it cannot stop tracking", _RESTART),
    0x12: ("it cannot start tracking", _RESTART),
    0x13: ("tool cannot be initialised", _TOOL),
    0x14: ("invalid parameters of its own characterisation", _SERVICE),
    0x15: ("camera cannot be initialised", _RESTART),
    0x16: ("it cannot start its diagnostics", _RESTART),
    0x17: ("it cannot stop its diagnostics", _RESTART),
    0x18: ("it cannot measure the infrared light around", _RESTART),
    0x19: ("it cannot read its firmware's version", _RESTART),
    0x1A: ("internal error of the camera", _RESTART),
    0x1B: ("it cannot prepare to measure the infrared light around", _RESTART),
    0x1C: ("it cannot set how a marker flashes", _TOOL),
    0x1D: ("it cannot find the memories of tools", _TOOL),
    0x1E: ("it cannot read the memory of a tool", _TOOL),
    0x1F: ("it cannot write the memory of a tool", _TOOL),
    0x20: ("it cannot select the memory of a tool", _TOOL),
    0x21: ("it cannot measure the current of a tool", "check the plug of the tool"),
    0x22: (
        "its volume has no parameters for the wavelength of a tool",
        "give the .rom file of a tool that this camera can see",
    ),
    0x23: ("argument out of range", _DIALECT),
    0x24: ("it cannot select parameters by volume", _RESTART),
    0x25: ("it cannot tell its features", _UPDATE),
    0x28: (
        "too many tools, or of a kind that it cannot track",
        "a Polaris Vicra takes 6 passive tools; check tracker.tool_files",
    ),
    0x29: ("the firmware of its main processor is corrupt", _SERVICE),
    0x2A: (
        "it has no memory left",
        "power the camera off and on; an earlier program may have left tools loaded",
    ),
    0x2B: ("a port handle that was never given out", _RESTART),
    0x2C: ("the tool of a port handle was unplugged", "plug the tool in again"),
    0x2D: ("all port handles taken", "power the camera off and on"),
    0x2E: ("its firmware versions do not fit each other", _UPDATE),
    0x2F: ("invalid port description", _DIALECT),
    0x30: ("the port has a port handle already", _OTHERS),
    0x32: ("not possible with the device on that port handle", _TOOL),
    0x33: ("it does not have this feature", _UPDATE),
    0x34: ("it does not have such a user parameter", _UPDATE),
    0x35: ("invalid type of a value", _DIALECT),
    0x36: ("value of a user parameter out of range", _DIALECT),
    0x37: ("index of a user parameter out of range", _DIALECT),
    0x38: ("wrong size of a user parameter", _DIALECT),
    0x39: (
        "permission denied: read-only, or reserved for the host that controls the camera",
        _OTHERS,
    ),
    0x3B: ("it does not have such a file", _UPDATE),
    0x3C: ("it cannot write a file", _RESTART),
    0x3D: ("it cannot read a file", _RESTART),
    0x40: ("a tool definition is damaged or not one", _TOOL),
    0x41: ("it cannot track a tool of this kind", _TOOL),
    0x42: ("the device is not there", "check the cables of the camera"),
    0xF1: ("too much infrared light", "shade lamps and the sun"),
    0xF4: ("it cannot erase its flash memory", _SERVICE),
    0xF5: ("it cannot write its flash memory", _SERVICE),
    0xF6: ("it cannot read its flash memory", _SERVICE),
}


def meaning_of(code: int) -> tuple[str, str]:
    """Cause and cure of `ERRORnn`."""
    cause, cure = _CODES.get(
        code, ("not documented by NDI", "look it up in the camera's API guide")
    )
    return f"the camera refused a command: ERROR{code:02X}, {cause}", cure
