"""Messages of the wire protocol. Generated from protocol/spec.toml: do not edit."""

from __future__ import annotations

import struct
from collections.abc import Mapping
from dataclasses import dataclass
from enum import IntEnum, IntFlag
from types import MappingProxyType
from typing import ClassVar, Final, Literal, Self, TypeAlias

from ccr_host.link.payload import Field, Payload, PayloadError

__all__ = ["Payload", "PayloadError"]  # re-exported; all else is public as it stands


PROTOCOL_VERSION: Final = 2
SPEC_HASH: Final = 0xFE5919A9
FIRMWARE_VERSION: Final = (0, 2, 0)

BAUD: Final = 250000
BAUD_FALLBACK: Final = 115200
FRAME_DELIMITER: Final = 0
MAX_PAYLOAD: Final = 48
MAX_DECODED_FRAME: Final = 52
MAX_ENCODED_FRAME: Final = 53
"""Without the delimiter."""

TICK_US: Final = 20000
"""Period of the control tick and of the servo pulses. [us]"""
TICK_PHASE_US: Final = 18000
"""From the start of a pulse frame to its control tick. No pulse lasts longer than 2.5 ms, so at the
tick the pins are low and a pulse can be enabled or disabled without cutting it; what the tick
computes is latched 2 ms later, at the start of the next frame. [us]
"""
BOOT_TICKS: Final = 5
"""Length of the self-test after a reset: control tick 5, the sixth, ends it. [tick]"""
RETRY_WINDOW_TICKS: Final = 50
"""Within this time a repeated request is answered from memory instead of being executed again.
[tick]
"""
WAY_TO_REST_MS: Final = 60000
"""The way to rest takes no longer whatever is configured: 270 deg in the smallest steps that slew
and relax slew may have, and 6 s to brake and to speed up with the least acceleration. [ms]
"""
LISTENS_AFTER_US: Final = 2000
"""From a reset until the board takes requests; what comes before that is lost. [us]"""
OUTSTANDING_REQUESTS: Final = 5
"""So many may a host have sent without having read their answers (REQ-5): the longest answers to
them and two reports fit into send_bytes. [request]
"""
OUTSTANDING_BYTES: Final = 63
"""And no more bytes than these, frames as they are on the wire: they fit where the board keeps what
it has received. [byte]
"""
SEND_BYTES: Final = 255
"""Room for frames that wait to be sent. One that finds none is dropped and counted. All but the
answer to `stop` leave room for that. [byte]
"""
SAG_TICKS: Final = 10
"""In so many ticks in a row the servos' supply has to be too low for a fault: longer than servos
take to start. [tick]
"""
FAULT_LOG_ADDRESS: Final = 320
"""Of the fault log in EEPROM (LOG-1). [byte]"""
FAULT_LOG_RECORDS: Final = 8
"""So many of the last faults are kept. [record]"""
LED_STEP_TICKS: Final = 8
"""Of the eight steps in which the LED shows the state (LED-1). [tick]"""
BLINK_STEP_TICKS: Final = 4
"""Half the period in which the LED blinks on request (LED-2). [tick]"""
PULSE_FLOOR_HALF_US: Final = 1000
"""No pulse is ever shorter, whatever the calibration says. [0.5 us]"""
PULSE_CEILING_HALF_US: Final = 5000
"""No pulse is ever longer, whatever the calibration says. [0.5 us]"""

EEPROM_SIZE: Final = 1024
EEPROM_SLOT_A: Final = 0
EEPROM_SLOT_B: Final = 128
EEPROM_SLOT_SIZE: Final = 70
EEPROM_BOOT_COUNTER: Final = 256
EEPROM_BOOT_COUNTERS: Final = 32
EEPROM_MAGIC: Final = 0xCC52
EEPROM_LAYOUT: Final = 2


class State(IntEnum):
    """State of the board.

    Only `arming`, `active`, `hold`, `relaxing` and `disarming` put pulses on the pins.
    """

    BOOT = 0
    """Self-test after a reset. No pulses."""
    DISARMED = 1
    """Ready. No pulses."""
    ARMING = 2
    """Servos are enabled one after the other at the last setpoint, then led slowly to rest."""
    ACTIVE = 3
    """Follows fresh targets."""
    HOLD = 4
    """Armed without a fresh target: the setpoint stands still."""
    RELAXING = 5
    """The host stayed silent: slow return to the rest pose. A fresh target ends it."""
    DISARMING = 6
    """The host asked to disarm: slow return to the rest pose, then no pulses."""
    FAULT = 7
    """Latched. No pulses. The first fault is kept until it is cleared."""
    STOPPED = 8
    """Emergency stop, latched. No pulses until it is cleared."""


class Event(IntEnum):
    """What moves the board from state to state; never on the wire."""

    SELF_TEST_PASSED = 0
    """`boot_ticks` after a reset, nothing wrong."""
    ARM_REQUESTED = 1
    """`arm` accepted."""
    AXES_ENABLED = 2
    """Both servos have pulses and the setpoint is at rest."""
    TARGET_ACCEPTED = 3
    """`set_target` accepted."""
    TARGET_EXPIRED = 4
    """The validity of the last target has run out."""
    HOLD_EXPIRED = 5
    """`hold` has lasted `relax_after_ms`."""
    REST_REACHED = 6
    """The setpoint is at rest."""
    DISARM_REQUESTED = 7
    """`disarm` accepted."""
    STOP_REQUESTED = 8
    """`stop` received."""
    FAULT_RAISED = 9
    """A fault was detected."""
    CLEAR_REQUESTED = 10
    """`clear_fault` accepted."""


class Fault(IntEnum):
    """Why the board is in `fault`."""

    NONE = 0
    """No fault."""
    LINK_LOSS = 1
    """No fresh target through `hold` and `relaxing`; the robot is at rest."""
    WATCHDOG_RESET = 2
    """The hardware watchdog has reset the board."""
    BROWN_OUT_RESET = 3
    """The supply fell below the brown-out level."""
    TICK_OVERRUN = 4
    """A control tick was not finished before the next one was due."""
    STACK_LOW = 5
    """Less than the minimum of free stack was left."""
    EEPROM_FAILED = 6
    """A byte read back from EEPROM was not the one written."""
    INTERNAL = 7
    """An invariant of the firmware did not hold."""
    RESET_WHILE_ARMED = 8
    """The board has restarted while it made pulses, and the boot loader has hidden why."""
    EMERGENCY_STOP = 9
    """The emergency-stop input is open: pressed, or its wire is broken."""
    SUPPLY_LOW = 10
    """The servos' supply was too low (SUP-3)."""


class ResetCause(IntEnum):
    """Why the board last started."""

    UNKNOWN = 0
    """The boot loader has hidden it."""
    POWER_ON = 1
    """Supply switched on."""
    EXTERNAL = 2
    """Reset pin, as when a serial port is opened (DTR)."""
    BROWN_OUT = 3
    """Supply too low."""
    WATCHDOG = 4
    """Hardware watchdog."""


class NackCode(IntEnum):
    """Why a request was refused.

    Checks are made in this order; the first that fails is reported.
    """

    UNKNOWN_ID = 1
    """No request has this id."""
    BAD_LENGTH = 2
    """The payload is not of the length this id has."""
    BAD_SESSION = 3
    """The session is not the open one. Detail: 0."""
    BAD_STATE = 4
    """Not allowed in this state. Detail: the state."""
    OUT_OF_RANGE = 5
    """A field is out of its range. Detail: index of the field in the payload, from 0."""
    INCONSISTENT = 6
    """Each field is in range but they contradict each other. Detail: the axis."""
    SPEC_MISMATCH = 7
    """The host was built from another spec: it may identify, read and stop."""
    NOT_CONFIGURED = 8
    """Some configuration group was neither loaded from EEPROM nor set. Detail: the missing groups.
    """
    BUSY = 9
    """A save is being written to EEPROM: `arm`, `save_config` and whatever sets a configuration
    group have to wait. Or no tick has taken the pulses away yet: `clear_fault` has to wait for
    one. Or a byte is being written to EEPROM: `get_fault_record` has to wait.
    """
    EMERGENCY_STOP_OPEN = 10
    """The emergency-stop input is open: `clear_fault` has to wait until it is closed."""


class EepromStatus(IntEnum):
    """What was found in EEPROM at boot."""

    BLANK = 0
    """Neither slot was ever written."""
    LOADED = 1
    """The newest slot was good, or one was good and the other blank."""
    ONE_SLOT_BAD = 2
    """One slot is corrupt; the other one was loaded."""
    BOTH_BAD = 3
    """Nothing could be loaded and at least one slot is corrupt: arming is refused until the host
    configures the board.
    """


class StatusFlags(IntFlag):
    """Details of the state."""

    AXIS_1_PULSES = 0x01
    """The last tick commanded a pulse for axis 1."""
    AXIS_2_PULSES = 0x02
    """The last tick commanded a pulse for axis 2."""
    MOVING = 0x04
    """The setpoint has not reached its goal: the target in `active`, the rest pose while it is led
    there.
    """
    CLAMPED = 0x08
    """The last accepted target was outside the angle limits, or its pulse outside the calibrated
    ones, and was clamped.
    """
    EEPROM_BUSY = 0x10
    """A save is being written."""
    CONFIGURED = 0x20
    """All configuration groups are present."""
    SESSION_OPEN = 0x40
    """A session is open."""
    UNSAVED = 0x80
    """A configuration group was set since the last save or load."""


class Capabilities(IntFlag):
    """What this board can do."""

    EEPROM = 0x01
    """Keeps its configuration."""
    HARDWARE_PULSES = 0x02
    """Pulses come from a timer, not from software."""
    STACK_MONITOR = 0x04
    """Reports the minimum of free stack."""


