"""Robot description: load, validate, override.

One TOML file describes a robot: the controller's model (``robot``, ``control``), the servos and
their limits (``servo``, ``link``), the measured orientation of the camera (``registration``), how
the twin and its camera differ from all that (``twin``, ``tracker``), and the measured rest
positions (``identified``). Every key has a unit in its name and a range; unknown keys are rejected.
``--set section.key=value`` overrides one key.
"""

from __future__ import annotations

import tomllib
from collections.abc import Iterable
from typing import Annotated, Any, Literal, TypeVar

from pydantic import (
    AfterValidator,
    BaseModel,
    BeforeValidator,
    ConfigDict,
    Field,
    ValidationError,
    ValidationInfo,
    field_validator,
    model_validator,
)
from pydantic.fields import FieldInfo

from ccr_host.core.errors import ConfigError
from ccr_host.description.refusals import explain
from ccr_host.description.source import text_of

Pair = tuple[float, float]
Vector3 = tuple[float, float, float]
T = TypeVar("T")
LONGEST_BOARD_NAME = 16
"""Characters that the board can store."""


def _both_axes(value: object) -> object:
    """Expand one number to both axes."""
    return (value, value) if isinstance(value, int | float) else value


def _all_tendons(value: object) -> object:
    """Expand one number to all four tendons."""
    return (value,) * 4 if isinstance(value, int | float) else value


def _within(low: float, high: float) -> FieldInfo:
    """Bounds of a number; strict, so that text and `true` are rejected."""
    bounds: FieldInfo = Field(ge=low, le=high, strict=True)
    return bounds


Both = Annotated[tuple[T, T], BeforeValidator(_both_axes)]
"""One value for each axis, or one for both."""

# Robots and tendons: from catheters of 2 mm to trunks of a metre.
_SegmentLength = Annotated[float, _within(5, 1000)]
_TendonRadius = Annotated[float, _within(0.2, 100)]
_MarkerOffset = Annotated[float, _within(0, 500)]
_PulleyRadius = Annotated[float, _within(1, 200)]
# Servos: what the board's protocol can carry.
_Angle = Annotated[float, _within(-135, 135)]
_Pulse = Annotated[float, _within(500, 2500)]
_PulseSpan = Annotated[float, _within(-2000, 2000)]
_LEAST_SPAN_US = 50.0
_LEAST_RANGE_DEG = 1.0
_LEAST_PULSE_RANGE_US = 1.0
"""The board counts in steps of 0.5 us."""
_FULL_TURN_DEG = 360
_MOST_BENDING_DEG = 540
"""1.5 turns of one segment; the paper's robot bends by 236 deg at its limits."""
_Turn = Annotated[float, _within(-_FULL_TURN_DEG, _FULL_TURN_DEG)]
_Seconds = Annotated[float, _within(0, 1e6)]
"""Time in the path's clock, s, up to eleven days."""
_Share = Annotated[float, _within(0, 1)]


def _as_in(key: str) -> dict[str, Any]:
    """Mark a key of the simulation that takes its value from another section unless it is set."""
    return {"as_in": key}


def followed_key(field: FieldInfo) -> str | None:
    """The ``section.key`` whose value a field of the simulation takes unless it is set."""
    extra = field.json_schema_extra
    return str(extra["as_in"]) if isinstance(extra, dict) and "as_in" in extra else None


class _Section(BaseModel):
    model_config = ConfigDict(
        frozen=True, extra="forbid", allow_inf_nan=False, use_attribute_docstrings=True
    )


def checked_board_name(name: str) -> str:
    """Return the name if a board can store it.

    Raises:
        ValueError: too long, not printable ASCII, or with a space at an end.
    """
    room = LONGEST_BOARD_NAME
    if not (name.isascii() and name.isprintable() and len(name) <= room and name == name.strip()):
        shown = ascii(name if len(name) <= room else name[:room] + "...")
        raise ValueError(
            f"{shown} is not up to {room} printable ASCII characters without a space at the ends"
        )
    return name


