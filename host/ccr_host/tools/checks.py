"""Checks of the board, the link, and the tracker's measurements of the robot at rest."""

from __future__ import annotations

import enum
from collections.abc import Iterable, Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ccr_host.control.adaptive.motion import predicted_mm
from ccr_host.control.adaptive.parameters import COUNT, Scaling
from ccr_host.core.clock import Clock
from ccr_host.core.errors import CcrError, TrackerError
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
from ccr_host.robot.rests import Rests
from ccr_host.tools.equipment import equipment_text
from ccr_host.tracking.markers.check import MarkerCheck, seen_lengths_mm, wrong_segments
from ccr_host.tracking.tracker import Sample, Tracker

_FIRMWARE_CAPABILITIES = Capabilities.TIMED_TARGETS
"""Those that the newest firmware has on any board."""


class Severity(enum.IntEnum):
    """Severity of a finding."""

    GOOD = 0
    WARNING = 1
    """A run is possible, but less accurate or less safe than it could be."""
    FAILURE = 2
    """A run is not possible."""


@dataclass(frozen=True)
class Finding:
    """One line of the doctor's report."""

    subject: str
    """What was checked, in a word or two."""
    severity: Severity
    text: str
    remedy: str = ""
    exit_status: int = 0
    """Exit status for a failure, the same as that of a run that ends with this error."""

    def as_summary(self) -> dict[str, str]:
        """The finding as a JSON object."""
        return {
            "subject": self.subject,
            "severity": self.severity.name.lower(),
            "text": self.text,
            "remedy": self.remedy,
        }


def good(subject: str, text: str) -> Finding:
    """A finding that needs no action."""
    return Finding(subject, Severity.GOOD, text)


def warning(subject: str, text: str, remedy: str) -> Finding:
    """A finding that should be fixed, though a run is possible."""
    return Finding(subject, Severity.WARNING, text, remedy)


def failure(subject: str, error: CcrError) -> Finding:
    """A finding with which a run would fail."""
    return Finding(subject, Severity.FAILURE, error.cause, error.cure, error.exit_status)


def judged(subject: str, text: str, *, fine: bool, remedy: str) -> Finding:
    """A good finding if ``fine``, else a warning."""
    return good(subject, text) if fine else warning(subject, text, remedy)


def exit_status(findings: Iterable[Finding]) -> int:
    """0 if a run is possible, else the status of the first failure."""
    return next((f.exit_status for f in findings if f.severity is Severity.FAILURE), 0)


_WATCH_US = 3_000_000
_LOOK_US = 5_000
_RATE_SHARE = 0.9
_NOISE_FACTOR = 2.0
_TURN_RAD = np.radians(1.0)
"""Standard deviation of the rotation of an aligned or registered camera."""
_ZERO_RAD = np.radians(1.0)
"""Standard deviation of the zeros of calibrated servos."""
_SURPRISING = 2.0
"""Standard deviations off the expected direction from which it is reported."""
_PROBE = 1e-4


def check_tracker(tracker: Tracker, clock: Clock, description: Description) -> Iterator[Finding]:
    """Observe the robot at rest for a few seconds."""
    samples, ages_us = _listen(tracker, clock)
    if not samples:
        trouble = tracker.trouble()
        yield failure(
            "markers",
            TrackerError(
                f"{tracker.name} gives no sample" + (f": {trouble}" if trouble else ""),
                "check line of sight, measurement volume and markers; see ccr-host monitor",
            ),
        )
        return
    yield _rate(samples, description)
    yield _age(ages_us, description)
    tips_mm = np.array([sample.tip_mm for sample in samples])
    yield _noise(tips_mm, description)
    for number, name in enumerate(description.robot.markers[1:-1], start=1):
        yield _middle_marker(samples, number, name)
    yield from _shape(samples, description)
    trouble = tracker.trouble()
    yield judged(
        "tracker", trouble or f"{tracker.name} reports no error", fine=not trouble, remedy=trouble
    )


def _listen(tracker: Tracker, clock: Clock) -> tuple[list[Sample], list[int]]:
    end_us = clock.now_us() + _WATCH_US
    samples: list[Sample] = []
    ages_us: list[int] = []
    while clock.now_us() < end_us:
        sample = tracker.newest()
        if sample is not None and (not samples or sample.exposed_us != samples[-1].exposed_us):
            samples.append(sample)
            ages_us.append(clock.now_us() - sample.exposed_us)
        clock.sleep_until_us(clock.now_us() + _LOOK_US)
    return samples, ages_us