class ConfigGroups(IntFlag):
    """Groups of the configuration."""

    LIMITS = 0x01
    """`set_limits`"""
    SLEW = 0x02
    """`set_slew`"""
    WATCHDOG = 0x04
    """`set_watchdog`"""
    CALIBRATION = 0x08
    """`set_calibration`"""
    EQUIPMENT = 0x10
    """`set_equipment`; missing only where no slot of EEPROM could be loaded and one is corrupt"""


@dataclass(frozen=True, slots=True)
class Limits(Payload):
    """Angle limits and rest pose of both axes."""

    angle_min_cdeg: tuple[int, int]
    """Least angle of the servo. [0.01 deg] -13500 to 13500."""
    angle_max_cdeg: tuple[int, int]
    """Greatest angle of the servo. [0.01 deg] -13500 to 13500."""
    rest_cdeg: tuple[int, int]
    """Pose to which the robot is led when it is armed, relaxed or disarmed. [0.01 deg] -13500 to
    13500.
    """

    NAME: ClassVar[str] = "limits"
    SIZE: ClassVar[int] = 12
    LAYOUT: ClassVar[struct.Struct] = struct.Struct("<2h2h2h")
    FIELDS: ClassVar[tuple[Field, ...]] = (
        Field("angle_min_cdeg", "h", -13500, 13500, count=2, unit="deg", scale=0.01),
        Field("angle_max_cdeg", "h", -13500, 13500, count=2, unit="deg", scale=0.01),
        Field("rest_cdeg", "h", -13500, 13500, count=2, unit="deg", scale=0.01),
    )

    @classmethod
    def unpack(cls, payload: bytes) -> Self:
        values = cls._numbers(payload)
        return cls(
            (values[0], values[1]),
            (values[2], values[3]),
            (values[4], values[5]),
        )

    def inconsistent_axis(self) -> int | None:
        for axis in range(2):
            consistent = (
                self.angle_min_cdeg[axis] < self.angle_max_cdeg[axis]
                and self.angle_min_cdeg[axis] <= self.rest_cdeg[axis]
                and self.rest_cdeg[axis] <= self.angle_max_cdeg[axis]
            )
            if not consistent:
                return axis
        return None


@dataclass(frozen=True, slots=True)
class Slew(Payload):
    """How fast the setpoint may move."""

    slew_cdeg_tick: tuple[int, int]
    """Greatest change of the setpoint in one 20 ms tick. The least value bounds the way to rest
    (WDG-6). [0.01 deg/tick] 10 to 2000.
    """

    NAME: ClassVar[str] = "slew"
    SIZE: ClassVar[int] = 4
    LAYOUT: ClassVar[struct.Struct] = struct.Struct("<2H")
    FIELDS: ClassVar[tuple[Field, ...]] = (
        Field("slew_cdeg_tick", "H", 10, 2000, count=2, unit="deg/tick", scale=0.01),
    )

    @classmethod
    def unpack(cls, payload: bytes) -> Self:
        values = cls._numbers(payload)
        return cls((values[0], values[1]))


@dataclass(frozen=True, slots=True)
class Acceleration(Payload):
    """How fast the setpoint may change its speed. Zeros, which are not missing, set no limit."""

    acceleration_cdeg_tick2: tuple[int, int]
    """Greatest change of the setpoint's step from one tick to the next; 0: any. [0.01 deg/tick^2] 0
    to 2000.
    """

    NAME: ClassVar[str] = "acceleration"
    SIZE: ClassVar[int] = 4
    LAYOUT: ClassVar[struct.Struct] = struct.Struct("<2H")
    FIELDS: ClassVar[tuple[Field, ...]] = (
        Field("acceleration_cdeg_tick2", "H", 0, 2000, count=2, unit="deg/tick^2", scale=0.01),
    )

    @classmethod
    def unpack(cls, payload: bytes) -> Self:
        values = cls._numbers(payload)
        return cls((values[0], values[1]))


@dataclass(frozen=True, slots=True)
class Watchdog(Payload):
    """Staged reaction to a silent host. None of it can be switched off."""

    relax_after_ms: int
    """Length of `hold` before `relaxing`. [ms] 20 to 60000."""
    relax_slew_cdeg_tick: int
    """Speed of the slow return to rest, also while arming and disarming. The lesser of this and the
    slew limit counts. [0.01 deg/tick] 10 to 500.
    """
    arm_axis_ms: int
    """Wait after each servo is enabled. [ms] 20 to 5000."""

    NAME: ClassVar[str] = "watchdog"
    SIZE: ClassVar[int] = 6
    LAYOUT: ClassVar[struct.Struct] = struct.Struct("<HHH")
    FIELDS: ClassVar[tuple[Field, ...]] = (
        Field("relax_after_ms", "H", 20, 60000, unit="ms"),
        Field("relax_slew_cdeg_tick", "H", 10, 500, unit="deg/tick", scale=0.01),
        Field("arm_axis_ms", "H", 20, 5000, unit="ms"),
    )

    @classmethod
    def unpack(cls, payload: bytes) -> Self:
        values = cls._numbers(payload)
        return cls(
            values[0],
            values[1],
            values[2],
        )


@dataclass(frozen=True, slots=True)
class Calibration(Payload):
    """Payload of `calibration`.

    From angle to pulse: pulse = neutral + round(angle_cdeg * per_90_deg / 9000), halves away from
    zero, then clamped to min and max.
    """

    neutral_half_us: tuple[int, int]
    """Pulse at 0 deg. [0.5 us] 1000 to 5000."""
    per_90_deg_half_us: tuple[int, int]
    """Change of the pulse for +90 deg; negative where the servo turns the other way. [0.5 us] -4000
    to 4000.
    """
    pulse_min_half_us: tuple[int, int]
    """Least pulse this servo may get. [0.5 us] 1000 to 5000."""
    pulse_max_half_us: tuple[int, int]
    """Greatest pulse this servo may get. [0.5 us] 1000 to 5000."""

    NAME: ClassVar[str] = "calibration"
    SIZE: ClassVar[int] = 16
    LAYOUT: ClassVar[struct.Struct] = struct.Struct("<2H2h2H2H")
    FIELDS: ClassVar[tuple[Field, ...]] = (
        Field("neutral_half_us", "H", 1000, 5000, count=2, unit="us", scale=0.5),
        Field("per_90_deg_half_us", "h", -4000, 4000, count=2, unit="us", scale=0.5),
        Field("pulse_min_half_us", "H", 1000, 5000, count=2, unit="us", scale=0.5),
        Field("pulse_max_half_us", "H", 1000, 5000, count=2, unit="us", scale=0.5),
    )

    @classmethod
    def unpack(cls, payload: bytes) -> Self:
        values = cls._numbers(payload)
        return cls(
            (values[0], values[1]),
            (values[2], values[3]),
            (values[4], values[5]),
            (values[6], values[7]),
        )

    def inconsistent_axis(self) -> int | None:
        for axis in range(2):
            consistent = (
                self.pulse_min_half_us[axis] < self.pulse_max_half_us[axis]
                and self.pulse_min_half_us[axis] <= self.neutral_half_us[axis]
                and self.neutral_half_us[axis] <= self.pulse_max_half_us[axis]
                and self.per_90_deg_half_us[axis] not in range(-99, 100)
            )
            if not consistent:
                return axis
        return None


@dataclass(frozen=True, slots=True)
class Equipment(Payload):
    """The board's name, and what is wired to it.

    It belongs to the board, not to a robot's description; zeros are a board without a name to which
    only the servos are wired.
    """

    board_name: tuple[int, ...]
    """ASCII, filled up with zeros. Any bytes are kept; the host judges them."""
    emergency_stop: int
    """1: a switch is wired to the emergency-stop input, closed unless it is pressed. 0 to 1."""
    supply_full_dv: int
    """Servo supply at which the divider gives 5 V; 0: none is wired. [0.1 V]"""
    supply_min_dv: int
    """Below it the servo supply is too low; 0: never. [0.1 V]"""

    NAME: ClassVar[str] = "equipment"
    SIZE: ClassVar[int] = 19
    LAYOUT: ClassVar[struct.Struct] = struct.Struct("<16BBBB")
    FIELDS: ClassVar[tuple[Field, ...]] = (
        Field("board_name", "B", 0, 255, count=16),
        Field("emergency_stop", "B", 0, 1),
        Field("supply_full_dv", "B", 0, 255, unit="V", scale=0.1),
        Field("supply_min_dv", "B", 0, 255, unit="V", scale=0.1),
    )

    @classmethod
    def unpack(cls, payload: bytes) -> Self:
        values = cls._numbers(payload)
        return cls(
            values[0:16],
            values[16],
            values[17],
            values[18],
        )


@dataclass(frozen=True, slots=True)
class FaultRecord(Payload):
    """A fault as it is kept in EEPROM.

    Whoever reads it judges `check`: one that was never written, or not to its end, has another.
    """

    number: int
    """Counts faults; after 0xFFFF comes 0."""
    fault: int
    """The fault."""
    state: int
    """State after the tick before."""
    boot_id: int
    """As in `hello_reply`: the start in which it came."""
    tick: int
    """Tick in which it was seen, as a report numbers it. [tick]"""
    check: int
    """CRC-32 (ISO-HDLC) of the bytes before."""

    NAME: ClassVar[str] = "fault_record"
    SIZE: ClassVar[int] = 14
    LAYOUT: ClassVar[struct.Struct] = struct.Struct("<HBBHII")
    FIELDS: ClassVar[tuple[Field, ...]] = (
        Field("number", "H", 0, 65535),
        Field("fault", "B", 0, 255),
        Field("state", "B", 0, 255),
        Field("boot_id", "H", 0, 65535),
        Field("tick", "I", 0, 4294967295, unit="tick"),
        Field("check", "I", 0, 4294967295),
    )

    @classmethod
    def unpack(cls, payload: bytes) -> Self:
        values = cls._numbers(payload)
        return cls(
            values[0],
            values[1],
            values[2],
            values[3],
            values[4],
            values[5],
        )