class Robot(_Section):
    """Geometry in the controller's model (the paper's Table I)."""

    segment_lengths_mm: tuple[_SegmentLength, _SegmentLength] = (58.5, 43.5)
    """L_1 and L_2."""
    tendon_radius_mm: _TendonRadius = 4.5
    """r_c, from the tendon hole to the centre of the disk."""
    marker_offset_mm: _MarkerOffset = 15.0
    """d_m, from the centre of the disk to the marker."""
    pulley_radius_mm: _PulleyRadius = 12.5
    """r_p, radius of the pulley on the servo."""
    board_name: Annotated[str, AfterValidator(checked_board_name)] = ""
    """Name that the board must have, unless empty; see `ccr-host calibrate --board-name`."""


class Servo(_Section):
    """The two servos as the board drives them; index 0 bends segment 1."""

    angle_min_deg: Both[_Angle] = (-85.0, -85.0)
    """Lower limit of the commanded angle."""
    angle_max_deg: Both[_Angle] = (85.0, 85.0)
    """Upper limit of the commanded angle."""
    rest_deg: Both[_Angle] = (0.0, 0.0)
    """Angle to which the board returns the servo when the host is silent."""
    slew_deg_s: Both[Annotated[float, _within(5, 1000)]] = (300.0, 300.0)
    """Limit of the commanded rate, enforced by the board."""
    acceleration_deg_s2: Both[Annotated[float, _within(0, 50_000)]] = (0.0, 0.0)
    """Limit of the commanded acceleration, enforced by the board: 25 or more; 0 for none. The
    setpoint then lags a ramp by up to rate^2 / (2 acceleration), which controllers do not model."""
    neutral_pulse_us: Both[_Pulse] = (1500.0, 1500.0)
    """Pulse width at 0 deg."""
    pulse_per_90_deg_us: Both[_PulseSpan] = (1000.0, 1000.0)
    """Pulse change for +90 deg; negative for a servo mounted the other way round."""
    pulse_min_us: Both[_Pulse] = (500.0, 500.0)
    """Shortest pulse that the board ever sends, whatever the angle."""
    pulse_max_us: Both[_Pulse] = (2500.0, 2500.0)
    """Longest pulse that the board ever sends, whatever the angle."""

    @model_validator(mode="after")
    def _limits_are_ordered(self) -> Servo:
        for axis in (0, 1):
            low_deg, high_deg = self.angle_min_deg[axis], self.angle_max_deg[axis]
            rest_deg, span_us = self.rest_deg[axis], self.pulse_per_90_deg_us[axis]
            low_us, high_us = self.pulse_min_us[axis], self.pulse_max_us[axis]
            neutral_us = self.neutral_pulse_us[axis]
            rest_us = neutral_us + rest_deg / 90 * span_us
            of_axis = f"of axis {axis + 1}"
            if high_deg - low_deg < _LEAST_RANGE_DEG:
                raise ValueError(
                    f"servo.angle_min_deg = {low_deg:g} does not lie {_LEAST_RANGE_DEG:g} deg or "
                    f"more below angle_max_deg = {high_deg:g} {of_axis}"
                )
            if not low_deg <= rest_deg <= high_deg:
                raise ValueError(
                    f"servo.rest_deg = {rest_deg:g} does not lie between the limits "
                    f"{low_deg:g} and {high_deg:g} deg {of_axis}"
                )
            if abs(span_us) < _LEAST_SPAN_US:
                raise ValueError(
                    f"servo.pulse_per_90_deg_us = {span_us:g} {of_axis} is nearer to 0 than "
                    f"{_LEAST_SPAN_US:g}"
                )
            if high_us - low_us < _LEAST_PULSE_RANGE_US:
                raise ValueError(
                    f"servo.pulse_min_us = {low_us:g} does not lie {_LEAST_PULSE_RANGE_US:g} us or "
                    f"more below pulse_max_us = {high_us:g} {of_axis}"
                )
            if not low_us <= neutral_us <= high_us:
                raise ValueError(
                    f"servo.neutral_pulse_us = {neutral_us:g} does not lie between pulse_min_us = "
                    f"{low_us:g} and pulse_max_us = {high_us:g} {of_axis}"
                )
            if not low_us <= rest_us <= high_us:
                raise ValueError(
                    f"servo.rest_deg = {rest_deg:g} would take a pulse of {rest_us:.0f} us, "
                    f"outside pulse_min_us = {low_us:g} and pulse_max_us = {high_us:g} {of_axis}"
                )
        return self


