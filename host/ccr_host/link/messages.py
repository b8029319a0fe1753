"""Messages of the wire protocol. Generated from protocol/spec.toml: do not edit."""

from __future__ import annotations

from collections.abc import Mapping
from enum import IntEnum, IntFlag
from types import MappingProxyType
from typing import ClassVar, Final

from ccr_host.link import payload
from ccr_host.link.payload import AXES, BySize, Message, Payload, PayloadError, by_id, nested, wire

__all__ = ["Message", "Payload", "PayloadError"]  # re-exported; all else is public as it stands


PROTOCOL_VERSION: Final = 2
SPEC_HASH: Final = 0xF2E09CD6
FIRMWARE_VERSION: Final = (0, 2, 0)

BAUD: Final = 250000
BAUD_FALLBACK: Final = 115200
FRAME_DELIMITER: Final = 0
FRAME_OVERHEAD: Final = 4
MAX_AXES: Final = 12
MAX_PAYLOAD: Final = BySize(48, 98, 2)

TICK_US: Final = 20000
"""Period of the control tick and of the servo pulses. [us]"""
TICK_PHASE_US: Final = 18000
"""Time from the start of a pulse frame to its control tick. No pulse is longer than 2.5 ms, so at
the tick all pins are low and pulses can be switched on or off without cutting one short; the widths
that the tick computes take effect 2 ms later, at the start of the next frame. [us]"""
BOOT_TICKS: Final = 5
"""Duration of the self-test after a reset: control tick 5, the sixth, ends it. [tick]"""
RETRY_WINDOW_TICKS: Final = 50
"""A request repeated within this time is answered from memory instead of being executed again.
[tick]"""
WAY_TO_REST_MS: Final = 60000
"""Longest time to reach the rest pose with any configuration: 270 deg at the lowest slew and relax
slew allowed, plus 6 s to brake and accelerate at the lowest acceleration. [ms]"""
LISTENS_AFTER_US: Final = 2000
"""Time from a reset until the board accepts requests; anything received earlier is lost. [us]"""
OUTSTANDING_REQUESTS: Final = 5
"""Number of requests that a host may have sent without having received their replies (REQ-5),
unless the board announces another (`link_limits`): the longest replies to them and two reports fit
into send_bytes. [request]"""
OUTSTANDING_BYTES: Final = BySize(63, 127, 2)
"""Number of bytes that these requests may have in total, as encoded frames, unless the board
announces another: they fit into the receive buffer. [byte]"""
SEND_BYTES: Final = BySize(255, 1023, 2)
"""Size of the send buffer. A frame that does not fit is dropped and counted. All frames except the
reply to `stop` leave room for that reply. [byte]"""
SAG_TICKS: Final = 10
"""Number of consecutive ticks with too low a servo supply that raise the fault: longer than the
inrush of starting servos. [tick]"""
FAULT_LOG_ADDRESS: Final = 320
"""Address of the fault log in EEPROM (LOG-1). [byte]"""
FAULT_LOG_RECORDS: Final = 8
"""Number of faults kept in the log. [record]"""
LED_STEP_TICKS: Final = 8
"""Duration of each of the eight steps in which the LED shows the state (LED-1). [tick]"""
BLINK_STEP_TICKS: Final = 4
"""Half the period of the blinking on request (LED-2). [tick]"""
PULSE_FLOOR_HALF_US: Final = 1000
"""No pulse is ever shorter, whatever the calibration says. [0.5 us]"""
PULSE_CEILING_HALF_US: Final = 5000
"""No pulse is ever longer, whatever the calibration says. [0.5 us]"""

EEPROM_SIZE: Final = 1024
EEPROM_SLOT_A: Final = 0
EEPROM_SLOT_B: Final = BySize(128, 512, 2)
EEPROM_BOOT_COUNTER: Final = 256
EEPROM_BOOT_COUNTERS: Final = 32
EEPROM_MAGIC: Final = 0xCC52
EEPROM_LAYOUT: Final = 2