@dataclass(frozen=True, slots=True)
class StateReport(Payload):
    """Payload of `state_report`.

    Tick, setpoint, pulses, supply and the flags `axis_1_pulses`, `axis_2_pulses` and `moving` are
    those of the last control tick; all else is current.
    """

    tick: int
    """Control ticks since the reset. [tick]"""
    state: State
    """State."""
    fault: Fault
    """First fault since the last clear."""
    flags: StatusFlags
    """Details."""
    target_sequence: int
    """Sequence number of the last accepted target; 0 before the first."""
    target_age_ms: int
    """Control ticks since the last accepted target, as a time: 20 in the report of the first tick
    after it; 65535 before the first target and when it is older. [ms]
    """
    target_cdeg: tuple[int, int]
    """Last accepted target, after clamping; 0 before the first. [0.01 deg]"""
    setpoint_cdeg: tuple[int, int]
    """Where ramp and slew limit stand. A setpoint that `set_limits` has clamped shows from the next
    tick on. [0.01 deg]
    """
    pulse_half_us: tuple[int, int]
    """Pulses that the last tick computed, latched at the start of the next frame; 0 is no pulse.
    [0.5 us]
    """
    link_errors: int
    """bad_crc + bad_encoding + bad_size + overruns, wrapping."""
    free_stack_bytes: int
    """Least free stack so far; 65535 where it is not measured. [byte]"""
    supply_dv: int
    """Servo supply in the last tick; 0 where none is wired. [0.1 V]"""

    NAME: ClassVar[str] = "state_report"
    SIZE: ClassVar[int] = 27
    LAYOUT: ClassVar[struct.Struct] = struct.Struct("<IBBBBH2h2h2HHHB")
    FIELDS: ClassVar[tuple[Field, ...]] = (
        Field("tick", "I", 0, 4294967295, unit="tick"),
        Field("state", "B", 0, 255),
        Field("fault", "B", 0, 255),
        Field("flags", "B", 0, 255),
        Field("target_sequence", "B", 0, 255),
        Field("target_age_ms", "H", 0, 65535, unit="ms"),
        Field("target_cdeg", "h", -32768, 32767, count=2, unit="deg", scale=0.01),
        Field("setpoint_cdeg", "h", -32768, 32767, count=2, unit="deg", scale=0.01),
        Field("pulse_half_us", "H", 0, 65535, count=2, unit="us", scale=0.5),
        Field("link_errors", "H", 0, 65535),
        Field("free_stack_bytes", "H", 0, 65535, unit="byte"),
        Field("supply_dv", "B", 0, 255, unit="V", scale=0.1),
    )

    @classmethod
    def unpack(cls, payload: bytes) -> Self:
        values = cls._numbers(payload)
        return cls(
            values[0],
            cls._enumerator("state", State, values[1]),
            cls._enumerator("fault", Fault, values[2]),
            StatusFlags(values[3]),
            values[4],
            values[5],
            (values[6], values[7]),
            (values[8], values[9]),
            (values[10], values[11]),
            values[12],
            values[13],
            values[14],
        )


Retry: TypeAlias = Literal["repeat", "once", "never"]


class Message(Payload):
    """A payload with an id of its own."""

    __slots__ = ()

    ID: ClassVar[int]


class Request(Message):
    """A message to the board, and how the board treats it."""

    __slots__ = ()

    REPLY_ID: ClassVar[int]
    RETRY: ClassVar[Retry]
    NEEDS_SESSION: ClassVar[bool]
    ALLOWED_STATES: ClassVar[frozenset[State]]


@dataclass(frozen=True, slots=True)
class Hello(Request):
    """Asks who is there.

    The layout of `hello` and `hello_reply` is the same in all protocol versions.
    """

    protocol_version: int
    """Version the host speaks."""
    spec_hash: int
    """Hash of the spec the host was built from."""

    NAME: ClassVar[str] = "hello"
    SIZE: ClassVar[int] = 5
    LAYOUT: ClassVar[struct.Struct] = struct.Struct("<BI")
    ID: ClassVar[int] = 0x01
    REPLY_ID: ClassVar[int] = 0x81
    RETRY: ClassVar[Retry] = "repeat"
    NEEDS_SESSION: ClassVar[bool] = False
    ALLOWED_STATES: ClassVar[frozenset[State]] = frozenset(State)
    FIELDS: ClassVar[tuple[Field, ...]] = (
        Field("protocol_version", "B", 0, 255),
        Field("spec_hash", "I", 0, 4294967295),
    )

    @classmethod
    def unpack(cls, payload: bytes) -> Self:
        values = cls._numbers(payload)
        return cls(
            values[0],
            values[1],
        )


@dataclass(frozen=True, slots=True)
class HelloReply(Message):
    """Identity and limits of the board."""

    protocol_version: int
    """Version the board speaks."""
    spec_hash: int
    """Hash of the spec the board was built from."""
    firmware_version: tuple[int, int, int]
    """Major, minor, patch."""
    boot_id: int
    """Counts resets; a change tells the host that the board has restarted."""
    reset_cause: ResetCause
    """Why it last started."""
    eeprom_status: EepromStatus
    """What was found in EEPROM."""
    capabilities: Capabilities
    """What it can do."""
    axes: int
    """Number of servos."""
    max_payload: int
    """Longest payload it takes. [byte]"""
    tick_us: int
    """Period of the control tick. [us]"""

    NAME: ClassVar[str] = "hello_reply"
    SIZE: ClassVar[int] = 18
    LAYOUT: ClassVar[struct.Struct] = struct.Struct("<BI3BHBBHBBH")
    ID: ClassVar[int] = 0x81
    FIELDS: ClassVar[tuple[Field, ...]] = (
        Field("protocol_version", "B", 0, 255),
        Field("spec_hash", "I", 0, 4294967295),
        Field("firmware_version", "B", 0, 255, count=3),
        Field("boot_id", "H", 0, 65535),
        Field("reset_cause", "B", 0, 255),
        Field("eeprom_status", "B", 0, 255),
        Field("capabilities", "H", 0, 65535),
        Field("axes", "B", 0, 255),
        Field("max_payload", "B", 0, 255, unit="byte"),
        Field("tick_us", "H", 0, 65535, unit="us"),
    )

    @classmethod
    def unpack(cls, payload: bytes) -> Self:
        values = cls._numbers(payload)
        return cls(
            values[0],
            values[1],
            (values[2], values[3], values[4]),
            values[5],
            cls._enumerator("reset_cause", ResetCause, values[6]),
            cls._enumerator("eeprom_status", EepromStatus, values[7]),
            Capabilities(values[8]),
            values[9],
            values[10],
            values[11],
        )


@dataclass(frozen=True, slots=True)
class OpenSession(Request):
    """Opens a session and ends any other: what the other host sends from then on is refused.

    The state stays as it is, the telemetry stream and the memory of answered requests are cleared.
    """

    spec_hash: int
    """Hash of the spec the host was built from; another one is refused."""
    session: int
    """Chosen at random by the host. Every request that changes something carries it, so that
    neither noise nor a host that was superseded is obeyed. 1 to 65535.
    """

    NAME: ClassVar[str] = "open_session"
    SIZE: ClassVar[int] = 6
    LAYOUT: ClassVar[struct.Struct] = struct.Struct("<IH")
    ID: ClassVar[int] = 0x02
    REPLY_ID: ClassVar[int] = 0x82
    RETRY: ClassVar[Retry] = "repeat"
    NEEDS_SESSION: ClassVar[bool] = False
    ALLOWED_STATES: ClassVar[frozenset[State]] = frozenset(
        {
            State.DISARMED,
            State.ARMING,
            State.ACTIVE,
            State.HOLD,
            State.RELAXING,
            State.DISARMING,
            State.FAULT,
            State.STOPPED,
        }
    )
    FIELDS: ClassVar[tuple[Field, ...]] = (
        Field("spec_hash", "I", 0, 4294967295),
        Field("session", "H", 1, 65535),
    )

    @classmethod
    def unpack(cls, payload: bytes) -> Self:
        values = cls._numbers(payload)
        return cls(
            values[0],
            values[1],
        )


@dataclass(frozen=True, slots=True)
class SessionReply(Message):
    """The session is open."""

    session: int
    """The open session."""
    boot_id: int
    """As in `hello_reply`."""
    state: State
    """State."""

    NAME: ClassVar[str] = "session_reply"
    SIZE: ClassVar[int] = 5
    LAYOUT: ClassVar[struct.Struct] = struct.Struct("<HHB")
    ID: ClassVar[int] = 0x82
    FIELDS: ClassVar[tuple[Field, ...]] = (
        Field("session", "H", 0, 65535),
        Field("boot_id", "H", 0, 65535),
        Field("state", "B", 0, 255),
    )

    @classmethod
    def unpack(cls, payload: bytes) -> Self:
        values = cls._numbers(payload)
        return cls(
            values[0],
            values[1],
            cls._enumerator("state", State, values[2]),
        )


@dataclass(frozen=True, slots=True)
class ClockSync(Request):
    """Reads the board's clock, to relate it to the host's."""

    host_time_us: int
    """Anything; comes back. [us]"""

    NAME: ClassVar[str] = "clock_sync"
    SIZE: ClassVar[int] = 4
    LAYOUT: ClassVar[struct.Struct] = struct.Struct("<I")
    ID: ClassVar[int] = 0x03
    REPLY_ID: ClassVar[int] = 0x83
    RETRY: ClassVar[Retry] = "repeat"
    NEEDS_SESSION: ClassVar[bool] = False
    ALLOWED_STATES: ClassVar[frozenset[State]] = frozenset(State)
    FIELDS: ClassVar[tuple[Field, ...]] = (Field("host_time_us", "I", 0, 4294967295, unit="us"),)

    @classmethod
    def unpack(cls, payload: bytes) -> Self:
        values = cls._numbers(payload)
        return cls(values[0])