class Link(_Section):
    """The serial link, and the staged reaction of the board to a silent host."""

    baud: Annotated[int, _within(9600, 2_000_000)] = 250_000
    """Bit rate of the serial port."""
    target_validity_periods: Annotated[float, _within(1.1, 100)] = 2.5
    """A target is valid for this many control periods; after that the board holds its pose."""
    relax_after_ms: Annotated[int, _within(200, 60_000)] = 2000
    """Time from hold to the slow return to the rest pose."""
    relax_slew_deg_s: Annotated[float, _within(5, 250)] = 30.0
    """Rate of that return."""
    arm_axis_ms: Annotated[int, _within(20, 5000)] = 300
    """Time between enabling one servo and the next."""


class Control(_Section):
    """The paper's controller (Section IV-A); its angles are taken as radians, see docs."""

    horizon: Annotated[int, _within(2, 100)] = 4
    """N of (14), steps."""
    position_weight: Annotated[float, _within(1e-6, 1e6)] = 1.0
    """Q of (15), per mm^2."""
    effort_weight: Annotated[float, _within(0, 1e6)] = 0.5
    """R of (15), per rad^2."""
    step_bound_rad: Annotated[float, _within(0.001, 10)] = 2.0
    """|u| of (15), per control step."""
    solver: Literal["daqp", "compiled"] = "daqp"
    """`compiled` runs `mpc` and the model of `adaptive` as machine code (extra `fast`)."""
    settle_s: Annotated[float, _within(0, 60)] = 2.0
    """Time from the first command to the start of the path."""
    stale_after_ms: Annotated[int, _within(1, 60_000)] = 250
    """A sample older than this counts as lost."""
    coast_s: Annotated[float, _within(0, 600)] = 2.0
    """Time for which the controller continues on its model alone while no markers are seen."""
    hold_s: Annotated[float, _within(0, 600)] = 3.0
    """Time for which the pose is then held before the run ends and the robot is disarmed."""


_Force = Annotated[float, _within(-100, 100)]


class Push(_Section):
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


_Flexures = Annotated[int, _within(1, 40)]


_Slack = Annotated[float, _within(0, 100)]