def eeprom_slot_size(axes: int) -> int:
    """Bytes of an EEPROM slot."""
    return 34 + 18 * axes


class State(IntEnum):
    """State of the board.

    Only `arming`, `active`, `hold`, `relaxing` and `disarming` put pulses on the pins.
    """

    BOOT = 0
    """Self-test after a reset. No pulses."""
    DISARMED = 1
    """Ready. No pulses."""
    ARMING = 2
    """Servos are enabled one after another at the last setpoint, then moved slowly to rest."""
    ACTIVE = 3
    """Follows targets."""
    HOLD = 4
    """Armed, but without a valid target: the setpoint does not move."""
    RELAXING = 5
    """The host has been silent: slow return to the rest pose. A new target ends it."""
    DISARMING = 6
    """The host asked to disarm: slow return to the rest pose, then no pulses."""
    FAULT = 7
    """Latched. No pulses. The first fault is kept until it is cleared."""
    STOPPED = 8
    """Emergency stop, latched. No pulses until it is cleared."""


class Event(IntEnum):
    """Cause of a change of state; never on the wire."""

    SELF_TEST_PASSED = 0
    """`boot_ticks` after a reset, without a fault."""
    ARM_REQUESTED = 1
    """`arm` accepted."""
    AXES_ENABLED = 2
    """All servos have pulses, and the setpoint is at rest."""
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
    """No target arrived during `hold` and `relaxing`; the robot is at rest."""
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
    """The board restarted while it generated pulses, and the boot loader has cleared the cause."""
    EMERGENCY_STOP = 9
    """The emergency-stop input is open: pressed, or its wire is broken."""
    SUPPLY_LOW = 10
    """The servos' supply was too low (SUP-3)."""


class ResetCause(IntEnum):
    """Why the board last started."""

    UNKNOWN = 0
    """The boot loader has cleared the cause."""
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
    """The payload does not have the length of this message."""
    BAD_SESSION = 3
    """The session is not the open one. Detail: 0."""
    BAD_STATE = 4
    """Not allowed in this state. Detail: the state."""
    OUT_OF_RANGE = 5
    """A field is out of its range. Detail: index of the field in the payload, from 0."""
    INCONSISTENT = 6
    """Each field is in range, but together they are contradictory. Detail: the axis."""
    SPEC_MISMATCH = 7
    """The host was built from another spec: it may only identify, read and stop."""
    NOT_CONFIGURED = 8
    """A configuration group was neither loaded from EEPROM nor set. Detail: the missing groups."""
    BUSY = 9
    """Repeat the request later. `arm`, `save_config` and requests that set a configuration group: a
    save is being written to EEPROM. `clear_fault`: no tick has switched off the pulses yet.
    `get_fault_record`: a byte is being written to EEPROM."""
    EMERGENCY_STOP_OPEN = 10
    """The emergency-stop input is open: close it before `clear_fault`."""


class EepromStatus(IntEnum):
    """What was found in EEPROM at boot."""

    BLANK = 0
    """Neither slot has ever been written."""
    LOADED = 1
    """The newest slot was good, or one was good and the other blank."""
    ONE_SLOT_BAD = 2
    """One slot is corrupt; the other was loaded."""
    BOTH_BAD = 3
    """Nothing could be loaded and at least one slot is corrupt: arming is refused until the host
    configures the board."""


class StatusFlags(IntFlag):
    """Details of the state."""

    AXIS_1_PULSES = 0x01
    """The last tick commanded a pulse for axis 1; `pulse_half_us` tells for all axes."""
    AXIS_2_PULSES = 0x02
    """The last tick commanded a pulse for axis 2, if there is one."""
    MOVING = 0x04
    """The setpoint has not reached its goal: the target in `active`, otherwise the rest pose."""
    CLAMPED = 0x08
    """The last accepted target was clamped to the angle limits, or its pulse to the pulse
    limits."""
    EEPROM_BUSY = 0x10
    """A save is being written."""
    CONFIGURED = 0x20
    """All configuration groups are present."""
    SESSION_OPEN = 0x40
    """A session is open."""
    UNSAVED = 0x80
    """A configuration group has been set since the last save or load."""


