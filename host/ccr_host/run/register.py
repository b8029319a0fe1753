"""``ccr-host register``: move the robot through safe poses and find out how the camera stands.

The rig's tracker must give markers in the camera's own frame: open it without a registration.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ccr_host.config import Description
from ccr_host.errors import TrackerError
from ccr_host.robot.workspace import MotorLimits
from ccr_host.run.rig import Rig
from ccr_host.tracking.registration import Registration, RegistrationError, RestPose, register
from ccr_host.tracking.sample import Sample

Array = NDArray[np.float64]

_SWING_DEG = 40.0
"""Of motor 1, inside the +-43 deg that the paper's paths need."""
_SIDEWAYS_DEG = 20.0
"""Of motor 2."""
_SHARE_OF_LIMITS = 0.6
"""Neither motor goes further than this share of the way to its limit."""
_SWINGS = (0.0, 0.5, 1.0, 0.5, 0.0, -0.5, -1.0, -0.5, 0.0)
"""Poses of motor 1, each from both sides so that friction cancels."""
_SIDES = (1.0, -1.0)

_SPEED_RAD_S = math.radians(25.0)
"""Average speed of the motors between poses; 120 mm/s at the tip, which excites little ringing."""
_COMMAND_PERIOD_US = 50_000
_VALIDITY_MS = 500
_SETTLE_US = 1_500_000
_AVERAGE_US = 1_500_000
_MIN_SAMPLES = 8
"""In one pose; with fewer it is left out."""
_OUTLIER_MM = 3.0
_REST_MM = 0.5
"""Both halves of the samples agree so well if the robot is at rest."""
_ATTEMPTS_TO_REST = 4

OnPose = Callable[[int, int], None]
"""Number of poses done, and of all."""


def safe_poses_rad(limits: MotorLimits) -> Array:
    """Motor angles to visit, (K, 2): small, symmetric about the middle of the limits or zero."""
    reach = _SHARE_OF_LIMITS * np.minimum(-limits.lower_rad, limits.upper_rad)
    swing, sideways = np.minimum(np.radians([_SWING_DEG, _SIDEWAYS_DEG]), np.maximum(reach, 0.0))
    return np.array(
        [(share * swing, 0.0) for share in _SWINGS] + [(0.0, share * sideways) for share in _SIDES]
    )


def register_robot(rig: Rig, description: Description, on_pose: OnPose) -> Registration:
    """Arm the robot, visit the poses, disarm, fit and judge.

    Raises:
        DeviceError: the board refused, was lost or latched a fault.
        TrackerError: no markers.
        RegistrationError: the poses give no rotation that could be trusted.
    """
    poses = collect_rest_poses(rig, description, on_pose)
    return register(poses, description.robot)


def collect_rest_poses(rig: Rig, description: Description, on_pose: OnPose) -> list[RestPose]:
    """Measure the robot at rest in each of the safe poses; those without markers are left out.

    Raises:
        DeviceError: the board refused, was lost or latched a fault.
        TrackerError: no markers in any pose.
        RegistrationError: the robot does not come to rest.
    """
    targets = safe_poses_rad(MotorLimits.of(description.servo))
    motion = _Motion(rig)
    rig.client.arm()
    motion.start()
    poses: list[RestPose] = []
    for done, target in enumerate(targets):
        on_pose(done, len(targets))
        motion.move_to(target)
        pose = motion.measure_at_rest()
        if pose is not None:
            poses.append(pose)
    motion.move_to(np.zeros(2))
    rig.client.disarm()
    on_pose(len(targets), len(targets))
    if not poses:
        raise TrackerError(
            f"no markers from {rig.tracker.name} in any pose",
            "check line of sight and the camera's volume; see ccr-host monitor",
        )
    return poses


@dataclass
class _Motion:
    """Moves slowly, keeps the board's watchdog fed, and listens to the tracker meanwhile."""

    rig: Rig

    def start(self) -> None:
        self._q_rad: Array = np.asarray(self.rig.client.accepted_rad, dtype=np.float64)

    def move_to(self, target_rad: Array) -> None:
        start_rad = self._q_rad
        duration_s = float(np.max(np.abs(target_rad - start_rad))) / _SPEED_RAD_S
        steps = max(1, math.ceil(duration_s * 1e6 / _COMMAND_PERIOD_US))
        for step in range(1, steps + 1):
            # Starts and ends without a jerk.
            share = 0.5 - 0.5 * math.cos(math.pi * step / steps)
            self._q_rad = start_rad + share * (target_rad - start_rad)
            self._command()

    def measure_at_rest(self) -> RestPose | None:
        """Wait for rest and average; None if the markers are not seen."""
        self._listen(_SETTLE_US)
        for _ in range(_ATTEMPTS_TO_REST):
            samples = self._listen(_AVERAGE_US)
            if len(samples) < _MIN_SAMPLES:
                return None
            markers = _without_outliers(np.array([sample.markers_mm for sample in samples]))
            if _is_at_rest(markers):
                return RestPose(self._q_rad, markers.mean(axis=0))
        raise RegistrationError(
            "the robot does not come to rest",
            "keep hands and draughts off the robot; check that the servos do not hunt",
        )

    def _listen(self, duration_us: int) -> list[Sample]:
        """Hold the pose for a while; return what was exposed meanwhile."""
        clock, tracker = self.rig.clock, self.rig.tracker
        start_us = clock.now_us()
        samples: dict[int, Sample] = {}
        while clock.now_us() < start_us + duration_us:
            self._command()
            sample = tracker.newest()
            if sample is not None and sample.exposed_us >= start_us and _is_complete(sample):
                samples[sample.exposed_us] = sample
        return list(samples.values())

    def _command(self) -> None:
        """Send the pose; the board leads the servos there over one period."""
        client, clock = self.rig.client, self.rig.clock
        ramp_ms = _COMMAND_PERIOD_US // 1000
        client.set_target(self._q_rad, ramp_ms=ramp_ms, validity_ms=_VALIDITY_MS)
        clock.sleep_until_us(clock.now_us() + _COMMAND_PERIOD_US)


def _is_complete(sample: Sample) -> bool:
    """Markers that are lost are NaN."""
    return bool(np.all(np.isfinite(sample.markers_mm)))


def _without_outliers(markers_mm: Array) -> Array:
    """Exposures whose markers are all near the median, (n, 3, 3)."""
    distances = np.linalg.norm(markers_mm - np.median(markers_mm, axis=0), axis=2)
    kept: Array = markers_mm[np.all(distances < _OUTLIER_MM, axis=1)]
    return kept if len(kept) >= _MIN_SAMPLES else markers_mm


def _is_at_rest(markers_mm: Array) -> bool:
    half = len(markers_mm) // 2
    drift = markers_mm[:half].mean(axis=0) - markers_mm[half:].mean(axis=0)
    return bool(np.all(np.linalg.norm(drift, axis=1) < _REST_MM))
