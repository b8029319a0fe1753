"""Checks of what the tracker sees while the robot rests."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from ccr_host.control.adaptive.identification import Rests, Scaling, predicted_mm
from ccr_host.control.adaptive.parameters import COUNT
from ccr_host.core.clock import Clock
from ccr_host.core.errors import TrackerError
from ccr_host.description.schema import Description
from ccr_host.robot.marker_shape import seen_lengths_mm, wrong_segments
from ccr_host.tools.finding import Finding, failure, judged
from ccr_host.tracking.markers.check import MarkerCheck
from ccr_host.tracking.tracker import Sample, Tracker

_LISTEN_US = 3_000_000
_LOOK_US = 5_000
_RATE_SHARE = 0.9
_NOISE_FACTOR = 2.0
_TURN_RAD = np.radians(1.0)
"""A camera that is aligned, or was registered, is turned by no more."""
_ZERO_RAD = np.radians(1.0)
"""Servos that were calibrated are set to zero so well."""
_SURPRISING = 2.0
"""Standard deviations."""
_PROBE = 1e-4


def check_tracker(tracker: Tracker, clock: Clock, description: Description) -> Iterator[Finding]:
    """Watch the robot at rest for a few seconds."""
    samples, ages_us = _listen(tracker, clock)
    if not samples:
        told = tracker.trouble()
        yield failure(
            "markers",
            TrackerError(
                f"{tracker.name} gives no sample" + (f": {told}" if told else ""),
                "check line of sight, the camera's volume and the markers; see ccr-host monitor",
            ),
        )
        return
    yield _rate(samples, description)
    yield _age(ages_us, description)
    tips_mm = np.array([sample.tip_mm for sample in samples])
    yield _noise(tips_mm, description)
    yield _second_marker(samples)
    yield from _shape(samples, description)
    told = tracker.trouble()
    yield judged("tracker", told or f"{tracker.name} has no complaints", fine=not told, remedy=told)


def _listen(tracker: Tracker, clock: Clock) -> tuple[list[Sample], list[int]]:
    end_us = clock.now_us() + _LISTEN_US
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
    rate_hz = len(samples) / (_LISTEN_US * 1e-6)
    expected_hz = description.tracker.rate_hz
    return judged(
        "rate",
        f"{rate_hz:.1f} samples a second of {expected_hz:g}",
        fine=_RATE_SHARE * expected_hz <= rate_hz <= expected_hz / _RATE_SHARE,
        remedy="look for hidden markers and reflections, or correct tracker.rate_hz",
    )


def _age(ages_us: list[int], description: Description) -> Finding:
    limit_ms = description.control.stale_after_ms
    oldest_ms = max(ages_us) / 1000
    return judged(
        "age",
        f"samples arrive {np.median(ages_us) / 1000:.0f} ms after their exposure, "
        f"at most {oldest_ms:.0f} ms",
        fine=oldest_ms < limit_ms,
        remedy="check the connection; for a slow tracker raise control.stale_after_ms",
    )


def _noise(tips_mm: NDArray[np.float64], description: Description) -> Finding:
    noise_mm = float(np.sqrt(np.var(tips_mm, axis=0).sum()))
    expected_mm = description.tracker.noise_mm
    return judged(
        "noise",
        f"{noise_mm:.2f} mm RMS of M3 - M1 at rest; described: {expected_mm:g}",
        fine=noise_mm <= _NOISE_FACTOR * max(expected_mm, 0.05),
        remedy="keep the table still, clean the markers, or correct tracker.noise_mm",
    )


def _second_marker(samples: list[Sample]) -> Finding:
    seen = np.mean([np.isfinite(sample.markers_mm[1]).all() for sample in samples])
    return judged(
        "M2",
        f"seen in {100 * seen:.0f} % of the samples",
        fine=bool(seen > _RATE_SHARE),
        remedy="turn the robot or the camera so that M2 is not hidden",
    )


def _shape(samples: list[Sample], description: Description) -> Iterator[Finding]:
    """Lengths of the segments, and where the robot points to."""
    markers_mm = np.nanmedian([sample.markers_mm for sample in samples], axis=0)
    robot = description.robot
    if np.isfinite(markers_mm).all():
        lengths = " and ".join(f"{length:.1f}" for length in seen_lengths_mm(markers_mm, robot))
        described = " and ".join(f"{length:g}" for length in robot.segment_lengths_mm)
        told = MarkerCheck(description).trouble(markers_mm)
        yield judged(
            "scale",
            f"the segments measure {lengths} mm, straight; described: {described}",
            fine=not told and not wrong_segments(markers_mm, robot),
            remedy="; ".join(told)
            if told
            else "measure robot.segment_lengths_mm again; check that each marker is the right one, "
            "the camera's calibration, and that the robot is at rest (ccr-host jog)",
        )
    off_deg, allowed_deg = _askew_deg(markers_mm[2] - markers_mm[0], description)
    yield judged(
        "orientation",
        f"the robot at rest points {off_deg:.0f} deg away from where its model rests; expected: "
        f"at most {allowed_deg:.0f}",
        fine=off_deg < allowed_deg,
        remedy="ccr-host register finds out how the camera stands; check robot.* and servo.* with "
        "ccr-host calibrate, and that gravity pulls the robot away from its markers",
    )


def _askew_deg(tip_mm: NDArray[np.float64], description: Description) -> tuple[float, float]:
    """Angle to where the robot should rest, and how much of it would be no surprise."""
    scaling = Scaling(description.robot, _TURN_RAD, _ZERO_RAD)
    rest_rad = np.radians(description.servo.rest_deg)
    rests = Rests(rest_rad, rest_rad[None], np.full((1, 2, 3), np.nan), np.ones(1))
    near = scaling.perturbed(np.zeros(COUNT), _PROBE)
    *near_mm, expected_mm = predicted_mm(near, rests)[0, :, 1]
    slope = (np.array(near_mm) - expected_mm) / _PROBE
    length_mm = float(np.linalg.norm(expected_mm))
    aside = tip_mm / np.linalg.norm(tip_mm) - expected_mm / length_mm
    off_rad = 2.0 * float(np.arcsin(0.5 * np.linalg.norm(aside)))
    spread_mm = np.linalg.norm(slope @ (aside / max(float(np.linalg.norm(aside)), 1e-9)))
    return float(np.degrees(off_rad)), float(np.degrees(_SURPRISING * spread_mm / length_mm))