class Twin(_Section):
    """The simulated robot; docs/twin.md explains how each default was chosen."""

    flexures: tuple[_Flexures, _Flexures] = (6, 5)
    """Hinges of each segment, evenly spaced."""
    segment_lengths_mm: tuple[_SegmentLength, _SegmentLength] = Field(
        (58.5, 43.5), json_schema_extra=_as_in("robot.segment_lengths_mm")
    )
    """True L_1 and L_2."""
    tendon_radius_mm: _TendonRadius = Field(4.5, json_schema_extra=_as_in("robot.tendon_radius_mm"))
    """True r_c."""
    marker_offset_mm: _MarkerOffset = Field(
        15.0, json_schema_extra=_as_in("robot.marker_offset_mm")
    )
    """True d_m."""
    pulley_radius_mm: _PulleyRadius = Field(
        12.5, json_schema_extra=_as_in("robot.pulley_radius_mm")
    )
    """True r_p."""
    bending_stiffness_nm_rad: Both[Annotated[float, _within(1e-4, 100)]] = (0.02, 0.02)
    """Stiffness of a whole segment: moment over total bending angle."""
    joint_damping: Annotated[float, _within(0, 1)] = 2e-4
    """Damping of each flexure, N m s/rad."""
    friction: Annotated[float, _within(0, 100)] = 0.0
    """Dry friction of each tendon, N."""
    disk_mass_g: Annotated[float, _within(0.01, 1000)] = 0.8
    """Mass of each disk; there is one per flexure."""
    marker_mass_g: Annotated[float, _within(0.01, 1000)] = 3.0
    """Mass of each of the two moving markers."""
    payload_g: Annotated[float, _within(0, 10_000)] = 0.0
    """Mass at the centre of the last disk."""
    payload_start_s: _Seconds = 0.0
    """Time at which the payload is attached, in the path's clock; 0: present from power-up."""
    slack_mm: Annotated[tuple[_Slack, _Slack, _Slack, _Slack], BeforeValidator(_all_tendons)] = (
        1.2,
        1.2,
        1.2,
        1.2,
    )
    """Excess length at rest of tendons 1 to 4, or one number for all of them."""
    tendon_stiffness_n_m: Annotated[float, _within(10, 1e6)] = 4000.0
    """Force of a taut tendon over its elongation."""
    tendon_force_max_n: Annotated[float, _within(0.1, 1000)] = 60.0
    """Maximum force of a tendon."""
    servo_rate_deg_s: Annotated[float, _within(0.001, 10_000)] = 300.0
    """Speed at which the shaft turns towards its target."""
    servo_deadband_deg: Annotated[float, _within(0, 45)] = 0.0
    """The shaft does not move while its target is no further away than this."""
    servo_neutral_us: Both[_Pulse] = Field(
        (1500.0, 1500.0), json_schema_extra=_as_in("servo.neutral_pulse_us")
    )
    """True pulse width at a shaft angle of 0 deg."""
    servo_us_per_90_deg: Both[_PulseSpan] = Field(
        (1000.0, 1000.0), json_schema_extra=_as_in("servo.pulse_per_90_deg_us")
    )
    """True pulse change for +90 deg; negative for a servo mounted the other way round."""
    gravity_m_s2: Annotated[float, _within(-100, 100)] = 9.81
    """Gravity along -z; negative for a robot mounted upside down."""
    push: Push | None = None
    """A force on the tip, as a table: {force_n = [0, 0, 0.1], start_s = 10, end_s = 12}."""
    time_step_ms: Annotated[float, _within(0.02, 2)] = 0.5
    """Longest simulation step; stiff or light robots automatically use a shorter one."""

    @model_validator(mode="after")
    def _servos_turn(self) -> Twin:
        if min(map(abs, self.servo_us_per_90_deg)) < _LEAST_SPAN_US:
            raise ValueError(
                f"twin.servo_us_per_90_deg = {list(self.servo_us_per_90_deg)} is nearer to 0 than "
                f"{_LEAST_SPAN_US:g}"
            )
        return self


def _rotation(value: object) -> object:
    """Expand one number to a rotation about the axis (1, 1, 1); three are a rotation vector."""
    if isinstance(value, bool) or not isinstance(value, int | float):
        return value
    return (value / 3**0.5,) * 3 if abs(value) <= _FULL_TURN_DEG else value


