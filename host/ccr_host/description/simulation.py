"""The simulated sections of a robot description: the twin, its camera, faults of the camera."""

from __future__ import annotations

from typing import Annotated, TypeGuard

from pydantic import AfterValidator, BeforeValidator, Field, model_validator

from ccr_host.description.robot import MOST_MOTORS, Robot, Segment
from ccr_host.description.section import (
    FULL_TURN_DEG,
    LEAST_SPAN_US,
    EachSegment,
    PerMotor,
    PerSegment,
    PerTendon,
    PulleyRadius,
    Pulse,
    PulseSpan,
    Section,
    SegmentLength,
    TendonRadius,
    Turn,
    as_in,
    pair,
    within,
)

_Seconds = Annotated[float, within(0, 1e6)]
"""Time in the path's clock, s, up to eleven days."""
_Share = Annotated[float, within(0, 1)]
_Force = Annotated[float, within(-100, 100)]
_Flexures = Annotated[int, within(1, 40)]
_Slack = Annotated[float, within(0, 100)]
_CreepTime = Annotated[float, within(0.1, 1e5)]
_Offset = Annotated[float, within(-500, 500)]
GRAVITY_M_S2 = 9.81
_Acceleration = Annotated[float, within(-100, 100)]


def _is_number(value: object) -> TypeGuard[int | float]:
    return isinstance(value, int | float) and not isinstance(value, bool)


def _one_branch(value: object) -> object:
    """Expand one number to a share of the first branch alone."""
    return (value, 0.0) if _is_number(value) else value


def _along_z(value: object) -> object:
    """Expand one number to a vector along z of (10)."""
    return (0.0, 0.0, value) if _is_number(value) else value


def _downwards(value: object) -> object:
    """Expand one number to a vector along -z of (10)."""
    return (0.0, 0.0, -value) if _is_number(value) else value


class Push(Section):
    """A force on the tip during part of the run."""

    force_n: tuple[_Force, _Force, _Force]
    """Force along x, y, z of (10), at the centre of the last disk."""
    start_s: _Seconds
    """Start in the path's clock."""
    end_s: _Seconds
    """End in the path's clock."""

    @model_validator(mode="after")
    def _ends_after_its_start(self) -> Push:
        if not self.start_s < self.end_s:
            raise ValueError(
                f"twin.push.start_s = {self.start_s:g} is not before end_s = {self.end_s:g}"
            )
        return self


