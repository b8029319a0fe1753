"""The errors of a board, each with its cause and its cure."""

from __future__ import annotations

from typing import Final

from ccr_host.core.errors import DeviceError
from ccr_host.link.messages import (
    PROTOCOL_VERSION,
    SPEC_HASH,
    ConfigGroups,
    Fault,
    HelloReply,
    NackCode,
    Request,
    ResetCause,
    State,
)

_FAULTS: Final = {
    Fault.NONE: ("the board is in fault without a reason", "report this as a bug"),
    Fault.LINK_LOSS: (
        "link loss: the board got no target in time and has led the robot to rest",
        "find out why the host stalled or the cable failed",
    ),
    Fault.WATCHDOG_RESET: (
        "watchdog reset: the firmware was stuck",
        "report this as a bug",
    ),
    Fault.BROWN_OUT_RESET: (
        "brown-out: the board's supply was too low",
        "give the servos a supply of their own",
    ),
    Fault.TICK_OVERRUN: (
        "tick overrun: a control tick took too long",
        "report this as a bug",
    ),
    Fault.STACK_LOW: ("stack low: the firmware is short of memory", "report this as a bug"),
    Fault.EEPROM_FAILED: (
        "EEPROM failed: a byte did not keep its value",
        "do not save; replace the board if it comes again",
    ),
    Fault.INTERNAL: (
        "internal: the firmware reached a state that should be impossible",
        "report this as a bug",
    ),
    Fault.RESET_WHILE_ARMED: (
        "reset while armed: the board restarted for an unknown reason while it held the robot",
        "look at its supply and its cable, and at the robot",
    ),
    Fault.EMERGENCY_STOP: (
        "emergency stop: its switch was pressed, or its wire is broken",
        "make the robot safe and release the switch",
    ),
    Fault.SUPPLY_LOW: (
        "supply low: the servos' supply broke down",
        "look for a servo that is blocked, a weak supply, thin or loose wires",
    ),
}

_CLEAR: Final = "then clear that with key c of: ccr-host jog"
_CHECK_LINK: Final = "check the board's power, its cable and the USB port or hub"

_REFUSALS: Final = {
    NackCode.UNKNOWN_ID: ("it does not know this request", "flash the board: ccr-host flash"),
    NackCode.BAD_LENGTH: (
        "the request has a length that it does not expect",
        "flash the board: ccr-host flash",
    ),
    NackCode.BAD_SESSION: (
        "the session is not the open one: another host took over, or the board was reset",
        "let only one host use the board",
    ),
    NackCode.BAD_STATE: (
        "not allowed in its state",
        "disarm it, or clear its fault (key c of: ccr-host jog), first",
    ),
    NackCode.OUT_OF_RANGE: ("a value is out of range", "correct the robot description"),
    NackCode.INCONSISTENT: ("values contradict each other", "correct the robot description"),
    NackCode.SPEC_MISMATCH: (
        "host and board were built from different specs",
        "flash the board: ccr-host flash, or upgrade the host",
    ),
    NackCode.NOT_CONFIGURED: ("its configuration is incomplete", "configure it first"),
    NackCode.BUSY: (
        "it is still saving its configuration, or has just stopped",
        "wait a second and try again",
    ),
    NackCode.EMERGENCY_STOP_OPEN: (
        "its emergency stop is pressed, or the wire to it broken",
        "release the switch",
    ),
}

_RESETS: Final = {
    ResetCause.UNKNOWN: ("for an unknown reason", "look at its cable and its supply"),
    ResetCause.POWER_ON: ("because its supply failed", "look at its supply"),
    ResetCause.EXTERNAL: (
        "through its reset pin",
        "keep other programs off the port and do not press the reset button",
    ),
    ResetCause.BROWN_OUT: (
        "because its supply fell too low",
        "give the servos a supply of their own",
    ),
    ResetCause.WATCHDOG: ("by its watchdog", "report this as a bug of the firmware"),
}


def firmware_version(identity: HelloReply) -> str:
    """Major, minor and patch, with dots."""
    return ".".join(map(str, identity.firmware_version))


class BoardSilentError(DeviceError):
    """The board answered none of the host's attempts.

    ``heard_before`` is whether the board has ever said anything on this connection, ``foreign``
    what arrived instead of an answer and no board sends.
    """

    def __init__(
        self, port: str, request: str, *, heard_before: bool = False, foreign: bytes = b""
    ) -> None:
        if heard_before:
            super().__init__(
                f"{port}: the board has fallen silent, no answer to {request}", _CHECK_LINK
            )
        elif foreign:
            super().__init__(
                f"{port}: what answers there is not a board of ours (it sent {foreign!r})",
                "check host and port, as another server may be there; flash a board with "
                "ccr-host flash",
            )
        else:
            super().__init__(
                f"{port}: no answer to {request}",
                "check that the port is the right one, the cable, and that the firmware is flashed",
            )