@dataclass(frozen=True, slots=True)
class ClockReply(Message):
    """The board's clock when the request was dispatched."""

    host_time_us: int
    """From the request. [us]"""
    board_time_us: int
    """Since the reset; wraps after 71.6 minutes. [us]"""

    NAME: ClassVar[str] = "clock_reply"
    SIZE: ClassVar[int] = 8
    LAYOUT: ClassVar[struct.Struct] = struct.Struct("<II")
    ID: ClassVar[int] = 0x83
    FIELDS: ClassVar[tuple[Field, ...]] = (
        Field("host_time_us", "I", 0, 4294967295, unit="us"),
        Field("board_time_us", "I", 0, 4294967295, unit="us"),
    )

    @classmethod
    def unpack(cls, payload: bytes) -> Self:
        values = cls._numbers(payload)
        return cls(
            values[0],
            values[1],
        )


@dataclass(frozen=True, slots=True)
class GetState(Request):
    """Reads the state once."""

    NAME: ClassVar[str] = "get_state"
    SIZE: ClassVar[int] = 0
    LAYOUT: ClassVar[struct.Struct] = struct.Struct("<")
    ID: ClassVar[int] = 0x07
    REPLY_ID: ClassVar[int] = 0x87
    RETRY: ClassVar[Retry] = "repeat"
    NEEDS_SESSION: ClassVar[bool] = False
    ALLOWED_STATES: ClassVar[frozenset[State]] = frozenset(State)
    FIELDS: ClassVar[tuple[Field, ...]] = ()

    @classmethod
    def unpack(cls, payload: bytes) -> Self:
        cls._numbers(payload)
        return cls()


@dataclass(frozen=True, slots=True)
class StateReply(Message):
    """The state."""

    report: StateReport

    NAME: ClassVar[str] = "state_reply"
    SIZE: ClassVar[int] = 27
    LAYOUT: ClassVar[struct.Struct] = struct.Struct("<")
    ID: ClassVar[int] = 0x87
    FIELDS: ClassVar[tuple[Field, ...]] = ()
    NESTED: ClassVar[str | None] = "report"

    @classmethod
    def unpack(cls, payload: bytes) -> Self:
        cls._numbers(payload)
        return cls(StateReport.unpack(payload))


@dataclass(frozen=True, slots=True)
class GetCounters(Request):
    """Reads what has been counted since the reset. All counters wrap."""

    NAME: ClassVar[str] = "get_counters"
    SIZE: ClassVar[int] = 0
    LAYOUT: ClassVar[struct.Struct] = struct.Struct("<")
    ID: ClassVar[int] = 0x05
    REPLY_ID: ClassVar[int] = 0x85
    RETRY: ClassVar[Retry] = "repeat"
    NEEDS_SESSION: ClassVar[bool] = False
    ALLOWED_STATES: ClassVar[frozenset[State]] = frozenset(State)
    FIELDS: ClassVar[tuple[Field, ...]] = ()

    @classmethod
    def unpack(cls, payload: bytes) -> Self:
        cls._numbers(payload)
        return cls()


@dataclass(frozen=True, slots=True)
class CountersReply(Message):
    """What has been counted since the reset."""

    frames_accepted: int
    """Frames with a good CRC."""
    bad_crc: int
    """Frames with a bad CRC. They are not answered."""
    bad_encoding: int
    """Frames that are not COBS."""
    bad_size: int
    """Frames too short or too long to be one."""
    overruns: int
    """Bytes lost because they were not read in time."""
    replies_dropped: int
    """Frames not sent because they found no room in send_bytes."""
    nacks: int
    """Requests refused."""
    repeats_answered: int
    """Requests answered from memory."""
    targets_accepted: int
    """Accepted targets."""
    targets_clamped: int
    """Accepted targets that had to be clamped."""
    holds: int
    """Entries into `hold` from `active`."""
    relaxes: int
    """Entries into `relaxing`."""
    saves: int
    """Saves finished."""

    NAME: ClassVar[str] = "counters_reply"
    SIZE: ClassVar[int] = 30
    LAYOUT: ClassVar[struct.Struct] = struct.Struct("<IHHHHHHHIHHHH")
    ID: ClassVar[int] = 0x85
    FIELDS: ClassVar[tuple[Field, ...]] = (
        Field("frames_accepted", "I", 0, 4294967295),
        Field("bad_crc", "H", 0, 65535),
        Field("bad_encoding", "H", 0, 65535),
        Field("bad_size", "H", 0, 65535),
        Field("overruns", "H", 0, 65535),
        Field("replies_dropped", "H", 0, 65535),
        Field("nacks", "H", 0, 65535),
        Field("repeats_answered", "H", 0, 65535),
        Field("targets_accepted", "I", 0, 4294967295),
        Field("targets_clamped", "H", 0, 65535),
        Field("holds", "H", 0, 65535),
        Field("relaxes", "H", 0, 65535),
        Field("saves", "H", 0, 65535),
    )

    @classmethod
    def unpack(cls, payload: bytes) -> Self:
        values = cls._numbers(payload)
        return cls(
            values[0],
            values[1],
            values[2],
            values[3],
            values[4],
            values[5],
            values[6],
            values[7],
            values[8],
            values[9],
            values[10],
            values[11],
            values[12],
        )


@dataclass(frozen=True, slots=True)
class SetTelemetry(Request):
    """Starts or ends the stream of `telemetry`."""

    session: int
    """The open session."""
    period_ticks: int
    """One report in so many ticks; 0 ends the stream. [tick]"""

    NAME: ClassVar[str] = "set_telemetry"
    SIZE: ClassVar[int] = 3
    LAYOUT: ClassVar[struct.Struct] = struct.Struct("<HB")
    ID: ClassVar[int] = 0x06
    REPLY_ID: ClassVar[int] = 0x70
    RETRY: ClassVar[Retry] = "once"
    NEEDS_SESSION: ClassVar[bool] = True
    ALLOWED_STATES: ClassVar[frozenset[State]] = frozenset(
        {
            State.DISARMED,
            State.ARMING,
            State.ACTIVE,
            State.HOLD,
            State.RELAXING,
            State.DISARMING,
            State.FAULT,
            State.STOPPED,
        }
    )
    FIELDS: ClassVar[tuple[Field, ...]] = (
        Field("session", "H", 0, 65535),
        Field("period_ticks", "B", 0, 255, unit="tick"),
    )

    @classmethod
    def unpack(cls, payload: bytes) -> Self:
        values = cls._numbers(payload)
        return cls(
            values[0],
            values[1],
        )


@dataclass(frozen=True, slots=True)
class Blink(Request):
    """Lets the LED blink, so that one board of several is found.

    Needs no session and changes nothing else.
    """

    duration_s: int
    """How long the LED blinks, from the next tick on; 0 ends it. [s] 0 to 60."""

    NAME: ClassVar[str] = "blink"
    SIZE: ClassVar[int] = 1
    LAYOUT: ClassVar[struct.Struct] = struct.Struct("<B")
    ID: ClassVar[int] = 0x08
    REPLY_ID: ClassVar[int] = 0x70
    RETRY: ClassVar[Retry] = "repeat"
    NEEDS_SESSION: ClassVar[bool] = False
    ALLOWED_STATES: ClassVar[frozenset[State]] = frozenset(State)
    FIELDS: ClassVar[tuple[Field, ...]] = (Field("duration_s", "B", 0, 60, unit="s"),)

    @classmethod
    def unpack(cls, payload: bytes) -> Self:
        values = cls._numbers(payload)
        return cls(values[0])


@dataclass(frozen=True, slots=True)
class GetFaultRecord(Request):
    """Reads a record of the fault log.

    Refused with busy while a byte is being written to EEPROM.
    """

    place: int
    """Of the record in EEPROM; the numbers tell which is the newest. 0 to 7."""

    NAME: ClassVar[str] = "get_fault_record"
    SIZE: ClassVar[int] = 1
    LAYOUT: ClassVar[struct.Struct] = struct.Struct("<B")
    ID: ClassVar[int] = 0x09
    REPLY_ID: ClassVar[int] = 0x89
    RETRY: ClassVar[Retry] = "repeat"
    NEEDS_SESSION: ClassVar[bool] = False
    ALLOWED_STATES: ClassVar[frozenset[State]] = frozenset(State)
    FIELDS: ClassVar[tuple[Field, ...]] = (Field("place", "B", 0, 7),)

    @classmethod
    def unpack(cls, payload: bytes) -> Self:
        values = cls._numbers(payload)
        return cls(values[0])


@dataclass(frozen=True, slots=True)
class FaultRecordReply(Message):
    """The record, whatever is there."""

    record: FaultRecord

    NAME: ClassVar[str] = "fault_record_reply"
    SIZE: ClassVar[int] = 14
    LAYOUT: ClassVar[struct.Struct] = struct.Struct("<")
    ID: ClassVar[int] = 0x89
    FIELDS: ClassVar[tuple[Field, ...]] = ()
    NESTED: ClassVar[str | None] = "record"

    @classmethod
    def unpack(cls, payload: bytes) -> Self:
        cls._numbers(payload)
        return cls(FaultRecord.unpack(payload))


@dataclass(frozen=True, slots=True)
class Arm(Request):
    """Enables the servos one after the other.

    Refused while the configuration is incomplete or being saved.
    """

    session: int
    """The open session."""

    NAME: ClassVar[str] = "arm"
    SIZE: ClassVar[int] = 2
    LAYOUT: ClassVar[struct.Struct] = struct.Struct("<H")
    ID: ClassVar[int] = 0x10
    REPLY_ID: ClassVar[int] = 0x70
    RETRY: ClassVar[Retry] = "once"
    NEEDS_SESSION: ClassVar[bool] = True
    ALLOWED_STATES: ClassVar[frozenset[State]] = frozenset({State.DISARMED})
    FIELDS: ClassVar[tuple[Field, ...]] = (Field("session", "H", 0, 65535),)

    @classmethod
    def unpack(cls, payload: bytes) -> Self:
        values = cls._numbers(payload)
        return cls(values[0])