class Twin(Section):
    """The simulated robot; docs/twin.md explains how each default was chosen."""

    segments: tuple[Segment, ...] = Field(
        Robot().chain,
        json_schema_extra=as_in("robot.segments"),
        min_length=1,
        max_length=MOST_MOTORS,
    )
    """How segments bend, and where which motor winds tendons; the next keys have the true lengths
    and radii."""
    flexures: EachSegment[_Flexures] = (6, 5)
    """Hinges of each segment, evenly spaced."""
    segment_lengths_mm: EachSegment[SegmentLength] = Field(
        (58.5, 43.5), json_schema_extra=as_in("robot.segment_lengths_mm")
    )
    """True L_1 and L_2."""
    tendon_radius_mm: PerSegment[TendonRadius] = Field(
        (4.5, 4.5), json_schema_extra=as_in("robot.tendon_radius_mm")
    )
    """True r_c."""
    marker_offset_mm: Annotated[tuple[_Offset, _Offset, _Offset], BeforeValidator(_along_z)] = (
        Field((0.0, 0.0, 15.0), json_schema_extra=as_in("robot.marker_offset_mm"))
    )
    """True d_m: each marker seen from the centre of its disk, along x, y and z of (10) while the
    robot is straight; one number is an offset along z."""
    pulley_radius_mm: PulleyRadius = Field(12.5, json_schema_extra=as_in("robot.pulley_radius_mm"))
    """True r_p."""
    bending_stiffness_nm_rad: PerSegment[Annotated[float, within(1e-4, 100)]] = (0.02, 0.02)
    """Stiffness of a whole segment: moment over total bending angle."""
    stiffness_taper: PerSegment[Annotated[float, within(-0.9, 0.9)]] = (0.0, 0.0)
    """Share of its stiffness by which each segment is softer at its end than at its root."""
    stiffening: PerSegment[Annotated[float, within(0, 10)]] = (0.0, 0.0)
    """Share by which a segment bent to 90 deg resists more than its stiffness says; it grows with
    the square of the angle."""
    bending_plane_turn_deg: PerSegment[Annotated[float, within(-45, 45)]] = (0.0, 0.0)
    """Turn of each segment's flexures about the backbone, against its tendon holes; positive from
    z towards x of (10)."""
    sideways_stiffness_nm_rad: PerSegment[Annotated[float, within(0, 1000)]] = (0.0, 0.0)
    """Stiffness of a whole segment across its bending plane; 0: it bends only in its plane."""
    torsion_stiffness_nm_rad: PerSegment[Annotated[float, within(0, 1000)]] = (0.0, 0.0)
    """Moment over twist of a whole segment; 0: it does not twist."""
    axial_stiffness_n_m: PerSegment[Annotated[float, within(0, 1e8)]] = (0.0, 0.0)
    """Force over shortening of a whole segment; 0: its length does not change."""
    joint_damping: Annotated[float, within(0, 1)] = 1.2e-3
    """Damping of each flexure, N m s/rad."""
    creep_share: Annotated[tuple[_Share, _Share], BeforeValidator(_one_branch)] = (0.0, 0.0)
    """Creep of the flexures, for up to two branches: part of the bending under a constant load that
    is added as time goes by."""
    creep_time_s: Annotated[tuple[_CreepTime, _CreepTime], BeforeValidator(pair)] = (5.0, 60.0)
    """Time constant of each branch, at constant bending."""
    friction: Annotated[float, within(0, 100)] = 0.0
    """Dry friction of each tendon, N, whatever its tension."""
    capstan_friction: Annotated[float, within(0, 2)] = 0.0
    """Coefficient of friction of the tendons in each hole, where they lose tension by the angle
    through which they turn."""
    disk_mass_g: Annotated[float, within(0.01, 1000)] = 0.8
    """Mass of each disk; there is one per flexure."""
    marker_mass_g: Annotated[float, within(0.01, 1000)] = 3.0
    """Mass of each of the two moving markers."""
    payload_g: Annotated[float, within(0, 10_000)] = 0.0
    """Mass at the centre of the last disk."""
    payload_start_s: _Seconds = 0.0
    """Time at which the payload is attached, in the path's clock; 0: present from power-up."""
    slack_mm: PerTendon[_Slack] = (1.2, 1.2, 1.2, 1.2)
    """Excess length at rest of each tendon, or one number for all of them: of the first tendon of
    every segment, then of the second one of every segment, and so on."""
    tendon_stiffness_n_m: Annotated[float, within(10, 1e6)] = 4000.0
    """Force of a taut tendon over its elongation."""
    tendon_force_max_n: Annotated[float, within(0.1, 1000)] = 60.0
    """Maximum force of a tendon."""
    servo_rate_deg_s: Annotated[float, within(0.001, 10_000)] = 300.0
    """Speed at which the shaft turns towards its target."""
    servo_deadband_deg: Annotated[float, within(0, 45)] = 0.0
    """The shaft does not move while its target is no further away than this."""
    servo_stall_torque_nm: Annotated[float, within(0.01, 1000)] | None = None
    """Opposing moment at which the speed, which falls linearly with it, is zero; none: no limit."""
    servo_droop_deg_per_nm: Annotated[float, within(0, 1000)] = 0.0
    """Steady deviation of the shaft towards the load, per moment on the pulley."""
    servo_backlash_deg: Annotated[float, within(0, 45)] = 0.0
    """Play of the gear train, of which the load decides the side."""
    servo_lag_ms: Annotated[float, within(0, 1000)] = 0.0
    """Time until a change of the pulse width is followed."""
    servo_drift_deg: PerMotor[Annotated[float, within(-45, 45)]] = (0.0, 0.0)
    """Final drift of each shaft's neutral position from power-up, as the servos warm up."""
    servo_drift_time_s: Annotated[float, within(1, 1e5)] = 600.0
    """Time constant of that drift."""
    servo_neutral_us: PerMotor[Pulse] = Field(
        (1500.0, 1500.0), json_schema_extra=as_in("servo.neutral_pulse_us")
    )
    """True pulse width at a shaft angle of 0 deg."""
    servo_us_per_90_deg: PerMotor[PulseSpan] = Field(
        (1000.0, 1000.0), json_schema_extra=as_in("servo.pulse_per_90_deg_us")
    )
    """True pulse change for +90 deg; negative for a servo mounted the other way round."""
    gravity_m_s2: Annotated[
        tuple[_Acceleration, _Acceleration, _Acceleration], BeforeValidator(_downwards)
    ] = Field((0.0, 0.0, -GRAVITY_M_S2), json_schema_extra=as_in("robot.gravity_direction"))
    """Gravity along x, y and z of (10), 9.81 unless it is set; one number is gravity along -z."""
    push: Push | None = None
    """A force on the tip, as a table: {force_n = [0, 0, 0.1], start_s = 10, end_s = 12}."""
    time_step_ms: Annotated[float, within(0.02, 2)] = 0.5
    """Longest simulation step; stiff or light robots automatically use a shorter one."""

    @model_validator(mode="after")
    def _servos_turn(self) -> Twin:
        if min(map(abs, self.servo_us_per_90_deg)) < LEAST_SPAN_US:
            raise ValueError(
                f"twin.servo_us_per_90_deg = {list(self.servo_us_per_90_deg)} is nearer to 0 than "
                f"{LEAST_SPAN_US:g}"
            )
        return self