class SpecMismatchError(DeviceError):
    """Host and board were built from different specs: only reading and stopping are possible."""

    def __init__(self, identity: HelloReply) -> None:
        super().__init__(
            f"the board (firmware {firmware_version(identity)}) speaks protocol "
            f"{identity.protocol_version}, "
            f"spec {identity.spec_hash:08x}; this host protocol {PROTOCOL_VERSION}, "
            f"spec {SPEC_HASH:08x}",
            "flash the board: ccr-host flash, or upgrade the host to the board's version",
        )
        self.identity = identity


class WrongBoardError(DeviceError):
    """The board's name is not the one in the description."""

    def __init__(self, name: str, wanted: str) -> None:
        super().__init__(
            f"the board is named {name or 'nothing'}, robot.board_name is {wanted}",
            "check --device and --robot; ccr-host calibrate --board-name NAME names a board",
        )


class TooFewAxesError(DeviceError):
    """The board has fewer axes than the robot has motors."""

    def __init__(self, axes: int, motors: int) -> None:
        servos = f"{axes} servo{'s' * (axes != 1)}"
        super().__init__(
            f"the board drives {servos}, the described robot has {motors} motors",
            "check --device and --robot; a Mega 2560 drives up to 12: ccr-host flash --board "
            "mega2560",
        )


class MissingCapabilityError(DeviceError):
    """The board's firmware does not know an optional request."""

    def __init__(self, request: type[Request], identity: HelloReply) -> None:
        super().__init__(
            f"the board's firmware ({firmware_version(identity)}) does not know {request.NAME}",
            "flash the board: ccr-host flash",
        )


class RequestRefusedError(DeviceError):
    """The board has answered `nack`."""

    def __init__(self, request: type[Request], code: NackCode, detail: int) -> None:
        cause, cure = _REFUSALS[code]
        if code is NackCode.NOT_CONFIGURED and detail & ConfigGroups.EQUIPMENT:
            cure = (
                "its EEPROM was corrupt: tell it what is wired to it, with "
                "ccr-host calibrate --emergency-stop or --no-emergency-stop"
            )
        super().__init__(f"the board refuses {request.NAME}: {cause}{_detail(code, detail)}", cure)
        self.request = request
        self.code = code
        self.detail = detail


class SessionTakenError(DeviceError):
    """Another host has opened a session."""

    def __init__(self) -> None:
        super().__init__("another host has taken over the board", "let only one host use the board")


class BoardResetError(DeviceError):
    """The board has restarted while it was in use."""

    def __init__(self, cause: ResetCause) -> None:
        reason, cure = _RESETS[cause]
        super().__init__(f"the board has been reset {reason}", f"{cure}, then start again")
        self.reset_cause = cause


class BoardFaultError(DeviceError):
    """The board has latched a fault and ended the pulses."""

    def __init__(self, fault: Fault) -> None:
        cause, cure = _FAULTS[fault]
        super().__init__(f"the board is in fault: {cause}", f"{cure}; {_CLEAR}")
        self.fault = fault


class LinkLossError(DeviceError):
    """The board received no target in time and leads the robot to rest, or has done so.

    ``unfed_us`` is the time since the host's last target. Unless the host stalled, targets were
    sent and did not arrive. If ``latched``, the robot is at rest and a fault must be cleared.
    """

    def __init__(self, unfed_us: int, *, host_stalled: bool, latched: bool) -> None:
        if host_stalled:
            why = f"the host stalled and sent no target for {unfed_us * 1e-6:.1f} s"
            cure = "let nothing stop, suspend or starve this program"
        else:
            why, cure = "link loss: the targets sent did not reach the board", _CHECK_LINK
        led = "has led" if latched else "has begun to lead"
        clear = f"; {_CLEAR}" if latched else ""
        super().__init__(f"{why}; the board {led} the robot to rest", f"{cure}{clear}")


class BoardStoppedError(DeviceError):
    """The board has received an emergency stop."""

    def __init__(self) -> None:
        super().__init__("the board is stopped", f"see why it was stopped; {_CLEAR}")


class WrongStateError(DeviceError):
    """The board does not reach, or has left, the state that the host needs."""

    def __init__(self, wanted: State, actual: State) -> None:
        super().__init__(
            f"the board is {actual.name.lower()} instead of {wanted.name.lower()}",
            "reset the board; report this as a bug if it comes again",
        )


def _detail(code: NackCode, detail: int) -> str:
    if code is NackCode.BAD_STATE and detail in list(State):
        return f" ({State(detail).name.lower()})"
    if code is NackCode.OUT_OF_RANGE:
        return f" (field {detail})"
    if code is NackCode.INCONSISTENT:
        return f" (axis {detail + 1})"
    if code is NackCode.NOT_CONFIGURED:
        missing = [str(group.name).lower() for group in ConfigGroups if group & detail]
        return f" ({', '.join(missing)} missing)"
    return ""