@dataclass(frozen=True, slots=True)
class Disarm(Request):
    """Leads the robot slowly to rest, then takes the pulses away.

    In `disarmed` and `disarming` it changes nothing.
    """

    session: int
    """The open session."""

    NAME: ClassVar[str] = "disarm"
    SIZE: ClassVar[int] = 2
    LAYOUT: ClassVar[struct.Struct] = struct.Struct("<H")
    ID: ClassVar[int] = 0x11
    REPLY_ID: ClassVar[int] = 0x70
    RETRY: ClassVar[Retry] = "once"
    NEEDS_SESSION: ClassVar[bool] = True
    ALLOWED_STATES: ClassVar[frozenset[State]] = frozenset(
        {
            State.DISARMED,
            State.ARMING,
            State.ACTIVE,
            State.HOLD,
            State.RELAXING,
            State.DISARMING,
        }
    )
    FIELDS: ClassVar[tuple[Field, ...]] = (Field("session", "H", 0, 65535),)

    @classmethod
    def unpack(cls, payload: bytes) -> Self:
        values = cls._numbers(payload)
        return cls(values[0])


@dataclass(frozen=True, slots=True)
class Stop(Request):
    """Emergency stop: takes the pulses away at the next frame. Needs no session."""

    NAME: ClassVar[str] = "stop"
    SIZE: ClassVar[int] = 0
    LAYOUT: ClassVar[struct.Struct] = struct.Struct("<")
    ID: ClassVar[int] = 0x12
    REPLY_ID: ClassVar[int] = 0x70
    RETRY: ClassVar[Retry] = "repeat"
    NEEDS_SESSION: ClassVar[bool] = False
    ALLOWED_STATES: ClassVar[frozenset[State]] = frozenset(State)
    FIELDS: ClassVar[tuple[Field, ...]] = ()

    @classmethod
    def unpack(cls, payload: bytes) -> Self:
        cls._numbers(payload)
        return cls()


@dataclass(frozen=True, slots=True)
class ClearFault(Request):
    """Acknowledges a fault or a stop, once the pulses are gone.

    The board is then disarmed; it never arms itself.
    """

    session: int
    """The open session."""

    NAME: ClassVar[str] = "clear_fault"
    SIZE: ClassVar[int] = 2
    LAYOUT: ClassVar[struct.Struct] = struct.Struct("<H")
    ID: ClassVar[int] = 0x13
    REPLY_ID: ClassVar[int] = 0x70
    RETRY: ClassVar[Retry] = "once"
    NEEDS_SESSION: ClassVar[bool] = True
    ALLOWED_STATES: ClassVar[frozenset[State]] = frozenset(
        {
            State.FAULT,
            State.STOPPED,
        }
    )
    FIELDS: ClassVar[tuple[Field, ...]] = (Field("session", "H", 0, 65535),)

    @classmethod
    def unpack(cls, payload: bytes) -> Self:
        values = cls._numbers(payload)
        return cls(values[0])


@dataclass(frozen=True, slots=True)
class SetTarget(Request):
    """New target of both axes. The latest wins. Only this feeds the link watchdog."""

    session: int
    """The open session."""
    target_cdeg: tuple[int, int]
    """Servo angles; clamped to the angle limits. [0.01 deg] -18000 to 18000."""
    ramp_ms: int
    """The setpoint goes there in a straight line over this time, or as fast as the slew limit lets
    it. [ms] 0 to 10000.
    """
    validity_ms: int
    """Unless another target follows within this time the board holds. [ms] 20 to 10000."""

    NAME: ClassVar[str] = "set_target"
    SIZE: ClassVar[int] = 10
    LAYOUT: ClassVar[struct.Struct] = struct.Struct("<H2hHH")
    ID: ClassVar[int] = 0x20
    REPLY_ID: ClassVar[int] = 0xA0
    RETRY: ClassVar[Retry] = "never"
    NEEDS_SESSION: ClassVar[bool] = True
    ALLOWED_STATES: ClassVar[frozenset[State]] = frozenset(
        {
            State.ACTIVE,
            State.HOLD,
            State.RELAXING,
        }
    )
    FIELDS: ClassVar[tuple[Field, ...]] = (
        Field("session", "H", 0, 65535),
        Field("target_cdeg", "h", -18000, 18000, count=2, unit="deg", scale=0.01),
        Field("ramp_ms", "H", 0, 10000, unit="ms"),
        Field("validity_ms", "H", 20, 10000, unit="ms"),
    )

    @classmethod
    def unpack(cls, payload: bytes) -> Self:
        values = cls._numbers(payload)
        return cls(
            values[0],
            (values[1], values[2]),
            values[3],
            values[4],
        )


@dataclass(frozen=True, slots=True)
class TargetReply(Message):
    """What was really accepted."""

    state: State
    """State."""
    flags: StatusFlags
    """Details."""
    target_cdeg: tuple[int, int]
    """Accepted target, after clamping. [0.01 deg]"""

    NAME: ClassVar[str] = "target_reply"
    SIZE: ClassVar[int] = 6
    LAYOUT: ClassVar[struct.Struct] = struct.Struct("<BB2h")
    ID: ClassVar[int] = 0xA0
    FIELDS: ClassVar[tuple[Field, ...]] = (
        Field("state", "B", 0, 255),
        Field("flags", "B", 0, 255),
        Field("target_cdeg", "h", -32768, 32767, count=2, unit="deg", scale=0.01),
    )

    @classmethod
    def unpack(cls, payload: bytes) -> Self:
        values = cls._numbers(payload)
        return cls(
            cls._enumerator("state", State, values[0]),
            StatusFlags(values[1]),
            (values[2], values[3]),
        )


@dataclass(frozen=True, slots=True)
class GetLimits(Request):
    """Reads the angle limits."""

    NAME: ClassVar[str] = "get_limits"
    SIZE: ClassVar[int] = 0
    LAYOUT: ClassVar[struct.Struct] = struct.Struct("<")
    ID: ClassVar[int] = 0x30
    REPLY_ID: ClassVar[int] = 0xB0
    RETRY: ClassVar[Retry] = "repeat"
    NEEDS_SESSION: ClassVar[bool] = False
    ALLOWED_STATES: ClassVar[frozenset[State]] = frozenset(State)
    FIELDS: ClassVar[tuple[Field, ...]] = ()

    @classmethod
    def unpack(cls, payload: bytes) -> Self:
        cls._numbers(payload)
        return cls()


@dataclass(frozen=True, slots=True)
class LimitsReply(Message):
    """The angle limits in use."""

    limits: Limits

    NAME: ClassVar[str] = "limits_reply"
    SIZE: ClassVar[int] = 12
    LAYOUT: ClassVar[struct.Struct] = struct.Struct("<")
    ID: ClassVar[int] = 0xB0
    FIELDS: ClassVar[tuple[Field, ...]] = ()
    NESTED: ClassVar[str | None] = "limits"

    @classmethod
    def unpack(cls, payload: bytes) -> Self:
        cls._numbers(payload)
        return cls(Limits.unpack(payload))


@dataclass(frozen=True, slots=True)
class SetLimits(Request):
    """Sets the angle limits. The remembered setpoint is clamped to them."""

    session: int
    """The open session."""
    limits: Limits

    NAME: ClassVar[str] = "set_limits"
    SIZE: ClassVar[int] = 14
    LAYOUT: ClassVar[struct.Struct] = struct.Struct("<H")
    ID: ClassVar[int] = 0x31
    REPLY_ID: ClassVar[int] = 0x70
    RETRY: ClassVar[Retry] = "once"
    NEEDS_SESSION: ClassVar[bool] = True
    ALLOWED_STATES: ClassVar[frozenset[State]] = frozenset(
        {
            State.DISARMED,
            State.FAULT,
            State.STOPPED,
        }
    )
    FIELDS: ClassVar[tuple[Field, ...]] = (Field("session", "H", 0, 65535),)
    NESTED: ClassVar[str | None] = "limits"

    @classmethod
    def unpack(cls, payload: bytes) -> Self:
        values = cls._numbers(payload)
        return cls(
            values[0],
            Limits.unpack(payload[2:]),
        )


@dataclass(frozen=True, slots=True)
class GetSlew(Request):
    """Reads the slew limits."""

    NAME: ClassVar[str] = "get_slew"
    SIZE: ClassVar[int] = 0
    LAYOUT: ClassVar[struct.Struct] = struct.Struct("<")
    ID: ClassVar[int] = 0x32
    REPLY_ID: ClassVar[int] = 0xB2
    RETRY: ClassVar[Retry] = "repeat"
    NEEDS_SESSION: ClassVar[bool] = False
    ALLOWED_STATES: ClassVar[frozenset[State]] = frozenset(State)
    FIELDS: ClassVar[tuple[Field, ...]] = ()

    @classmethod
    def unpack(cls, payload: bytes) -> Self:
        cls._numbers(payload)
        return cls()


@dataclass(frozen=True, slots=True)
class SlewReply(Message):
    """The slew limits in use."""

    slew: Slew

    NAME: ClassVar[str] = "slew_reply"
    SIZE: ClassVar[int] = 4
    LAYOUT: ClassVar[struct.Struct] = struct.Struct("<")
    ID: ClassVar[int] = 0xB2
    FIELDS: ClassVar[tuple[Field, ...]] = ()
    NESTED: ClassVar[str | None] = "slew"

    @classmethod
    def unpack(cls, payload: bytes) -> Self:
        cls._numbers(payload)
        return cls(Slew.unpack(payload))