class Capabilities(IntFlag):
    """What this board can do."""

    EEPROM = 0x01
    """Stores its configuration."""
    HARDWARE_PULSES = 0x02
    """Pulses come from a timer, not from software."""
    STACK_MONITOR = 0x04
    """Reports the least free stack."""
    LINK_LIMITS = 0x08
    """What may be outstanding is not what the constants say: `get_link_limits` tells."""
    TIMED_TARGETS = 0x10
    """Knows `set_target_at`."""


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
    """`set_equipment`; missing only if no EEPROM slot could be loaded and one is corrupt"""


class Limits(Payload, name="limits"):
    """Angle limits and rest pose of each axis."""

    angle_min_cdeg: tuple[int, ...] = wire("h", -13500, 13500, "deg", 0.01, count=AXES)
    """Lower limit of the servo angle."""
    angle_max_cdeg: tuple[int, ...] = wire("h", -13500, 13500, "deg", 0.01, count=AXES)
    """Upper limit of the servo angle."""
    rest_cdeg: tuple[int, ...] = wire("h", -13500, 13500, "deg", 0.01, count=AXES)
    """Pose to which the robot moves when it is armed, relaxed or disarmed."""

    def inconsistent_axis(self) -> int | None:
        for axis in range(len(self.angle_min_cdeg)):
            consistent = (
                self.angle_min_cdeg[axis] < self.angle_max_cdeg[axis]
                and self.angle_min_cdeg[axis] <= self.rest_cdeg[axis]
                and self.rest_cdeg[axis] <= self.angle_max_cdeg[axis]
            )
            if not consistent:
                return axis
        return None


class Slew(Payload, name="slew"):
    """Limit of the setpoint's rate."""

    slew_cdeg_tick: tuple[int, ...] = wire("H", 10, 2000, "deg/tick", 0.01, count=AXES)
    """Largest change of the setpoint in one 20 ms tick. The lowest value bounds the time to reach
    rest (WDG-6)."""


class Acceleration(Payload, name="acceleration"):
    """Limit of the setpoint's acceleration. The default, zeros, sets no limit."""

    acceleration_cdeg_tick2: tuple[int, ...] = wire("H", 0, 2000, "deg/tick^2", 0.01, count=AXES)
    """Largest change of the setpoint's step from one tick to the next; 0: no limit."""


class Watchdog(Payload, name="watchdog"):
    """Staged reaction to a silent host. It cannot be switched off."""

    relax_after_ms: int = wire("H", 20, 60000, "ms")
    """Duration of `hold` before `relaxing`."""
    relax_slew_cdeg_tick: int = wire("H", 10, 500, "deg/tick", 0.01)
    """Rate of the slow return to rest, also while arming and disarming. The lower of this and the
    slew limit applies."""
    arm_axis_ms: int = wire("H", 20, 5000, "ms")
    """Pause after enabling each servo."""