def _rate(samples: list[Sample], description: Description) -> Finding:
    rate_hz = len(samples) / (_WATCH_US * 1e-6)
    expected_hz = description.tracker.rate_hz
    return judged(
        "rate",
        f"{rate_hz:.1f} of {expected_hz:g} samples per second",
        fine=_RATE_SHARE * expected_hz <= rate_hz <= expected_hz / _RATE_SHARE,
        remedy="check for hidden markers and reflections, or correct tracker.rate_hz",
    )


def _age(ages_us: list[int], description: Description) -> Finding:
    limit_ms = description.control.stale_after_ms
    oldest_ms = max(ages_us) / 1000
    return judged(
        "age",
        f"samples arrive {np.median(ages_us) / 1000:.0f} ms after their exposure, "
        f"at most {oldest_ms:.0f} ms",
        fine=oldest_ms < limit_ms,
        remedy="check the connection; for a slow tracker increase control.stale_after_ms",
    )


def _noise(tips_mm: NDArray[np.float64], description: Description) -> Finding:
    noise_mm = float(np.sqrt(np.var(tips_mm, axis=0).sum()))
    expected_mm = description.tracker.noise_mm
    return judged(
        "noise",
        f"{noise_mm:.2f} mm RMS of {description.robot.markers[-1]} - M1 at rest; described: "
        f"{expected_mm:g}",
        fine=noise_mm <= _NOISE_FACTOR * max(expected_mm, 0.05),
        remedy="keep the table still, clean the markers, or correct tracker.noise_mm",
    )


def _middle_marker(samples: list[Sample], number: int, name: str) -> Finding:
    seen = np.mean([np.isfinite(sample.markers_mm[number]).all() for sample in samples])
    return judged(
        name,
        f"seen in {100 * seen:.0f} % of the samples",
        fine=bool(seen > _RATE_SHARE),
        remedy=f"turn the robot or the camera so that {name} is not hidden",
    )


def _shape(samples: list[Sample], description: Description) -> Iterator[Finding]:
    """Check the lengths of the segments and the orientation of the robot."""
    markers_mm = np.nanmedian([sample.markers_mm for sample in samples], axis=0)
    robot = description.robot
    if np.isfinite(markers_mm).all():
        lengths = " and ".join(f"{length:.1f}" for length in seen_lengths_mm(markers_mm, robot))
        described = " and ".join(f"{length:g}" for length in robot.segment_lengths_mm)
        trouble = MarkerCheck(description).trouble(markers_mm)
        yield judged(
            "scale",
            f"the segments measure {lengths} mm, straight; described: {described}",
            fine=not trouble and not wrong_segments(markers_mm, robot),
            remedy="; ".join(trouble)
            if trouble
            else "measure the segments again; check that each marker is the right one, "
            "the camera's calibration, and that the robot is at rest (ccr-host jog)",
        )
    if robot.segments:
        return  # The model of a robot that hangs through at rest knows only the paper's.
    off_deg, allowed_deg = _deflection_deg(markers_mm[-1] - markers_mm[0], description)
    yield judged(
        "orientation",
        f"the robot at rest points {off_deg:.0f} deg away from its model; expected: at most "
        f"{allowed_deg:.0f}",
        fine=off_deg < allowed_deg,
        remedy="ccr-host register measures the camera's orientation; check robot.* and servo.* "
        "with ccr-host calibrate, and robot.gravity_direction",
    )


def _deflection_deg(tip_mm: NDArray[np.float64], description: Description) -> tuple[float, float]:
    """Angle between measured and expected rest direction, and its largest expected value, deg."""
    scaling = Scaling(description.robot, _TURN_RAD, _ZERO_RAD)
    rest_rad = np.radians(description.servo.rest_deg)
    rests = Rests(rest_rad, rest_rad[None], np.full((1, 3, 3), np.nan), np.ones(1))
    near = scaling.perturbed(np.zeros(COUNT), _PROBE)
    *near_mm, expected_mm = predicted_mm(near, rests)[0, :, 1]
    slope = (np.array(near_mm) - expected_mm) / _PROBE
    length_mm = float(np.linalg.norm(expected_mm))
    aside = tip_mm / np.linalg.norm(tip_mm) - expected_mm / length_mm
    off_rad = 2.0 * float(np.arcsin(0.5 * np.linalg.norm(aside)))
    spread_mm = np.linalg.norm(slope @ (aside / max(float(np.linalg.norm(aside)), 1e-9)))
    return float(np.degrees(off_rad)), float(np.degrees(_SURPRISING * spread_mm / length_mm))


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