@dataclass(frozen=True, slots=True)
class SetSlew(Request):
    """Sets the slew limits."""

    session: int
    """The open session."""
    slew: Slew

    NAME: ClassVar[str] = "set_slew"
    SIZE: ClassVar[int] = 6
    LAYOUT: ClassVar[struct.Struct] = struct.Struct("<H")
    ID: ClassVar[int] = 0x33
    REPLY_ID: ClassVar[int] = 0x70
    RETRY: ClassVar[Retry] = "once"
    NEEDS_SESSION: ClassVar[bool] = True
    ALLOWED_STATES: ClassVar[frozenset[State]] = frozenset(
        {
            State.DISARMED,
            State.FAULT,
            State.STOPPED,
        }
    )
    FIELDS: ClassVar[tuple[Field, ...]] = (Field("session", "H", 0, 65535),)
    NESTED: ClassVar[str | None] = "slew"

    @classmethod
    def unpack(cls, payload: bytes) -> Self:
        values = cls._numbers(payload)
        return cls(
            values[0],
            Slew.unpack(payload[2:]),
        )


@dataclass(frozen=True, slots=True)
class GetWatchdog(Request):
    """Reads the link watchdog."""

    NAME: ClassVar[str] = "get_watchdog"
    SIZE: ClassVar[int] = 0
    LAYOUT: ClassVar[struct.Struct] = struct.Struct("<")
    ID: ClassVar[int] = 0x34
    REPLY_ID: ClassVar[int] = 0xB4
    RETRY: ClassVar[Retry] = "repeat"
    NEEDS_SESSION: ClassVar[bool] = False
    ALLOWED_STATES: ClassVar[frozenset[State]] = frozenset(State)
    FIELDS: ClassVar[tuple[Field, ...]] = ()

    @classmethod
    def unpack(cls, payload: bytes) -> Self:
        cls._numbers(payload)
        return cls()


@dataclass(frozen=True, slots=True)
class WatchdogReply(Message):
    """The link watchdog in use."""

    watchdog: Watchdog

    NAME: ClassVar[str] = "watchdog_reply"
    SIZE: ClassVar[int] = 6
    LAYOUT: ClassVar[struct.Struct] = struct.Struct("<")
    ID: ClassVar[int] = 0xB4
    FIELDS: ClassVar[tuple[Field, ...]] = ()
    NESTED: ClassVar[str | None] = "watchdog"

    @classmethod
    def unpack(cls, payload: bytes) -> Self:
        cls._numbers(payload)
        return cls(Watchdog.unpack(payload))


@dataclass(frozen=True, slots=True)
class SetWatchdog(Request):
    """Sets the link watchdog."""

    session: int
    """The open session."""
    watchdog: Watchdog

    NAME: ClassVar[str] = "set_watchdog"
    SIZE: ClassVar[int] = 8
    LAYOUT: ClassVar[struct.Struct] = struct.Struct("<H")
    ID: ClassVar[int] = 0x35
    REPLY_ID: ClassVar[int] = 0x70
    RETRY: ClassVar[Retry] = "once"
    NEEDS_SESSION: ClassVar[bool] = True
    ALLOWED_STATES: ClassVar[frozenset[State]] = frozenset(
        {
            State.DISARMED,
            State.FAULT,
            State.STOPPED,
        }
    )
    FIELDS: ClassVar[tuple[Field, ...]] = (Field("session", "H", 0, 65535),)
    NESTED: ClassVar[str | None] = "watchdog"

    @classmethod
    def unpack(cls, payload: bytes) -> Self:
        values = cls._numbers(payload)
        return cls(
            values[0],
            Watchdog.unpack(payload[2:]),
        )


@dataclass(frozen=True, slots=True)
class GetCalibration(Request):
    """Reads the pulse calibration."""

    NAME: ClassVar[str] = "get_calibration"
    SIZE: ClassVar[int] = 0
    LAYOUT: ClassVar[struct.Struct] = struct.Struct("<")
    ID: ClassVar[int] = 0x36
    REPLY_ID: ClassVar[int] = 0xB6
    RETRY: ClassVar[Retry] = "repeat"
    NEEDS_SESSION: ClassVar[bool] = False
    ALLOWED_STATES: ClassVar[frozenset[State]] = frozenset(State)
    FIELDS: ClassVar[tuple[Field, ...]] = ()

    @classmethod
    def unpack(cls, payload: bytes) -> Self:
        cls._numbers(payload)
        return cls()


@dataclass(frozen=True, slots=True)
class CalibrationReply(Message):
    """The pulse calibration in use."""

    calibration: Calibration

    NAME: ClassVar[str] = "calibration_reply"
    SIZE: ClassVar[int] = 16
    LAYOUT: ClassVar[struct.Struct] = struct.Struct("<")
    ID: ClassVar[int] = 0xB6
    FIELDS: ClassVar[tuple[Field, ...]] = ()
    NESTED: ClassVar[str | None] = "calibration"

    @classmethod
    def unpack(cls, payload: bytes) -> Self:
        cls._numbers(payload)
        return cls(Calibration.unpack(payload))


@dataclass(frozen=True, slots=True)
class SetCalibration(Request):
    """Sets the pulse calibration."""

    session: int
    """The open session."""
    calibration: Calibration

    NAME: ClassVar[str] = "set_calibration"
    SIZE: ClassVar[int] = 18
    LAYOUT: ClassVar[struct.Struct] = struct.Struct("<H")
    ID: ClassVar[int] = 0x37
    REPLY_ID: ClassVar[int] = 0x70
    RETRY: ClassVar[Retry] = "once"
    NEEDS_SESSION: ClassVar[bool] = True
    ALLOWED_STATES: ClassVar[frozenset[State]] = frozenset(
        {
            State.DISARMED,
            State.FAULT,
            State.STOPPED,
        }
    )
    FIELDS: ClassVar[tuple[Field, ...]] = (Field("session", "H", 0, 65535),)
    NESTED: ClassVar[str | None] = "calibration"

    @classmethod
    def unpack(cls, payload: bytes) -> Self:
        values = cls._numbers(payload)
        return cls(
            values[0],
            Calibration.unpack(payload[2:]),
        )


@dataclass(frozen=True, slots=True)
class SaveConfig(Request):
    """Starts to write the configuration in use to the older EEPROM slot, one byte a control tick.

    `ack` tells that it has begun; `eeprom_busy` in the state falls when it is done. Refused while
    the configuration is incomplete.
    """

    session: int
    """The open session."""

    NAME: ClassVar[str] = "save_config"
    SIZE: ClassVar[int] = 2
    LAYOUT: ClassVar[struct.Struct] = struct.Struct("<H")
    ID: ClassVar[int] = 0x38
    REPLY_ID: ClassVar[int] = 0x70
    RETRY: ClassVar[Retry] = "once"
    NEEDS_SESSION: ClassVar[bool] = True
    ALLOWED_STATES: ClassVar[frozenset[State]] = frozenset(
        {
            State.DISARMED,
            State.FAULT,
            State.STOPPED,
        }
    )
    FIELDS: ClassVar[tuple[Field, ...]] = (Field("session", "H", 0, 65535),)

    @classmethod
    def unpack(cls, payload: bytes) -> Self:
        values = cls._numbers(payload)
        return cls(values[0])


@dataclass(frozen=True, slots=True)
class GetEquipment(Request):
    """Reads the board's name and what is wired to it."""

    NAME: ClassVar[str] = "get_equipment"
    SIZE: ClassVar[int] = 0
    LAYOUT: ClassVar[struct.Struct] = struct.Struct("<")
    ID: ClassVar[int] = 0x3C
    REPLY_ID: ClassVar[int] = 0xBC
    RETRY: ClassVar[Retry] = "repeat"
    NEEDS_SESSION: ClassVar[bool] = False
    ALLOWED_STATES: ClassVar[frozenset[State]] = frozenset(State)
    FIELDS: ClassVar[tuple[Field, ...]] = ()

    @classmethod
    def unpack(cls, payload: bytes) -> Self:
        cls._numbers(payload)
        return cls()


@dataclass(frozen=True, slots=True)
class EquipmentReply(Message):
    """Name and equipment in use."""

    equipment: Equipment

    NAME: ClassVar[str] = "equipment_reply"
    SIZE: ClassVar[int] = 19
    LAYOUT: ClassVar[struct.Struct] = struct.Struct("<")
    ID: ClassVar[int] = 0xBC
    FIELDS: ClassVar[tuple[Field, ...]] = ()
    NESTED: ClassVar[str | None] = "equipment"

    @classmethod
    def unpack(cls, payload: bytes) -> Self:
        cls._numbers(payload)
        return cls(Equipment.unpack(payload))


@dataclass(frozen=True, slots=True)
class SetEquipment(Request):
    """Sets the board's name and what is wired to it."""

    session: int
    """The open session."""
    equipment: Equipment

    NAME: ClassVar[str] = "set_equipment"
    SIZE: ClassVar[int] = 21
    LAYOUT: ClassVar[struct.Struct] = struct.Struct("<H")
    ID: ClassVar[int] = 0x3D
    REPLY_ID: ClassVar[int] = 0x70
    RETRY: ClassVar[Retry] = "once"
    NEEDS_SESSION: ClassVar[bool] = True
    ALLOWED_STATES: ClassVar[frozenset[State]] = frozenset(
        {
            State.DISARMED,
            State.FAULT,
            State.STOPPED,
        }
    )
    FIELDS: ClassVar[tuple[Field, ...]] = (Field("session", "H", 0, 65535),)
    NESTED: ClassVar[str | None] = "equipment"

    @classmethod
    def unpack(cls, payload: bytes) -> Self:
        values = cls._numbers(payload)
        return cls(
            values[0],
            Equipment.unpack(payload[2:]),
        )


@dataclass(frozen=True, slots=True)
class GetAcceleration(Request):
    """Reads the acceleration limits."""

    NAME: ClassVar[str] = "get_acceleration"
    SIZE: ClassVar[int] = 0
    LAYOUT: ClassVar[struct.Struct] = struct.Struct("<")
    ID: ClassVar[int] = 0x3E
    REPLY_ID: ClassVar[int] = 0xBE
    RETRY: ClassVar[Retry] = "repeat"
    NEEDS_SESSION: ClassVar[bool] = False
    ALLOWED_STATES: ClassVar[frozenset[State]] = frozenset(State)
    FIELDS: ClassVar[tuple[Field, ...]] = ()

    @classmethod
    def unpack(cls, payload: bytes) -> Self:
        cls._numbers(payload)
        return cls()