class Calibration(Payload, name="calibration"):
    """Payload of `calibration`.

    From angle to pulse: pulse = neutral + round(angle_cdeg * per_90_deg / 9000), halves away from
    zero, then clamped to min and max.
    """

    neutral_half_us: tuple[int, ...] = wire("H", 1000, 5000, "us", 0.5, count=AXES)
    """Pulse at 0 deg."""
    per_90_deg_half_us: tuple[int, ...] = wire("h", -4000, 4000, "us", 0.5, count=AXES)
    """Change of the pulse for +90 deg; negative where the servo turns the other way."""
    pulse_min_half_us: tuple[int, ...] = wire("H", 1000, 5000, "us", 0.5, count=AXES)
    """Shortest pulse for this servo."""
    pulse_max_half_us: tuple[int, ...] = wire("H", 1000, 5000, "us", 0.5, count=AXES)
    """Longest pulse for this servo."""

    def inconsistent_axis(self) -> int | None:
        for axis in range(len(self.neutral_half_us)):
            consistent = (
                self.pulse_min_half_us[axis] < self.pulse_max_half_us[axis]
                and self.pulse_min_half_us[axis] <= self.neutral_half_us[axis]
                and self.neutral_half_us[axis] <= self.pulse_max_half_us[axis]
                and self.per_90_deg_half_us[axis] not in range(-99, 100)
            )
            if not consistent:
                return axis
        return None


class Equipment(Payload, name="equipment"):
    """The board's name, and what is wired to it.

    It belongs to the board, not to a robot's description. Zeros: a board without a name to which
    only servos are wired.
    """

    board_name: tuple[int, ...] = wire("B", 0, 255, count=16)
    """ASCII, padded with zeros. The board stores any bytes; the host checks them."""
    emergency_stop: int = wire("B", 0, 1)
    """1: a switch is wired to the emergency-stop input, closed unless it is pressed."""
    supply_full_dv: int = wire("B", 0, 255, "V", 0.1)
    """Servo supply at which the divider outputs 5 V; 0: no divider is wired."""
    supply_min_dv: int = wire("B", 0, 255, "V", 0.1)
    """Lowest permitted servo supply; 0: no limit."""


class FaultRecord(Payload, name="fault_record"):
    """A fault as stored in EEPROM.

    The reader verifies `check`, which is wrong for a record that was never written, or not
    completely.
    """

    number: int = wire("H", 0, 65535)
    """Counts faults; 0 follows 0xFFFF."""
    fault: int = wire("B", 0, 255)
    """The fault."""
    state: int = wire("B", 0, 255)
    """State at the end of the previous tick."""
    boot_id: int = wire("H", 0, 65535)
    """As in `hello_reply`: the start during which it occurred."""
    tick: int = wire("I", 0, 4294967295, "tick")
    """Tick in which it was detected, numbered as in reports."""
    check: int = wire("I", 0, 4294967295)
    """CRC-32 (ISO-HDLC) of the preceding bytes."""


class StateReport(Payload, name="state_report"):
    """Payload of `state_report`.

    Tick, setpoint, pulses, supply and the flags `axis_1_pulses`, `axis_2_pulses` and `moving` are
    those of the last control tick; the rest is current.
    """

    tick: int = wire("I", 0, 4294967295, "tick")
    """Control ticks since the reset."""
    state: State = wire("B", 0, 255, of=State)
    """State."""
    fault: Fault = wire("B", 0, 255, of=Fault)
    """First fault since the last clear."""
    flags: StatusFlags = wire("B", 0, 255, of=StatusFlags)
    """Details."""
    target_sequence: int = wire("B", 0, 255)
    """Sequence number of the last accepted target; 0 before the first."""
    target_age_ms: int = wire("H", 0, 65535, "ms")
    """Time since the last accepted target in whole control ticks: 20 in the report of the first
    tick after it; 65535 before the first target, or if longer."""
    target_cdeg: tuple[int, ...] = wire("h", -32768, 32767, "deg", 0.01, count=AXES)
    """Last accepted target, after clamping; 0 before the first."""
    setpoint_cdeg: tuple[int, ...] = wire("h", -32768, 32767, "deg", 0.01, count=AXES)
    """Angle that ramp and slew limit have reached. Clamping by `set_limits` is reported from the
    next tick on."""
    pulse_half_us: tuple[int, ...] = wire("H", 0, 65535, "us", 0.5, count=AXES)
    """Pulses computed by the last tick, output from the start of the next frame; 0: no pulse."""
    link_errors: int = wire("H", 0, 65535)
    """bad_crc + bad_encoding + bad_size + overruns, wrapping."""
    free_stack_bytes: int = wire("H", 0, 65535, "byte")
    """Least free stack so far; 65535 if it is not measured."""
    supply_dv: int = wire("B", 0, 255, "V", 0.1)
    """Servo supply in the last tick; 0 without a divider."""