class Tracker(_Section):
    """The camera: how the twin simulates it, and settings of real ones."""

    noise_mm: Annotated[float, _within(0, 100)] = 0.25
    """RMS length of the error of the measured vector M3 - M1."""
    rate_hz: Annotated[float, _within(0.1, 1000)] = 20.0
    """Exposures per second."""
    latency_ms: Annotated[float, _within(0, 10_000)] = 40.0
    """Time from an exposure until the host can have it, at least; of a real camera too."""
    dropout: Annotated[float, _within(0, 0.999)] = 0.0
    """Fraction of exposures without a sample."""
    rotation_deg: Annotated[tuple[_Turn, _Turn, _Turn], BeforeValidator(_rotation)] = Field(
        (0.0, 0.0, 0.0), json_schema_extra=_as_in("registration.camera_to_robot_deg")
    )
    """Rotation vector of the camera frame relative to the robot frame, simulated cameras only.

    One number is a rotation about the axis (1, 1, 1). By default simulated cameras stand as the
    registration says, so that no error is left after it.
    """
    tool_files: dict[str, str] = Field(default_factory=dict)
    """Tool definitions (.rom) of a Polaris by name: M1, M2, M3 are the markers, any other only
    switches on the illuminators."""
    camera_file: str | None = None
    """Calibration file of a webcam, as written by OpenCV or ROS."""
    tag_size_mm: Annotated[float, _within(1, 1000)] | None = None
    """Edge length of the ArUco tags, for a webcam."""


def _ordered(span: Pair) -> Pair:
    if not span[0] < span[1]:
        raise ValueError(f"the interval [{span[0]:g}, {span[1]:g}] does not end after its start")
    return span


_Span = Annotated[tuple[_Seconds, _Seconds], AfterValidator(_ordered)]
"""Start and end."""


class PolarisFaults(_Section):
    """Injected faults of the emulated Polaris; times in s in the path's clock.

    With ``ccr-host emulate`` they count from its start.
    """

    shuffle: Annotated[bool, Field(strict=True)] = False
    """Report stray markers in random order."""
    phantoms: Annotated[int, _within(0, 40)] = 0
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


class Registration(_Section):
    """Orientation of the camera, measured by ``ccr-host register``."""

    camera_to_robot_deg: tuple[_Turn, _Turn, _Turn]
    """Rotation vector of R: a vector v in the camera frame is R v in the frame of (10)."""
    uncertainty_deg: tuple[_Turn, _Turn, _Turn] | None = None
    """Standard deviation about x, y and z of (10)."""
    residual_mm: Annotated[float, _within(0, 1000)] | None = None
    """RMS distance of the markers from the fitted shapes."""
    scale: Annotated[float, _within(0.01, 100)] | None = None
    """Measured length of segment 2 over its length in the model."""
    date: Annotated[str, BeforeValidator(str)] = ""
    """Date of the registration."""


_MotorAngle = Annotated[float, _within(-3, 3)]
_Pose = tuple[_MotorAngle, _MotorAngle]
_Coordinate = Annotated[float, _within(-10_000, 10_000)]
_Place = tuple[_Coordinate, _Coordinate, _Coordinate]


class Identified(_Section):
    """Measurements of ``ccr-host calibrate --identify``, to which `adaptive` fits its model.

    Kept as measured, one row per rest, so that they outlive changes of the model.
    """

    start_rad: _Pose
    """Motor angles before the first rest."""
    setpoint_rad: Annotated[tuple[_Pose, ...], Field(min_length=10)]
    """Motor angles of each rest, in the order of the tour."""
    tip_mm: tuple[_Place, ...]
    """Mean measured tip position at each rest."""
    middle_mm: tuple[_Place, ...] = ()
    """Mean measured M2 - M1 at each rest; missing in files from before December 2026."""
    count: tuple[Annotated[int, _within(1, 1e9)], ...]
    """Number of measurements behind each mean."""
    valid_for: str
    """Digest of the geometry, the servos' pulses and the registration used for the tour."""
    date: Annotated[str, BeforeValidator(str)] = ""
    """Date of the tour."""

    @model_validator(mode="after")
    def _rows_belong_together(self) -> Identified:
        columns = self.tip_mm, self.middle_mm or self.tip_mm, self.count
        if any(len(column) != len(self.setpoint_rad) for column in columns):
            raise ValueError(
                "identified.setpoint_rad, tip_mm, middle_mm and count have different numbers of "
                "rows"
            )
        return self


