"""Checks of the board and the link."""

from __future__ import annotations

from collections.abc import Iterator

from ccr_host.core.clock import Clock
from ccr_host.description.schema import Description
from ccr_host.link.board_config import board_config, differences
from ccr_host.link.client import Client
from ccr_host.link.device_errors import (
    BoardFaultError,
    BoardStoppedError,
    WrongBoardError,
    firmware_version,
)
from ccr_host.link.exchange import LinkStatistics
from ccr_host.link.messages import (
    TICK_US,
    Capabilities,
    CountersReply,
    EepromStatus,
    Fault,
    FaultRecord,
    HelloReply,
    ResetCause,
    State,
    StateReport,
)
from ccr_host.tools.checks import Finding, failure, good, judged, warning
from ccr_host.tools.equipment import equipment_text

_FIRMWARE_CAPABILITIES = Capabilities.TIMED_TARGETS
"""Those that the newest firmware has on any board."""

_TRIPS = 100
_LISTEN_US = 1_000_000
_SLOW_TRIP_US = 20_000
"""A USB port with the usual latency timer of 16 ms stays below this."""
_LEAST_STACK_BYTES = 128
_NOT_MEASURED = 0xFFFF
_ABNORMAL_RESETS = (ResetCause.BROWN_OUT, ResetCause.WATCHDOG)


def check_board(client: Client, clock: Clock, description: Description) -> Iterator[Finding]:
    """Query the board and listen for a second, without moving the robot.

    Raises:
        DeviceError: the board stops answering.
    """
    identity = client.identity
    assert identity is not None, "connected"
    yield _identity(identity)
    yield from _equipment(client, description)
    yield _state(client.read_state())
    yield _eeprom(identity)
    yield good("last faults", _faults(client.read_fault_log(), identity.boot_id))
    wanted = board_config(description).for_board(identity.axes)
    yield _configuration(identity, differences(client.read_config(), wanted))
    for _ in range(_TRIPS):
        client.read_state()
    clock.sleep_until_us(clock.now_us() + _LISTEN_US)
    yield _round_trips(client.statistics)
    yield _losses(client.statistics, client.read_counters())
    yield from _stack(client.read_state())


def _identity(identity: HelloReply) -> Finding:
    cause = identity.reset_cause
    lacking = ~identity.capabilities & _FIRMWARE_CAPABILITIES
    older = f" (older than this host, without {lacking.name}: ccr-host flash)" if lacking else ""
    version = firmware_version(identity) + older.lower()
    return judged(
        "board",
        f"firmware {version}, boot {identity.boot_id}, last reset: {cause.name.lower()}",
        fine=cause not in _ABNORMAL_RESETS,
        remedy="check the supply (brown_out), or report a defect (watchdog)",
    )


def _equipment(client: Client, description: Description) -> Iterator[Finding]:
    equipment = client.read_equipment()
    yield good("equipment", equipment_text(equipment))
    if equipment.supply_full_dv:
        supply_dv = client.read_state().supply_dv
        yield judged(
            "servo supply",
            f"{supply_dv / 10:g} V",
            fine=supply_dv >= equipment.supply_min_dv,
            remedy="switch it on before arming, unless the board itself does; check the divider",
        )
    try:
        client.require_name(description.robot.board_name)
    except WrongBoardError as error:
        yield failure("board's name", error)


def _state(report: StateReport) -> Finding:
    state = report.state
    if state is State.FAULT:
        return failure("state", BoardFaultError(report.fault))
    if state is State.STOPPED:
        return failure("state", BoardStoppedError())
    if any(report.pulse_half_us):
        return warning(
            "state",
            f"{state.name.lower()}, the servos get pulses",
            "another host is running, or left the robot armed",
        )
    return good("state", f"{state.name.lower()}, no pulses")


def _eeprom(identity: HelloReply) -> Finding:
    again = "run ccr-host calibrate again; replace the board if this recurs"
    match identity.eeprom_status:
        case EepromStatus.BLANK:
            return good("EEPROM", "no configuration saved; ccr-host calibrate saves one")
        case EepromStatus.LOADED:
            return good("EEPROM", "configuration loaded")
        case EepromStatus.ONE_SLOT_BAD:
            return warning("EEPROM", "one of two copies is corrupt", again)
        case EepromStatus.BOTH_BAD:
            return warning("EEPROM", "the configuration is corrupt", again)


def _faults(records: list[FaultRecord], boot_id: int) -> str:
    """The fault log in words, newest first."""
    return "; ".join(_fault(record, boot_id) for record in records) or "none"


def _fault(record: FaultRecord, boot_id: int) -> str:
    fault = Fault(record.fault).name.lower() if record.fault in list(Fault) else record.fault
    state = State(record.state).name.lower() if record.state in list(State) else record.state
    boot = "this boot" if record.boot_id == boot_id else f"boot {record.boot_id}"
    return f"{fault} in {state}, {record.tick * TICK_US * 1e-6:.1f} s after the start of {boot}"


def _configuration(identity: HelloReply, differing: list[str]) -> Finding:
    """Compare the board's configuration with the description; firmware defaults may differ."""
    if not differing:
        return good("configuration", "as in the robot description")
    if identity.eeprom_status is EepromStatus.BLANK:
        return good("configuration", "firmware defaults; a run sets the described values")
    return warning(
        "configuration",
        f"the board's values differ from the description: {'; '.join(differing)}",
        "check --robot and the board; a run sets the described values, ccr-host calibrate saves "
        "them",
    )


def _round_trips(figures: LinkStatistics) -> Finding:
    median_us, p99_us = figures.rtt_us_median or 0.0, figures.rtt_us_p99 or 0.0
    return judged(
        "round trip",
        f"median {median_us / 1000:.1f} ms, 99 % below {p99_us / 1000:.1f} ms",
        fine=p99_us < _SLOW_TRIP_US,
        remedy="reduce the latency timer of the USB port; avoid hubs",
    )


def _losses(figures: LinkStatistics, counters: CountersReply) -> Finding:
    lost = {
        "damaged frames": figures.crc_errors,
        "repeated requests": figures.retries,
        "lost reports": figures.lost_telemetry,
        "bytes lost on the board": counters.overruns,
        "frames not sent by the board": counters.replies_dropped,
    }
    seen = [f"{count} {what}" for what, count in lost.items() if count]
    reports = _LISTEN_US // TICK_US
    return judged(
        "link",
        ", ".join(seen) or f"nothing lost in {_TRIPS} requests and {reports} reports",
        fine=not seen,
        remedy="use a shorter cable, keep it away from the servo wires, check the common ground",
    )


def _stack(report: StateReport) -> Iterator[Finding]:
    free_bytes = report.free_stack_bytes
    if free_bytes != _NOT_MEASURED:
        yield judged(
            "memory",
            f"at least {free_bytes} bytes of stack free",
            fine=free_bytes >= _LEAST_STACK_BYTES,
            remedy="report this as a defect of the firmware",
        )