class Request(payload.Request):
    """A message to the board, and how the board treats it."""

    ALLOWED_STATES: ClassVar[frozenset[State]] = frozenset(State)


class SessionRequest(Request):
    """A request that the board takes from the host of the open session alone."""

    NEEDS_SESSION = True

    session: int = wire("H", 0, 65535)
    """The open session."""


class Hello(Request, name="hello", number=0x01, reply=0x81, retry="repeat"):
    """Asks for the identity of the board.

    The layout of `hello` and `hello_reply` is the same in all protocol versions.
    """

    protocol_version: int = wire("B", 0, 255)
    """Version the host speaks."""
    spec_hash: int = wire("I", 0, 4294967295)
    """Hash of the spec the host was built from."""


class HelloReply(Message, name="hello_reply", number=0x81):
    """Identity and limits of the board."""

    protocol_version: int = wire("B", 0, 255)
    """Version the board speaks."""
    spec_hash: int = wire("I", 0, 4294967295)
    """Hash of the spec the board was built from."""
    firmware_version: tuple[int, int, int] = wire("B", 0, 255, count=3)
    """Major, minor, patch."""
    boot_id: int = wire("H", 0, 65535)
    """Counts resets, so that the host notices a restart."""
    reset_cause: ResetCause = wire("B", 0, 255, of=ResetCause)
    """Why it last started."""
    eeprom_status: EepromStatus = wire("B", 0, 255, of=EepromStatus)
    """What was found in EEPROM."""
    capabilities: Capabilities = wire("H", 0, 65535, of=Capabilities)
    """What it can do."""
    axes: int = wire("B", 0, 255)
    """Number of servos, which is the length of fields with one element per axis."""
    max_payload: int = wire("B", 0, 255, "byte")
    """Longest payload it accepts."""
    tick_us: int = wire("H", 0, 65535, "us")
    """Period of the control tick."""


class OpenSession(Request, name="open_session", number=0x02, reply=0x82, retry="repeat"):
    """Payload of `open_session`.

    Opens a session and ends any other, so that requests of another host are refused from then on.
    The state does not change; the telemetry stream ends and the memory of answered requests is
    cleared.
    """

    ALLOWED_STATES = frozenset(State) - {State.BOOT}

    spec_hash: int = wire("I", 0, 4294967295)
    """Hash of the spec the host was built from; must be that of the board."""
    session: int = wire("H", 1, 65535)
    """Chosen at random by the host. Every request that changes something carries it, so that the
    board obeys neither noise nor a superseded host."""


class SessionReply(Message, name="session_reply", number=0x82):
    """The session is open."""

    session: int = wire("H", 0, 65535)
    """The open session."""
    boot_id: int = wire("H", 0, 65535)
    """As in `hello_reply`."""
    state: State = wire("B", 0, 255, of=State)
    """State."""


class ClockSync(Request, name="clock_sync", number=0x03, reply=0x83, retry="repeat"):
    """Reads the board's clock, to relate it to the host's."""

    host_time_us: int = wire("I", 0, 4294967295, "us")
    """Any value; returned in the reply."""


class ClockReply(Message, name="clock_reply", number=0x83):
    """The board's clock when the request was dispatched."""

    host_time_us: int = wire("I", 0, 4294967295, "us")
    """From the request."""
    board_time_us: int = wire("I", 0, 4294967295, "us")
    """Since the reset; wraps after 71.6 minutes."""


class GetState(Request, name="get_state", number=0x07, reply=0x87, retry="repeat"):
    """Reads the state once."""


