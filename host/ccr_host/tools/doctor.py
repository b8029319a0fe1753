"""``ccr-host doctor``: check everything without moving or changing anything."""

from __future__ import annotations

import importlib.util
import shutil
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path

import numpy as np
from serial.tools import list_ports

from ccr_host.core.clock import Clock, RealClock, VirtualClock
from ccr_host.core.errors import CcrError
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
from ccr_host.link.transport import DeviceUri, parse_device_uri
from ccr_host.record.folder import versions
from ccr_host.robot.rests import identified_rests
from ccr_host.run.open_rig import mismatch_of, open_board
from ccr_host.run.options import RigOptions
from ccr_host.run.tracker_rig import TrackerRig
from ccr_host.tools.checks import (
    Finding,
    check_tracker,
    failure,
    good,
    judged,
    warning,
)
from ccr_host.tools.equipment import equipment_text
from ccr_host.tools.survey import trial_fit
from ccr_host.tracking.uri import TrackerKind, TrackerUri, parse_tracker_uri

EXTRAS = {
    "view": "viser",
    "export": "pyarrow",
    "sweep": "distributed",
    "fast": "numba",
    "igtl": "pyigtl",
    "aruco": "cv2",
    "gym": "gymnasium",
    "ros": "mcap_ros2",
    "firmware": "platformio",
}
"""One package of each extra, to see whether it is installed."""

_NAPS = 200
_NAP_US = 1000
_LATE_US = 5000
"""A quarter of the board's tick, and less than the jitter of a camera's latency."""
_LEAST_FREE_BYTES = 1_000_000_000


def check_host(clock: Clock, folder: Path) -> Iterator[Finding]:
    """Check versions, extras, disk space, and the wake-up latency of this process.

    ``folder`` is where runs are stored.
    """
    yield good("versions", ", ".join(f"{name} {value}" for name, value in versions().items()))
    yield _extras()
    free_bytes = shutil.disk_usage(folder).free
    yield judged(
        "disk",
        f"{free_bytes / 1e9:.1f} GB free for runs in {folder.resolve()}",
        fine=free_bytes > _LEAST_FREE_BYTES,
        remedy="free disk space, or start from another folder",
    )
    late_us = _lateness_us(clock)
    yield judged(
        "timing",
        f"this process wakes {np.median(late_us):.0f} us late, at most {late_us.max():.0f} us",
        fine=bool(late_us.max() < _LATE_US),
        remedy="close other busy programs; disable power saving",
    )


def _extras() -> Finding:
    there = [name for name, module in EXTRAS.items() if importlib.util.find_spec(module)]
    missing = [name for name in EXTRAS if name not in there]
    text = f"installed: {', '.join(there) or 'none'}"
    if missing:
        text += f'; for more: pip install "ccr-host[{",".join(missing)}]"'
    return good("extras", text)


def _lateness_us(clock: Clock) -> np.ndarray[tuple[int], np.dtype[np.float64]]:
    late = np.empty(_NAPS)
    for nap in range(_NAPS):
        due_us = clock.now_us() + _NAP_US
        clock.sleep_until_us(due_us)
        late[nap] = clock.now_us() - due_us
    return late


_BLINK_S = 20


def examine(options: RigOptions, folder: Path, *, blink: bool = False) -> Iterator[Finding]:
    """Check computer, description, board and tracker, yielding one finding after the other.

    A device that cannot be reached is a finding and does not stop the other checks. ``folder`` is
    where runs would be stored.
    """
    yield from check_host(RealClock(), folder)
    yield _ports()
    try:
        description = options.description()
        device, tracker = parse_device_uri(options.device), parse_tracker_uri(options.tracker)
    except CcrError as error:
        yield failure("description", error)
        return
    yield from _describe(description, tracker)
    yield from _or_failure("identification", lambda: _identified(description))
    if mismatch := mismatch_of(options):
        remedy = "give your own with --device and --tracker"
        yield warning("device and tracker", mismatch, remedy)
    yield from _or_failure("board", lambda: _board(device, description, options.seed, blink))
    yield from _or_failure("tracker", lambda: _tracker(tracker, description, options.seed))


def _ports() -> Finding:
    ports = [f"{port.device} ({port.description})" for port in list_ports.comports()]
    return good("serial ports", ", ".join(sorted(ports)) or "none")


def _describe(description: Description, tracker: TrackerUri) -> Iterator[Finding]:
    yield good("description", f"robot {description.name}")
    registration = description.registration
    if registration is not None:
        when = f" on {registration.date}" if registration.date else ""
        yield good("registration", f"the camera was registered{when}")
    elif tracker.kind is not TrackerKind.TWIN:
        yield warning(
            "registration",
            "none: the camera is assumed to be aligned with the robot",
            "ccr-host register, with your --device and --tracker",
        )


def _identified(description: Description) -> Iterator[Finding]:
    """Check that the model fits the identified rests; no finding if there are none."""
    rests = identified_rests(description)
    if rests is None:
        return
    fit = trial_fit(rests, description)
    yield judged(
        "identification",
        f"{len(rests.count)} rests identified; {fit.residual}",
        fine=fit.explains,
        remedy="measure robot.segment_lengths_mm and the radii again, check for loose or rubbing "
        "tendons, then ccr-host calibrate --identify",
    )


def _or_failure(subject: str, check: Callable[[], Iterable[Finding]]) -> Iterator[Finding]:
    """Yield the findings of a check, and as the last one the error that ends it, if any."""
    try:
        yield from check()
    except CcrError as error:
        yield failure(subject, error)


def _board(
    device: DeviceUri, description: Description, seed: int, blink: bool
) -> Iterator[Finding]:
    with open_board(device, description, seed) as (client, clock):
        if blink:
            client.blink(_BLINK_S)
            yield good("LED", f"blinks six times per second for {_BLINK_S} s")
        yield from check_board(client, clock, description)


def _tracker(uri: TrackerUri, description: Description, seed: int) -> Iterator[Finding]:
    eyes = TrackerRig(uri, description, np.random.SeedSequence(seed))
    clock: Clock = VirtualClock() if uri.in_process else RealClock()
    if eyes.scene is not None:
        clock.attach(eyes.scene)
    with eyes.running(clock):
        # Anonymous spheres are labelled without a rotation if none was registered.
        unregistered = description.registration is None
        straight_rad = np.zeros(description.robot.motors)
        tracker = eyes.tracker(clock, lambda: straight_rad, in_camera_frame=unregistered)
        eyes.wait_until_tracking(clock)
        yield from check_tracker(tracker, clock, description)


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
    faults = [_fault(record, identity.boot_id) for record in client.read_fault_log()]
    yield good("last faults", "; ".join(faults) or "none")
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