class Description(_Section):
    """A whole robot description."""

    name: str = "paper"
    """Name of the robot in run folders, free text."""
    robot: Robot = Robot()
    servo: Servo = Servo()
    link: Link = Link()
    control: Control = Control()
    registration: Registration | None = None
    twin: Twin = Field(Twin(), validate_default=True)
    tracker: Tracker = Field(Tracker(), validate_default=True)
    polaris_faults: PolarisFaults = PolarisFaults()
    identified: Identified | None = None

    @model_validator(mode="after")
    def _bends_less_than_a_circle(self) -> Description:
        robot, servo = self.robot, self.servo
        limit_deg = max(map(abs, (*servo.angle_min_deg, *servo.angle_max_deg)))
        bent_deg = limit_deg * robot.pulley_radius_mm / robot.tendon_radius_mm
        if bent_deg > _MOST_BENDING_DEG:
            raise ValueError(
                f"a servo angle of {limit_deg:g} deg on a pulley of {robot.pulley_radius_mm:g} mm "
                f"would bend a segment by {bent_deg:.0f} deg, {_MOST_BENDING_DEG:g} are allowed: "
                "correct robot.pulley_radius_mm or tendon_radius_mm, or narrow "
                "servo.angle_min_deg and angle_max_deg"
            )
        return self

    @field_validator("twin", "tracker", mode="after")
    @classmethod
    def _simulated_as_described(cls, section: _Section, info: ValidationInfo) -> _Section:
        """Simulate the user's robot instead of the paper's: copy the followed keys."""
        followed: dict[str, Any] = {}
        for name, field in type(section).model_fields.items():
            source, _, key = (followed_key(field) or "").partition(".")
            described = info.data.get(source)
            if described is not None and name not in section.model_fields_set:
                followed[name] = getattr(described, key)
        return section.model_copy(update=followed)


def load(source: str | None = None, overrides: Iterable[str] = ()) -> Description:
    """Read a description and apply overrides.

    Args:
        source: a TOML file, or the name of a shipped description; None for the default.
        overrides: ``section.key=value``, value in TOML notation.

    Raises:
        ConfigError: states the file or key, what is wrong with it, and what is allowed.
    """
    tree = _tree(text_of(source), source)
    for override in overrides:
        _apply(tree, override)
    return _validated(tree, source)


def parse(text: str) -> Description:
    """Parse a description from its TOML text.

    Raises:
        ConfigError: see :func:`load`.
    """
    return _validated(_tree(text, None), None)


def _validated(tree: dict[str, Any], source: str | None) -> Description:
    try:
        return Description.model_validate(tree)
    except ValidationError as error:
        where = f" in {source}" if source else ""
        raise ConfigError(*explain(error, Description, where)) from None


def _tree(text: str, source: str | None) -> dict[str, Any]:
    try:
        return tomllib.loads(text)
    except (ValueError, RecursionError) as error:
        name = f" {source}" if source else ""
        raise ConfigError(f"robot description{name}: {error}", "correct the TOML") from None


def _apply(tree: dict[str, Any], override: str) -> None:
    path, equals, text = override.partition("=")
    keys = path.strip().split(".")
    if not equals or not all(keys):
        raise ConfigError(f"--set {override}: not KEY=VALUE", "write e.g. --set twin.slack_mm=0.8")
    *sections, last = keys
    node = tree
    for key in sections:
        node = node.setdefault(key, {})
        if not isinstance(node, dict):
            raise ConfigError(
                f"--set {override}: {key} has no keys below it", "see docs/robot-description.md"
            )
    node[last] = _parse_value(text.strip())


def _parse_value(text: str) -> Any:  # noqa: ANN401 - any TOML value
    try:
        return tomllib.loads(f"value = {text}")["value"]
    except (ValueError, RecursionError):
        return text