class StateReply(Message, name="state_reply", number=0x87):
    """The state."""

    report: StateReport = nested(StateReport)


class GetCounters(Request, name="get_counters", number=0x05, reply=0x85, retry="repeat"):
    """Reads the counters, which start at 0 at a reset and wrap."""


class CountersReply(Message, name="counters_reply", number=0x85):
    """The counters since the reset."""

    frames_accepted: int = wire("I", 0, 4294967295)
    """Frames with a good CRC."""
    bad_crc: int = wire("H", 0, 65535)
    """Frames with a bad CRC. They are not answered."""
    bad_encoding: int = wire("H", 0, 65535)
    """Frames that are not COBS."""
    bad_size: int = wire("H", 0, 65535)
    """Frames that are too short or too long."""
    overruns: int = wire("H", 0, 65535)
    """Bytes lost because they were not read in time."""
    replies_dropped: int = wire("H", 0, 65535)
    """Frames that were not sent because the send buffer was full."""
    nacks: int = wire("H", 0, 65535)
    """Requests refused."""
    repeats_answered: int = wire("H", 0, 65535)
    """Requests answered from memory."""
    targets_accepted: int = wire("I", 0, 4294967295)
    """Accepted targets."""
    targets_clamped: int = wire("H", 0, 65535)
    """Accepted targets that had to be clamped."""
    holds: int = wire("H", 0, 65535)
    """Entries into `hold` from `active`."""
    relaxes: int = wire("H", 0, 65535)
    """Entries into `relaxing`."""
    saves: int = wire("H", 0, 65535)
    """Saves finished."""


class SetTelemetry(SessionRequest, name="set_telemetry", number=0x06, reply=0x70, retry="once"):
    """Starts or stops the stream of `telemetry`."""

    ALLOWED_STATES = frozenset(State) - {State.BOOT}

    period_ticks: int = wire("B", 0, 255, "tick")
    """Ticks per report; 0 stops the stream."""


class Blink(Request, name="blink", number=0x08, reply=0x70, retry="repeat"):
    """Makes the LED blink to identify one of several boards.

    Needs no session and changes nothing else.
    """

    duration_s: int = wire("B", 0, 60, "s")
    """Duration of the blinking from the next tick on; 0 stops it."""


class GetFaultRecord(Request, name="get_fault_record", number=0x09, reply=0x89, retry="repeat"):
    """Reads a record of the fault log.

    Refused with busy while a byte is being written to EEPROM.
    """

    place: int = wire("B", 0, 7)
    """Place of the record in EEPROM; the records' numbers tell which is the newest."""


class FaultRecordReply(Message, name="fault_record_reply", number=0x89):
    """The record as it is in EEPROM."""

    record: FaultRecord = nested(FaultRecord)


class GetLinkLimits(
    Request,
    name="get_link_limits",
    number=0x0A,
    capability=Capabilities.LINK_LIMITS,
    reply=0x8A,
    retry="repeat",
):
    """Asks how much a host may have outstanding.

    Until it knows, a host sends one request at a time.
    """


class LinkLimitsReply(
    Message, name="link_limits_reply", number=0x8A, capability=Capabilities.LINK_LIMITS
):
    """What a host may have outstanding, in place of the constants of the same names."""

    outstanding_requests: int = wire("B", 1, 255, "request")
    """Number of requests without a reply."""
    outstanding_bytes: int = wire("H", 0, 65535, "byte")
    """Their bytes in total, as encoded frames; a single request may be longer."""


class Arm(SessionRequest, name="arm", number=0x10, reply=0x70, retry="once"):
    """Enables the servos one after another.

    Refused while the configuration is incomplete or being saved.
    """

    ALLOWED_STATES = frozenset({State.DISARMED})


