"""A sequence of poses at rest, to which registration and calibration are fitted."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from ccr_host.control.adaptive.misfit import REPEATED
from ccr_host.core.arrays import Array, BoolArray
from ccr_host.core.errors import CcrError, TrackerError
from ccr_host.robot.rests import Rests
from ccr_host.run.rig import Rig
from ccr_host.tracking.markers.check import MarkerCheck

OnPose = Callable[[int, int], None]
"""Called with the number of poses done and the total."""
OnRest = Callable[[int, Array], None]
"""Called at rest, with the stop's number and the markers of all exposures there,
(exposures, S + 1, 3)."""
Judge = Callable[[int, Rests], None]
"""Called after each pose with the number of poses done and the rests so far; what it raises ends
the tour."""

_SPEED_RAD_S = math.radians(25.0)
"""Average speed of the motors between poses; 120 mm/s at the tip, which excites little ringing."""
_COMMAND_PERIOD_US = 50_000
_VALIDITY_MS = 500
_SETTLE_US = 1_500_000
_AVERAGE_US = 1_500_000
_MIN_SAMPLES = 8
"""A pose with fewer samples is left out."""
_OUTLIER_MM = 3.0
_REST_MM = 0.5
"""The means of both halves of the samples agree to this if the robot is at rest."""
_ATTEMPTS_TO_REST = 4
_MOST_RESTLESS = 3
"""Poses in turn at which the robot does not come to rest: more than one that hangs on the brink of
another, which it may take half a minute to fall into."""
_ALIKE_POSES = 5
"""So many in one picture are of a tracker that repeats it."""


class RestError(CcrError):
    """The robot does not come to rest (exit status 3)."""


def visit(
    rig: Rig,
    check: MarkerCheck,
    stops_rad: Array,
    on_pose: OnPose,
    on_rest: OnRest = lambda *_: None,
    judge: Judge = lambda *_: None,
    are_rests: BoolArray | None = None,
) -> Rests:
    """Arm, measure at each stop, (K, n), return to the pose reached by arming, disarm.

    Stops at which a marker was not seen, or the robot does not come to rest, are left out; vectors
    are in the tracker's frame. If only some stops ``are_rests``, (K,), the robot passes the others,
    which do not count as poses.

    An error or Ctrl-C ends the tour where it is; the rig disarms the robot on its way out.

    Raises:
        DeviceError: the board refused, was lost or latched a fault.
        TrackerError: the markers are not those of the robot, swapped, or seen in one picture.
        RestError: the robot does not come to rest in several poses in turn.
    """
    rig.client.arm()
    start_rad = np.array(rig.client.accepted_rad)
    q_rad, no_q_rad = start_rad, np.empty((0, len(start_rad)))
    rests = Rests(no_q_rad, no_q_rad, np.empty((0, len(check.names), 3)), np.empty(0), np.empty(0))
    to_rest = np.ones(len(stops_rad), dtype=np.bool_) if are_rests is None else are_rests
    done, poses, restless = 0, int(np.count_nonzero(to_rest)), 0
    for stop_rad, is_rest in zip(stops_rad, to_rest, strict=True):
        on_pose(done, poses)
        from_rad, q_rad = q_rad, move_to(rig, q_rad, stop_rad)
        if not is_rest:
            continue
        try:
            seen_mm, restless = _measured_at_rest(rig, check, q_rad), 0
        except RestError:
            seen_mm, restless = None, restless + 1
            if restless == _MOST_RESTLESS:
                raise
        if seen_mm is not None:
            on_rest(done, seen_mm)
            here = stop_rad[None], seen_mm.mean(axis=0)[None], np.array([float(len(seen_mm))])
            time_s = np.array([rig.clock.now_us() * 1e-6])
            rests = rests.then(Rests(from_rad[None], *here, time_s))
            if len(rests.count) >= _ALIKE_POSES and rests.last(_ALIKE_POSES).are_one_picture():
                raise TrackerError(*REPEATED)
        check.robot_moves()
        done += 1
        judge(done, rests)
    move_to(rig, q_rad, start_rad)
    rig.client.disarm()
    on_pose(poses, poses)
    return rests


def move_to(rig: Rig, start_rad: Array, target_rad: Array) -> Array:
    """Lead an armed robot smoothly from one pose to another, (n,) each; return the last command.

    Raises:
        DeviceError: the board was lost or latched a fault.
    """
    duration_s = float(np.max(np.abs(target_rad - start_rad))) / _SPEED_RAD_S
    steps = max(1, math.ceil(duration_s * 1e6 / _COMMAND_PERIOD_US))
    q_rad = start_rad
    for step in range(1, steps + 1):
        # Starts and ends without a jerk.
        share = 0.5 - 0.5 * math.cos(math.pi * step / steps)
        q_rad = start_rad + share * (target_rad - start_rad)
        command(rig, q_rad)
    return q_rad


def command(rig: Rig, q_rad: Array) -> None:
    """Send a pose, (n,), and wait for the period in which the board leads the servos there.

    Raises:
        DeviceError: the board was lost or latched a fault.
    """
    ramp_ms = _COMMAND_PERIOD_US // 1000
    rig.client.set_target(q_rad, ramp_ms=ramp_ms, validity_ms=_VALIDITY_MS)
    rig.clock.sleep_until_us(rig.clock.now_us() + _COMMAND_PERIOD_US)


def _measured_at_rest(rig: Rig, check: MarkerCheck, q_rad: Array) -> Array | None:
    """Wait for rest; return the markers of all exposures, None if they are not seen.

    Their shape is (exposures, S + 1, 3).

    Raises:
        RestError: the robot does not come to rest.
    """
    _listen(rig, check, q_rad, _SETTLE_US)
    for _ in range(_ATTEMPTS_TO_REST):
        samples_mm = _listen(rig, check, q_rad, _AVERAGE_US)
        if len(samples_mm) < _MIN_SAMPLES:
            return None
        markers = _without_outliers(np.array(samples_mm))
        if _is_at_rest(markers):
            return markers
    raise RestError(
        "the robot does not come to rest",
        "keep hands and draughts off the robot; check that the servos do not hunt",
    )


def _listen(rig: Rig, check: MarkerCheck, q_rad: Array, duration_us: int) -> list[Array]:
    """Hold a pose for a while; return the markers of each exposure meanwhile that shows all."""
    start_us = rig.clock.now_us()
    seen_mm: dict[int, Array] = {}
    while rig.clock.now_us() < start_us + duration_us:
        command(rig, q_rad)
        sample = rig.tracker.newest()
        if sample is None or sample.exposed_us < start_us or sample.exposed_us in seen_mm:
            continue
        if check.accepts(sample) and np.isfinite(sample.markers_mm).all():
            seen_mm[sample.exposed_us] = sample.markers_mm
    return list(seen_mm.values())


def _without_outliers(markers_mm: Array) -> Array:
    """The exposures whose markers are all near the median, (exposures, S + 1, 3)."""
    distances = np.linalg.norm(markers_mm - np.median(markers_mm, axis=0), axis=2)
    kept: Array = markers_mm[np.all(distances < _OUTLIER_MM, axis=1)]
    return kept if len(kept) >= _MIN_SAMPLES else markers_mm


def _is_at_rest(markers_mm: Array) -> bool:
    half = len(markers_mm) // 2
    drift = markers_mm[:half].mean(axis=0) - markers_mm[half:].mean(axis=0)
    return bool(np.all(np.linalg.norm(drift, axis=1) < _REST_MM))
