"""Findings, and checks of the tracker's measurements of the robot at rest."""

from __future__ import annotations

import enum
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from ccr_host.control.adaptive.misfit import REPEATED
from ccr_host.control.adaptive.model import make_static_model
from ccr_host.control.adaptive.parameter_space import ParameterSpace
from ccr_host.core.arrays import Array
from ccr_host.core.clock import Clock
from ccr_host.core.errors import CcrError, TrackerError
from ccr_host.description.schema import Description, Robot
from ccr_host.robot.chain import PAPER_FRAME
from ccr_host.robot.kinematics import ConstantCurvature
from ccr_host.robot.rests import Rests
from ccr_host.tracking.markers.check import MarkerCheck, seen_lengths_mm, wrong_segments
from ccr_host.tracking.tracker import Sample, Tracker


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
_LOOSE_RAD = np.radians(3.0)
"""Standard deviation of the motor angles that take up the slack of another robot's tendons, which
lets all segments hang to the same side."""
_SURPRISING = 2.0
"""Standard deviations off the expected direction from which it is reported."""


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


def _noise(tips_mm: Array, description: Description) -> Finding:
    noise_mm = float(np.sqrt(np.var(tips_mm, axis=0).sum()))
    expected_mm = description.tracker.noise_mm
    if expected_mm > 0.0 and not np.ptp(tips_mm, axis=0).any():
        none = "no sample differs from another: the tracker repeats one picture, or rounds"
        return judged("noise", none, fine=False, remedy=REPEATED[1])
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
    off_deg, allowed_deg = _deflection_deg(markers_mm[-1] - markers_mm[0], description)
    yield judged(
        "orientation",
        f"the robot at rest points {off_deg:.0f} deg away from its model; expected: at most "
        f"{allowed_deg:.0f}",
        fine=off_deg < allowed_deg,
        remedy="ccr-host register measures the camera's orientation; check robot.* and servo.* "
        "with ccr-host calibrate, and robot.gravity_direction",
    )


def _deflection_deg(tip_mm: Array, description: Description) -> tuple[float, float]:
    """Angle between measured and expected rest direction, and its largest expected value, deg."""
    model, space = make_static_model(description, is_new=True)
    rest_rad = np.radians(description.servo.rest_deg)
    rests = Rests(
        rest_rad[None], rest_rad[None], np.full((1, 3, 3), np.nan), np.ones(1), np.ones(1)
    )
    markers_mm, slopes = model.predicted_and_slopes(space, np.zeros(space.count), rests)
    expected_mm, known = markers_mm[0, -1], _known(space, description.robot) / space.deviation
    slope = slopes[0, -1].T * known[:, None]
    length_mm = float(np.linalg.norm(expected_mm))
    aside = tip_mm / np.linalg.norm(tip_mm) - expected_mm / length_mm
    off_rad = 2.0 * float(np.arcsin(0.5 * np.linalg.norm(aside)))
    way = aside / max(float(np.linalg.norm(aside)), 1e-9)
    spread_mm = float(np.linalg.norm(slope @ way))
    if description.robot.segments:
        by_motor = ConstantCurvature(description.robot).jacobian_mm_rad(rest_rad)
        spread_mm = float(np.hypot(spread_mm, _LOOSE_RAD * np.abs(way @ by_motor).sum()))
    return float(np.degrees(off_rad)), float(np.degrees(_SURPRISING * spread_mm / length_mm))


def _known(space: ParameterSpace[Any], robot: Robot) -> Array:
    """Deviations of a robot after its setup.

    Tendons of other robots are just taut, which has no derivative, and gravity acts one way alone.
    """
    known = space.deviation.copy()
    up = np.abs(np.array(robot.gravity_direction) @ PAPER_FRAME)
    shares = dict(zip(("weight_x", "weight_y", "weight_z"), up, strict=True))
    known[space.roles.turns] = _TURN_RAD
    for number, name in enumerate(space.names):
        if robot.segments and name.startswith(("slack_", "zero_")):
            known[number] = 0.0
        elif name.startswith("zero_"):
            known[number] = _ZERO_RAD
        known[number] *= shares.get(name[:8], 1.0)
    return known