class Disarm(SessionRequest, name="disarm", number=0x11, reply=0x70, retry="once"):
    """Moves the robot slowly to rest, then switches off the pulses.

    No effect in `disarmed` and `disarming`.
    """

    ALLOWED_STATES = frozenset(State) - {State.BOOT, State.FAULT, State.STOPPED}


class Stop(Request, name="stop", number=0x12, reply=0x70, retry="repeat"):
    """Emergency stop: switches off the pulses at the next frame. Needs no session."""


class ClearFault(SessionRequest, name="clear_fault", number=0x13, reply=0x70, retry="once"):
    """Acknowledges a fault or a stop once the pulses are off.

    The board is then disarmed; it never arms by itself.
    """

    ALLOWED_STATES = frozenset({State.FAULT, State.STOPPED})


class SetTarget(SessionRequest, name="set_target", number=0x20, reply=0xA0, retry="never"):
    """New target of all axes, which replaces the previous one.

    No other message feeds the link watchdog.
    """

    ALLOWED_STATES = frozenset({State.ACTIVE, State.HOLD, State.RELAXING})

    target_cdeg: tuple[int, ...] = wire("h", -18000, 18000, "deg", 0.01, count=AXES)
    """Servo angles; clamped to the angle limits."""
    ramp_ms: int = wire("H", 0, 10000, "ms")
    """The setpoint moves there linearly in this time, or more slowly if the slew limit requires
    it."""
    validity_ms: int = wire("H", 20, 10000, "ms")
    """The board holds its pose if no other target follows within this time."""


class SetTargetAt(
    SessionRequest,
    name="set_target_at",
    number=0x21,
    capability=Capabilities.TIMED_TARGETS,
    reply=0x70,
    retry="never",
):
    """The fields of `set_target`, and the tick for which the target waits (TGT-5).

    Only the newest one waits; it feeds the link watchdog when it takes effect.
    """

    ALLOWED_STATES = frozenset({State.ACTIVE, State.HOLD, State.RELAXING})

    target_cdeg: tuple[int, ...] = wire("h", -18000, 18000, "deg", 0.01, count=AXES)
    """As in `set_target`."""
    ramp_ms: int = wire("H", 0, 10000, "ms")
    """As in `set_target`, from that tick on."""
    validity_ms: int = wire("H", 20, 10000, "ms")
    """As in `set_target`, from that tick on."""
    tick: int = wire("I", 0, 4294967295, "tick")
    """Tick at which it takes effect, numbered as in reports; refused with out_of_range unless it is
    ahead."""


class TargetReply(Message, name="target_reply", number=0xA0):
    """The target as accepted."""

    state: State = wire("B", 0, 255, of=State)
    """State."""
    flags: StatusFlags = wire("B", 0, 255, of=StatusFlags)
    """Details."""
    target_cdeg: tuple[int, ...] = wire("h", -32768, 32767, "deg", 0.01, count=AXES)
    """Accepted target, after clamping."""


class GetLimits(Request, name="get_limits", number=0x30, reply=0xB0, retry="repeat"):
    """Reads the angle limits."""


class LimitsReply(Message, name="limits_reply", number=0xB0):
    """The angle limits in use."""

    limits: Limits = nested(Limits)


class SetLimits(SessionRequest, name="set_limits", number=0x31, reply=0x70, retry="once"):
    """Sets the angle limits. The stored setpoint is clamped to them."""

    ALLOWED_STATES = frozenset({State.DISARMED, State.FAULT, State.STOPPED})

    limits: Limits = nested(Limits)


class GetSlew(Request, name="get_slew", number=0x32, reply=0xB2, retry="repeat"):
    """Reads the slew limits."""


class SlewReply(Message, name="slew_reply", number=0xB2):
    """The slew limits in use."""

    slew: Slew = nested(Slew)


class SetSlew(SessionRequest, name="set_slew", number=0x33, reply=0x70, retry="once"):
    """Sets the slew limits."""

    ALLOWED_STATES = frozenset({State.DISARMED, State.FAULT, State.STOPPED})

    slew: Slew = nested(Slew)