@dataclass(frozen=True, slots=True)
class AccelerationReply(Message):
    """The acceleration limits in use."""

    acceleration: Acceleration

    NAME: ClassVar[str] = "acceleration_reply"
    SIZE: ClassVar[int] = 4
    LAYOUT: ClassVar[struct.Struct] = struct.Struct("<")
    ID: ClassVar[int] = 0xBE
    FIELDS: ClassVar[tuple[Field, ...]] = ()
    NESTED: ClassVar[str | None] = "acceleration"

    @classmethod
    def unpack(cls, payload: bytes) -> Self:
        cls._numbers(payload)
        return cls(Acceleration.unpack(payload))


@dataclass(frozen=True, slots=True)
class SetAcceleration(Request):
    """Sets the acceleration limits."""

    session: int
    """The open session."""
    acceleration: Acceleration

    NAME: ClassVar[str] = "set_acceleration"
    SIZE: ClassVar[int] = 6
    LAYOUT: ClassVar[struct.Struct] = struct.Struct("<H")
    ID: ClassVar[int] = 0x3F
    REPLY_ID: ClassVar[int] = 0x70
    RETRY: ClassVar[Retry] = "once"
    NEEDS_SESSION: ClassVar[bool] = True
    ALLOWED_STATES: ClassVar[frozenset[State]] = frozenset(
        {
            State.DISARMED,
            State.FAULT,
            State.STOPPED,
        }
    )
    FIELDS: ClassVar[tuple[Field, ...]] = (Field("session", "H", 0, 65535),)
    NESTED: ClassVar[str | None] = "acceleration"

    @classmethod
    def unpack(cls, payload: bytes) -> Self:
        values = cls._numbers(payload)
        return cls(
            values[0],
            Acceleration.unpack(payload[2:]),
        )


@dataclass(frozen=True, slots=True)
class Ack(Message):
    """Done, or begun."""

    request: int
    """Id of the request."""
    state: State
    """State after it."""

    NAME: ClassVar[str] = "ack"
    SIZE: ClassVar[int] = 2
    LAYOUT: ClassVar[struct.Struct] = struct.Struct("<BB")
    ID: ClassVar[int] = 0x70
    FIELDS: ClassVar[tuple[Field, ...]] = (
        Field("request", "B", 0, 255),
        Field("state", "B", 0, 255),
    )

    @classmethod
    def unpack(cls, payload: bytes) -> Self:
        values = cls._numbers(payload)
        return cls(
            values[0],
            cls._enumerator("state", State, values[1]),
        )


@dataclass(frozen=True, slots=True)
class Nack(Message):
    """Refused; nothing has changed."""

    request: int
    """Id of the request."""
    code: NackCode
    """Why."""
    detail: int
    """See the code."""

    NAME: ClassVar[str] = "nack"
    SIZE: ClassVar[int] = 3
    LAYOUT: ClassVar[struct.Struct] = struct.Struct("<BBB")
    ID: ClassVar[int] = 0x71
    FIELDS: ClassVar[tuple[Field, ...]] = (
        Field("request", "B", 0, 255),
        Field("code", "B", 0, 255),
        Field("detail", "B", 0, 255),
    )

    @classmethod
    def unpack(cls, payload: bytes) -> Self:
        values = cls._numbers(payload)
        return cls(
            values[0],
            cls._enumerator("code", NackCode, values[1]),
            values[2],
        )


@dataclass(frozen=True, slots=True)
class Telemetry(Message):
    """The state, unasked. Its sequence number counts reports, so that the host sees lost ones."""

    report: StateReport

    NAME: ClassVar[str] = "telemetry"
    SIZE: ClassVar[int] = 27
    LAYOUT: ClassVar[struct.Struct] = struct.Struct("<")
    ID: ClassVar[int] = 0xC1
    FIELDS: ClassVar[tuple[Field, ...]] = ()
    NESTED: ClassVar[str | None] = "report"

    @classmethod
    def unpack(cls, payload: bytes) -> Self:
        cls._numbers(payload)
        return cls(StateReport.unpack(payload))


MESSAGES: Final[Mapping[int, type[Message]]] = MappingProxyType(
    {
        0x01: Hello,
        0x81: HelloReply,
        0x02: OpenSession,
        0x82: SessionReply,
        0x03: ClockSync,
        0x83: ClockReply,
        0x07: GetState,
        0x87: StateReply,
        0x05: GetCounters,
        0x85: CountersReply,
        0x06: SetTelemetry,
        0x08: Blink,
        0x09: GetFaultRecord,
        0x89: FaultRecordReply,
        0x10: Arm,
        0x11: Disarm,
        0x12: Stop,
        0x13: ClearFault,
        0x20: SetTarget,
        0xA0: TargetReply,
        0x30: GetLimits,
        0xB0: LimitsReply,
        0x31: SetLimits,
        0x32: GetSlew,
        0xB2: SlewReply,
        0x33: SetSlew,
        0x34: GetWatchdog,
        0xB4: WatchdogReply,
        0x35: SetWatchdog,
        0x36: GetCalibration,
        0xB6: CalibrationReply,
        0x37: SetCalibration,
        0x38: SaveConfig,
        0x3C: GetEquipment,
        0xBC: EquipmentReply,
        0x3D: SetEquipment,
        0x3E: GetAcceleration,
        0xBE: AccelerationReply,
        0x3F: SetAcceleration,
        0x70: Ack,
        0x71: Nack,
        0xC1: Telemetry,
    }
)
"""By id."""

REQUESTS: Final[Mapping[int, type[Request]]] = MappingProxyType(
    {
        0x01: Hello,
        0x02: OpenSession,
        0x03: ClockSync,
        0x07: GetState,
        0x05: GetCounters,
        0x06: SetTelemetry,
        0x08: Blink,
        0x09: GetFaultRecord,
        0x10: Arm,
        0x11: Disarm,
        0x12: Stop,
        0x13: ClearFault,
        0x20: SetTarget,
        0x30: GetLimits,
        0x31: SetLimits,
        0x32: GetSlew,
        0x33: SetSlew,
        0x34: GetWatchdog,
        0x35: SetWatchdog,
        0x36: GetCalibration,
        0x37: SetCalibration,
        0x38: SaveConfig,
        0x3C: GetEquipment,
        0x3D: SetEquipment,
        0x3E: GetAcceleration,
        0x3F: SetAcceleration,
    }
)
"""By id."""

TRANSITIONS: Final[Mapping[tuple[State, Event], State]] = MappingProxyType(
    {
        (State.BOOT, Event.SELF_TEST_PASSED): State.DISARMED,
        (State.DISARMED, Event.ARM_REQUESTED): State.ARMING,
        (State.ARMING, Event.AXES_ENABLED): State.HOLD,
        (State.HOLD, Event.TARGET_ACCEPTED): State.ACTIVE,
        (State.ACTIVE, Event.TARGET_ACCEPTED): State.ACTIVE,
        (State.RELAXING, Event.TARGET_ACCEPTED): State.ACTIVE,
        (State.ACTIVE, Event.TARGET_EXPIRED): State.HOLD,
        (State.HOLD, Event.HOLD_EXPIRED): State.RELAXING,
        (State.RELAXING, Event.REST_REACHED): State.FAULT,
        (State.ARMING, Event.DISARM_REQUESTED): State.DISARMING,
        (State.ACTIVE, Event.DISARM_REQUESTED): State.DISARMING,
        (State.HOLD, Event.DISARM_REQUESTED): State.DISARMING,
        (State.RELAXING, Event.DISARM_REQUESTED): State.DISARMING,
        (State.DISARMING, Event.REST_REACHED): State.DISARMED,
        (State.BOOT, Event.FAULT_RAISED): State.FAULT,
        (State.DISARMED, Event.FAULT_RAISED): State.FAULT,
        (State.ARMING, Event.FAULT_RAISED): State.FAULT,
        (State.ACTIVE, Event.FAULT_RAISED): State.FAULT,
        (State.HOLD, Event.FAULT_RAISED): State.FAULT,
        (State.RELAXING, Event.FAULT_RAISED): State.FAULT,
        (State.DISARMING, Event.FAULT_RAISED): State.FAULT,
        (State.BOOT, Event.STOP_REQUESTED): State.STOPPED,
        (State.DISARMED, Event.STOP_REQUESTED): State.STOPPED,
        (State.ARMING, Event.STOP_REQUESTED): State.STOPPED,
        (State.ACTIVE, Event.STOP_REQUESTED): State.STOPPED,
        (State.HOLD, Event.STOP_REQUESTED): State.STOPPED,
        (State.RELAXING, Event.STOP_REQUESTED): State.STOPPED,
        (State.DISARMING, Event.STOP_REQUESTED): State.STOPPED,
        (State.FAULT, Event.STOP_REQUESTED): State.STOPPED,
        (State.FAULT, Event.CLEAR_REQUESTED): State.DISARMED,
        (State.STOPPED, Event.CLEAR_REQUESTED): State.DISARMED,
    }
)
"""What is not listed changes nothing."""