def _rotation(value: object) -> object:
    """Expand one number to a rotation about the axis (1, 1, 1); three are a rotation vector."""
    if not _is_number(value):
        return value
    return (value / 3**0.5,) * 3 if abs(value) <= FULL_TURN_DEG else value


class Tracker(Section):
    """The camera: how the twin simulates it, and settings of real ones."""

    noise_mm: Annotated[float, within(0, 100)] = 0.25
    """RMS length of the error of the measured vector from M1 to the tip's marker."""
    rate_hz: Annotated[float, within(0.1, 1000)] = 20.0
    """Exposures per second."""
    latency_ms: Annotated[float, within(0, 10_000)] = 40.0
    """Time from an exposure until the host can have it, at least; of a real camera too."""
    dropout: Annotated[float, within(0, 0.999)] = 0.0
    """Fraction of exposures without a sample."""
    outliers: Annotated[float, within(0, 0.5)] = 0.0
    """Fraction of exposures in which one marker, any of them, is seen in a wrong place."""
    outlier_mm: Annotated[float, within(0, 1000)] = 5.0
    """Distance of that place from the true one, in any direction."""
    frame_jitter_ms: Annotated[float, within(0, 1000)] = 0.0
    """Standard deviation of the true time of an exposure about the one that its sample states."""
    exposure_ms: Annotated[float, within(0, 1000)] = 0.0
    """Duration of an exposure, over which the position is averaged."""
    rotation_deg: Annotated[tuple[Turn, Turn, Turn], BeforeValidator(_rotation)] = Field(
        (0.0, 0.0, 0.0), json_schema_extra=as_in("registration.camera_to_robot_deg")
    )
    """Rotation vector of the camera frame relative to the robot frame, simulated cameras only.

    One number is a rotation about the axis (1, 1, 1). By default simulated cameras stand as the
    registration says, so that no error is left after it.
    """
    tool_files: dict[str, str] = Field(default_factory=dict)
    """Tool definitions (.rom) of a Polaris by name: M1, M2 and so on are the markers, any other
    only switches on the illuminators."""
    camera_file: str | None = None
    """Calibration file of a webcam, as written by OpenCV or ROS."""
    tag_size_mm: Annotated[float, within(1, 1000)] | None = None
    """Edge length of the ArUco tags, for a webcam."""

    @model_validator(mode="after")
    def _exposures_follow_one_another(self) -> Tracker:
        period_ms = 1000 / self.rate_hz
        if self.exposure_ms > period_ms:
            raise ValueError(
                f"tracker.exposure_ms = {self.exposure_ms:g} is longer than the period of "
                f"{period_ms:g} ms at tracker.rate_hz = {self.rate_hz:g}"
            )
        return self


def _ordered(span: tuple[float, float]) -> tuple[float, float]:
    if not span[0] < span[1]:
        raise ValueError(f"the interval [{span[0]:g}, {span[1]:g}] does not end after its start")
    return span


_Span = Annotated[tuple[_Seconds, _Seconds], AfterValidator(_ordered)]
"""Start and end."""


class PolarisFaults(Section):
    """Injected faults of the emulated Polaris; times in s in the path's clock.

    With ``ccr-host emulate`` they count from its start.
    """

    shuffle: Annotated[bool, Field(strict=True)] = False
    """Report stray markers in random order."""
    phantoms: Annotated[int, within(0, 40)] = 0
    """Number of false points per frame."""
    occlusion: _Share = 0.0
    """Probability that a marker is hidden in an exposure, independently for each marker."""
    bad_crc: _Share = 0.0
    """Probability that a reply is corrupted in transit."""
    occluded_s: tuple[_Span, ...] = ()
    """Intervals in which all markers are hidden, e.g. [[10, 12], [30, 31]]."""
    out_of_volume_s: tuple[_Span, ...] = ()
    """Intervals in which the scene is beyond the far end of the measurement volume."""
    silent_s: tuple[_Span, ...] = ()
    """Intervals in which the camera does not respond."""
    unplugged_s: tuple[_Span, ...] = ()
    """Intervals in which its port is gone."""
    reset_s: tuple[_Seconds, ...] = ()
    """Times at which its power fails for a moment."""