class GetWatchdog(Request, name="get_watchdog", number=0x34, reply=0xB4, retry="repeat"):
    """Reads the link watchdog."""


class WatchdogReply(Message, name="watchdog_reply", number=0xB4):
    """The link watchdog in use."""

    watchdog: Watchdog = nested(Watchdog)


class SetWatchdog(SessionRequest, name="set_watchdog", number=0x35, reply=0x70, retry="once"):
    """Sets the link watchdog."""

    ALLOWED_STATES = frozenset({State.DISARMED, State.FAULT, State.STOPPED})

    watchdog: Watchdog = nested(Watchdog)


class GetCalibration(Request, name="get_calibration", number=0x36, reply=0xB6, retry="repeat"):
    """Reads the pulse calibration."""


class CalibrationReply(Message, name="calibration_reply", number=0xB6):
    """The pulse calibration in use."""

    calibration: Calibration = nested(Calibration)


class SetCalibration(SessionRequest, name="set_calibration", number=0x37, reply=0x70, retry="once"):
    """Sets the pulse calibration."""

    ALLOWED_STATES = frozenset({State.DISARMED, State.FAULT, State.STOPPED})

    calibration: Calibration = nested(Calibration)


class SaveConfig(SessionRequest, name="save_config", number=0x38, reply=0x70, retry="once"):
    """Starts to write the configuration in use to the older EEPROM slot, one byte per control tick.

    `ack` means that writing has begun; `eeprom_busy` is cleared when it is done. Refused while the
    configuration is incomplete.
    """

    ALLOWED_STATES = frozenset({State.DISARMED, State.FAULT, State.STOPPED})


class GetEquipment(Request, name="get_equipment", number=0x3C, reply=0xBC, retry="repeat"):
    """Reads the board's name and what is wired to it."""


class EquipmentReply(Message, name="equipment_reply", number=0xBC):
    """Name and equipment in use."""

    equipment: Equipment = nested(Equipment)


class SetEquipment(SessionRequest, name="set_equipment", number=0x3D, reply=0x70, retry="once"):
    """Sets the board's name and what is wired to it."""

    ALLOWED_STATES = frozenset({State.DISARMED, State.FAULT, State.STOPPED})

    equipment: Equipment = nested(Equipment)


class GetAcceleration(Request, name="get_acceleration", number=0x3E, reply=0xBE, retry="repeat"):
    """Reads the acceleration limits."""


class AccelerationReply(Message, name="acceleration_reply", number=0xBE):
    """The acceleration limits in use."""

    acceleration: Acceleration = nested(Acceleration)


class SetAcceleration(
    SessionRequest, name="set_acceleration", number=0x3F, reply=0x70, retry="once"
):
    """Sets the acceleration limits."""

    ALLOWED_STATES = frozenset({State.DISARMED, State.FAULT, State.STOPPED})

    acceleration: Acceleration = nested(Acceleration)


class Ack(Message, name="ack", number=0x70):
    """The request was executed, or its execution has begun."""

    request: int = wire("B", 0, 255)
    """Id of the request."""
    state: State = wire("B", 0, 255, of=State)
    """State after the request."""


class Nack(Message, name="nack", number=0x71):
    """The request was refused; nothing has changed."""

    request: int = wire("B", 0, 255)
    """Id of the request."""
    code: NackCode = wire("B", 0, 255, of=NackCode)
    """Why."""
    detail: int = wire("B", 0, 255)
    """See the code."""


class Telemetry(Message, name="telemetry", number=0xC1):
    """The state, sent periodically.

    Its sequence number counts reports, so that the host can detect lost ones.
    """

    report: StateReport = nested(StateReport)


MESSAGES: Final[Mapping[int, type[Message]]] = by_id(globals(), Message)
REQUESTS: Final[Mapping[int, type[Request]]] = by_id(globals(), Request)

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
