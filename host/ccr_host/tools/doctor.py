"""``ccr-host doctor``: check everything without moving or changing anything."""

from __future__ import annotations

import importlib.util
import shutil
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path

import numpy as np
from serial.tools import list_ports

from ccr_host.control.adaptive.identification import identified_rests
from ccr_host.core.clock import Clock, RealClock, VirtualClock
from ccr_host.core.errors import CcrError
from ccr_host.description.schema import Description
from ccr_host.link.transport import DeviceUri, parse_device_uri
from ccr_host.record.folder import versions
from ccr_host.run.open_rig import mismatch_of, open_board
from ccr_host.run.options import RigOptions
from ccr_host.run.tracker_rig import TrackerRig
from ccr_host.tools.board_checks import check_board
from ccr_host.tools.checks import (
    Finding,
    check_tracker,
    failure,
    good,
    judged,
    warning,
)
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

    Args:
        clock: real-time clock.
        folder: folder in which runs are stored.
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

    A device that cannot be reached is a finding and does not stop the other checks.

    Args:
        options: description, device and tracker are used.
        folder: folder in which runs would be stored.
        blink: blink the board's LED, to tell it from other boards.
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
