"""Checks of the board and of the way to it."""

from __future__ import annotations

from collections.abc import Iterator

from ccr_host.core.clock import Clock
from ccr_host.description.schema import Description
from ccr_host.link.board_config import board_config, differences
from ccr_host.link.client import Client
from ccr_host.link.device_errors import BoardFaultError, BoardStoppedError, WrongBoardError
from ccr_host.link.messages import (
    TICK_US,
    CountersReply,
    EepromStatus,
    Fault,
    FaultRecord,
    HelloReply,
    ResetCause,
    State,
    StateReport,
)
from ccr_host.link.statistics import LinkStatistics
from ccr_host.tools.equipment import described
from ccr_host.tools.finding import Finding, failure, good, judged, warning

_TRIPS = 100
_LISTEN_US = 1_000_000
_SLOW_TRIP_US = 20_000
"""A USB port with its usual 16 ms latency timer stays below."""
_LEAST_STACK_BYTES = 128
_NOT_MEASURED = 0xFFFF
_ODD_RESETS = (ResetCause.BROWN_OUT, ResetCause.WATCHDOG)


def check_board(client: Client, clock: Clock, description: Description) -> Iterator[Finding]:
    """Ask, listen for a second, move nothing.

    Raises:
        DeviceError: the board does not answer any more.
    """
    identity = client.identity
    assert identity is not None, "connected"
    yield _identity(identity)
    yield from _equipment(client, description)
    yield _state(client.read_state())
    yield _eeprom(identity)
    yield good("last faults", _faults(client.read_fault_log(), identity.boot_id))
    yield _configuration(identity, differences(client.read_config(), board_config(description)))
    for _ in range(_TRIPS):
        client.read_state()
    clock.sleep_until_us(clock.now_us() + _LISTEN_US)
    yield _round_trips(client.statistics)
    yield _losses(client.statistics, client.read_counters())
    yield from _stack(client.read_state())


def _identity(identity: HelloReply) -> Finding:
    version = ".".join(str(part) for part in identity.firmware_version)
    cause = identity.reset_cause
    return judged(
        "board",
        f"firmware {version}, boot {identity.boot_id}, last reset: {cause.name.lower()}",
        fine=cause not in _ODD_RESETS,
        remedy="look at the supply (brown_out) or report a defect (watchdog)",
    )


def _equipment(client: Client, description: Description) -> Iterator[Finding]:
    equipment = client.read_equipment()
    yield good("equipment", described(equipment))
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
            "another host is at work, or left the robot armed",
        )
    return good("state", f"{state.name.lower()}, no pulses")


def _eeprom(identity: HelloReply) -> Finding:
    again = "run ccr-host calibrate again; replace the board if it comes back"
    match identity.eeprom_status:
        case EepromStatus.BLANK:
            return good("EEPROM", "no configuration kept; ccr-host calibrate keeps one")
        case EepromStatus.LOADED:
            return good("EEPROM", "configuration loaded")
        case EepromStatus.ONE_SLOT_BAD:
            return warning("EEPROM", "one of two copies is corrupt", again)
        case EepromStatus.BOTH_BAD:
            return warning("EEPROM", "the configuration is corrupt", again)


def _faults(records: list[FaultRecord], boot_id: int) -> str:
    """The newest first."""
    return "; ".join(_fault(record, boot_id) for record in records) or "none"


def _fault(record: FaultRecord, boot_id: int) -> str:
    fault = Fault(record.fault).name.lower() if record.fault in list(Fault) else record.fault
    state = State(record.state).name.lower() if record.state in list(State) else record.state
    boot = "this boot" if record.boot_id == boot_id else f"boot {record.boot_id}"
    return f"{fault} in {state}, {record.tick * TICK_US * 1e-6:.1f} s after the start of {boot}"


def _configuration(identity: HelloReply, differing: list[str]) -> Finding:
    """What a board has kept belongs to one robot; firmware's own values belong to none."""
    if not differing:
        return good("configuration", "as in the robot description")
    if identity.eeprom_status is EepromStatus.BLANK:
        return good("configuration", "the firmware's own; a run sets what is described")
    return warning(
        "configuration",
        f"the board holds other values than described: {'; '.join(differing)}",
        "check --robot and the board; a run sets what is described, ccr-host calibrate keeps it",
    )


def _round_trips(figures: LinkStatistics) -> Finding:
    median_us, p99_us = figures.rtt_us_median or 0.0, figures.rtt_us_p99 or 0.0
    return judged(
        "round trip",
        f"median {median_us / 1000:.1f} ms, 99 % below {p99_us / 1000:.1f} ms",
        fine=p99_us < _SLOW_TRIP_US,
        remedy="lower the latency timer of the USB port; use no hub",
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
        remedy="shorten the cable, keep it off the servos' wires, check the common ground",
    )


def _stack(report: StateReport) -> Iterator[Finding]:
    free_bytes = report.free_stack_bytes
    if free_bytes != _NOT_MEASURED:
        yield judged(
            "memory",
            f"at least {free_bytes} bytes of stack left",
            fine=free_bytes >= _LEAST_STACK_BYTES,
            remedy="report this as a defect of the firmware",
        )