REQUIREMENTS: Final[Mapping[str, str]] = MappingProxyType(
    {
        "FRM-1": (
            "A frame with a bad CRC, a bad encoding, fewer than 4 bytes or more than max_payload + "
            "4 bytes decoded is counted and not answered, and changes nothing else."
        ),
        "FRM-2": (
            "After any bytes whatever followed by a zero, the next well-formed frame is understood."
        ),
        "FRM-3": "Zeros between frames are ignored and not counted.",
        "FRM-4": (
            "A frame that grows too long is dropped up to the next zero and counted once, as "
            "bad_size; of a frame with several faults the first of too long, bad encoding, too "
            "short, bad CRC is counted."
        ),
        "REQ-1": (
            "Each request with a good CRC is answered once, in the order of arrival, with its "
            "sequence number."
        ),
        "REQ-2": (
            "Checks come in the order: id, length, session, state, range, consistency, then what "
            "is particular to the request; the first that fails is reported and nothing changes."
        ),
        "REQ-3": (
            "A `once` request with the id, sequence number and payload of the last `once` request "
            "that was acknowledged, no more than retry_window_ticks ago, is answered with the same "
            "frame before any check and not executed again; the window counts from the execution. "
            "Where a `stop` has come between, it is neither executed nor acknowledged again: it "
            "gets bad_state."
        ),
        "REQ-4": "Ids that are not requests, replies among them, get unknown_id.",
        "REQ-5": (
            "Each request is answered of a host that has no more than outstanding_requests and "
            "outstanding_bytes unanswered. Where a host has sent more, answers may be dropped; "
            "from tick 0 on each request is obeyed all the same, `stop` among them, also on a line "
            "that never pauses, and one `stop` among other requests is answered."
        ),
        "SES-1": (
            "Without an open session, or with another one, whatever needs a session gets "
            "bad_session."
        ),
        "SES-2": (
            "open_session with another spec hash gets spec_mismatch and leaves the open session as "
            "it is."
        ),
        "SES-3": "A reset closes the session, ends the telemetry and counts up the boot id.",
        "TIM-1": (
            "Control tick k (k = 0, 1, ...) runs tick_phase_us + k * tick_us after the reset; the "
            "report then gives tick = k + 1."
        ),
        "TIM-2": (
            "Pulses computed at a tick are on the pins from the start of the next frame, (k + 1) * "
            "tick_us after the reset, and for the whole frame."
        ),
        "TIM-3": (
            "A duration of n ms takes N = ceil(n / 20) ticks. What begins in tick k, or between "
            "ticks k - 1 and k, has run out at tick k + N and not before."
        ),
        "TIM-4": (
            "In one tick, in this order: count it; make at most one transition that time or "
            "position has brought about; look at the emergency stop and the servo supply; move the "
            "setpoint as the state asks; compute the pulses; write one EEPROM byte, of the save or "
            "else of the fault log; set the servo supply and the LED; report."
        ),
        "TIM-5": (
            "From listens_after_us after the reset on the board takes requests, and answers them "
            "during `boot` too, at the latest 15 ms later."
        ),
        "ARM-1": (
            "After `arm` the pulses of axis 1 begin at the next tick, those of axis 2 arm_axis_ms "
            "later; from another arm_axis_ms later on the setpoint goes to rest at the lesser of "
            "relax slew and slew limit; the first tick that finds it at rest makes the state "
            "`hold`."
        ),
        "ARM-2": "`arm` and `save_config` with a missing configuration group get not_configured.",
        "ARM-3": (
            "The setpoint survives disarm, stop and fault, so that arming begins where the robot "
            "was left; after a reset it is the rest pose that was loaded, or 0 where none was."
        ),
        "ARM-4": "After a reset the board never arms by itself.",
        "TGT-1": (
            "A target outside the angle limits is clamped to them and reported as clamped. One "
            "whose pulse PUL-1 clamps is reported and counted as clamped too; its angle stays."
        ),
        "TGT-2": (
            "On a target with a ramp of n = ceil(ramp_ms / 20) > 0 ticks, the setpoint aims at "
            "start + (target - start) * j / n (the quotient rounded toward zero) at the j-th tick "
            "after it, then at the target; with n = 0 at the target at once."
        ),
        "TGT-3": "No tick moves the setpoint of an axis by more than its slew limit.",
        "ACC-1": (
            "With an acceleration a > 0 of an axis its step, the change of the setpoint in a tick, "
            "differs by no more than a from the step before. Without pulses the step is 0. In "
            "`hold` it goes to 0 by a a tick, and the setpoint stands still from then on."
        ),
        "ACC-2": (
            "With a > 0 the setpoint comes to rest at its goal without passing it, wherever it can "
            "brake before: of the steps towards the goal that slew, or relax slew, and ACC-1 "
            "allow, the tick makes the longest w with w + (w - a) + (w - 2a) + ... (terms above 0) "
            "no longer than the way left; where even the shortest is longer, the shortest. Where "
            "ACC-1 does not let it be as short as the relax slew, it is the shortest."
        ),
        "ACC-3": "With a > 0 the setpoint is at rest once it is there and its step is 0.",
        "TGT-4": "The latest accepted target replaces the one before it.",
        "PUL-1": (
            "pulse = neutral + round(setpoint * per_90_deg / 9000), halves away from zero, clamped "
            "to pulse_min and pulse_max and to pulse_floor and pulse_ceiling."
        ),
        "PUL-2": (
            "Pulses are only present in arming, active, hold, relaxing and disarming, and there "
            "only of axes that arming has enabled: disarming that interrupts arming enables no "
            "further one."
        ),
        "WDG-1": (
            "When the validity of a target has run out the state is `hold` and the setpoint stands "
            "still."
        ),
        "WDG-2": "Only an accepted set_target feeds the link watchdog.",
        "WDG-3": (
            "After relax_after_ms of `hold` the state is `relaxing` and the setpoint goes to rest "
            "at the lesser of relax slew and slew limit."
        ),
        "WDG-4": "A fresh target ends `hold` and `relaxing`.",
        "WDG-5": "At rest after `relaxing` the state is `fault` with link_loss, without pulses.",
        "WDG-6": (
            "The way to rest takes at most way_to_rest_ms: a configuration that could make it "
            "longer is refused."
        ),
        "STP-1": (
            "`stop` takes the pulses away at the next frame that a tick has prepared, from every "
            "state, with and without a session."
        ),
        "FLT-1": (
            "The first fault is kept until clear_fault; later ones do not replace it. One that is "
            "raised in `stopped` is recorded, the state stays."
        ),
        "FLT-2": "From `fault` and `stopped` only clear_fault leads on, to `disarmed`.",
        "FLT-3": (
            "A reset by the hardware watchdog or a brown-out ends `boot` in `fault` with that "
            "reason, and one of unknown cause that came while the last tick had commanded pulses "
            "with reset_while_armed, unless `stop` came before."
        ),
        "FLT-4": (
            "Until a tick has computed a frame without pulses clear_fault gets busy. So whatever "
            "is set or armed after a stop or a fault, between any two pulses of an axis that are "
            "further apart than its slew limit there is a whole frame without."
        ),
        "CFG-1": (
            "A configuration group is taken whole or not at all; one that was neither loaded nor "
            "set reads as zeros."
        ),
        "CFG-2": "A saved configuration is in use after a reset.",
        "CFG-3": "A reset in the middle of a save leaves the configuration saved before.",
        "CFG-4": (
            "With one corrupt slot the other one is loaded; with both the board is not configured "
            "and says so."
        ),
        "TEL-1": (
            "With period n the stream sends a report at every n-th tick after the request, its "
            "sequence number counting up from 0; open_session ends it."
        ),
        "EST-1": (
            "Where an emergency stop is fitted, each tick after `boot` that finds its input open "
            "raises emergency_stop. So no pulse begins more than 22 ms after it was opened; one "
            "that is closed again before a tick looks may go unnoticed. Where none is fitted the "
            "input means nothing."
        ),
        "EST-2": (
            "While the input of a fitted emergency stop is open clear_fault gets "
            "emergency_stop_open (after busy)."
        ),
        "SUP-1": (
            "The output that enables the servos' supply is on from the first tick in arming, "
            "active, hold, relaxing or disarming until the first in another state, and only then: "
            "a reset, fault, stop and the end of disarming switch it off."
        ),
        "SUP-2": (
            "With a divider wired the report gives the servo supply as supply_full_dv * a / 255 "
            "rounded, where a is the divider's output in 8 bits of 5 V, no older than a tick."
        ),
        "SUP-3": (
            "sag_ticks ticks in a row in a state with pulses that find the servo supply below "
            "supply_min_dv raise supply_low, the last of them. Without a divider wired none does."
        ),
        "LED-1": (
            "The LED shows the state in eight steps of led_step_ticks, over and over; in the tick "
            "that the report numbers n it is step n / led_step_ticks (rounded down) modulo 8. On: "
            "in `boot` and `active` in all steps, in `hold` in all but the last, in `arming` in 0, "
            "2, 4 and 6, in `relaxing` and `disarming` in 0, 1, 4 and 5, in `disarmed` in 0, in "
            "`stopped` in 0 and 2, in `fault` in 0, 2 and 4. It changes in ticks only."
        ),
        "LED-2": (
            "For the duration of `blink` the LED is on where n / blink_step_ticks (rounded down) "
            "is even, whatever the state."
        ),
        "LOG-1": (
            "Each fault that is latched, or recorded in `stopped`, is written once to the fault "
            "log, as fault_record number n at place n modulo fault_log_records, n one more than "
            "the newest record at its own place with a good check, 0 without one; one byte a tick "
            "from the tick that finds it on, while no save is being written."
        ),
        "LOG-2": (
            "The fault log survives a reset, whatever happens while a record is being written: "
            "that record alone is lost, and the one whose place it takes."
        ),
        "CFG-7": "A slot of layout 1 is loaded; its equipment and acceleration are zeros.",
        "CFG-8": (
            "The equipment is zeros, and not missing, on a board of which nothing was ever saved. "
            "Where no slot could be loaded and one is corrupt it is missing: the board may have an "
            "emergency stop, and is not armed before the host has told."
        ),
        "CFG-5": (
            "While a save is being written, arm, save_config and whatever sets a configuration "
            "group get busy (after not_configured)."
        ),
        "CFG-6": (
            "A save writes one byte in each tick and reads it back in the next; one tick after the "
            "last byte it is finished. A byte that does not read back raises eeprom_failed and "
            "ends it."
        ),
    }
)
"""Text by id; the conformance suite names the ids."""
