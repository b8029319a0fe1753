"""Robot description: load, validate, override.

One TOML file describes a robot: the controller's model (``robot``, ``control``), the servos and
their limits (``servo``, ``link``), the measured orientation of the camera (``registration``), how
the twin and its camera differ from all that (``twin``, ``tracker``), and the measured rest
positions (``identified``). Every key has a unit in its name and a range; unknown keys are rejected.
``--set section.key=value`` overrides one key.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Annotated, Any, Literal, TypeVar

from pydantic import (
    AfterValidator,
    BeforeValidator,
    Field,
    ValidationError,
    ValidationInfo,
    field_validator,
    model_validator,
)

from ccr_host.core.errors import ConfigError
from ccr_host.description.section import (
    LEAST_SPAN_US,
    Both,
    Direction,
    MarkerOffset,
    PulleyRadius,
    Pulse,
    PulseSpan,
    Section,
    SegmentLength,
    TendonRadius,
    Turn,
    explain,
    followed_key,
    within,
)
from ccr_host.description.simulation import GRAVITY_M_S2, PolarisFaults, Tracker, Twin
from ccr_host.description.source import text_of, tree_of, tree_with

Pair = tuple[float, float]
T = TypeVar("T")
LONGEST_BOARD_NAME = 16
"""Characters that the board can store."""

_Angle = Annotated[float, within(-135, 135)]
_LEAST_RANGE_DEG = 1.0
_LEAST_PULSE_RANGE_US = 1.0
"""The board counts in steps of 0.5 us."""
_MOST_BENDING_DEG = 540
"""1.5 turns of one segment; the paper's robot bends by 236 deg at its limits."""


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


class Tendon(Section):
    """A tendon of a robot of any number of segments, `[[robot.segments.tendons]]`."""

    angle_deg: Turn
    """Place of its holes about the backbone, from x towards y of the base."""
    motor: Annotated[int, within(1, 12)]
    """The motor that winds it."""
    winding: Annotated[int, within(-1, 1)] = 1
    """1 if the motor pulls it in the positive direction, -1 in the other."""
    slack_mm: Annotated[float, within(-100, 100)] = 0.0
    """Travel that takes up its slack; negative for a tendon that is taut at rest."""

    @model_validator(mode="after")
    def _is_wound(self) -> Tendon:
        if self.winding == 0:
            raise ValueError("robot.segments.tendons.winding = 0 is neither 1 nor -1")
        return self


class Segment(Section):
    """A segment of a robot of any number of segments, from the base, `[[robot.segments]]`.

    The last four keys are what `ccr-host identify` finds besides the geometry.
    """

    length_mm: SegmentLength
    """Length of its backbone."""
    tendon_radius_mm: TendonRadius
    """From the tendon holes to the backbone."""
    bends: Literal["plane", "space"] = "space"
    """In one plane, or in any direction."""
    direction_deg: Turn = 0.0
    """Direction in which a segment bends that bends in a plane, measured as tendons' angles."""
    stiffness: Annotated[float, within(0.01, 100)] = 1.0
    """Its bending stiffness over that of the first segment."""
    compliance: Annotated[float, within(1e-4, 100)] = 0.05
    """Additional motor angle due to the stretch of its tendons, over the bending angle."""
    sag: Annotated[float, within(-1, 1)] = 0.0
    """Slack in tendon radii that bending adds to every tendon, per rad^2."""
    dead_travel_mm: Annotated[float, within(0, 100)] = 0.0
    """Travel that its tendons lose after each reversal, half on either side."""
    tendons: Annotated[tuple[Tendon, ...], Field(min_length=1, max_length=12)]
    """The tendons that end at its last disk; they run through all earlier segments."""


class Robot(Section):
    """Geometry in the controller's model (the paper's Table I)."""

    segment_lengths_mm: tuple[SegmentLength, SegmentLength] = (58.5, 43.5)
    """L_1 and L_2."""
    tendon_radius_mm: TendonRadius = 4.5
    """r_c, from the tendon hole to the centre of the disk."""
    marker_offset_mm: MarkerOffset = 15.0
    """d_m, from the centre of the disk to the marker."""
    pulley_radius_mm: PulleyRadius = 12.5
    """r_p, radius of the pulley on the servo."""
    gravity_direction: Direction = (0.0, 0.0, -1.0)
    """Direction of gravity in the frame of (10): [0, 0, 1] for a robot mounted upside
    down, [1, 0, 0] or [-1, 0, 0] on its side, [0, -1, 0] hanging straight down."""
    board_name: Annotated[str, AfterValidator(checked_board_name)] = ""
    """Name that the board must have, unless empty; see `ccr-host calibrate --board-name`."""
    segments: Annotated[tuple[Segment, ...], Field(max_length=12)] = ()
    """A robot of another kind, from the base to the tip, instead of the lengths and the radius
    above. So far only `ccr-host identify` reads such robots."""

    @model_validator(mode="after")
    def _motors_are_counted_from_1(self) -> Robot:
        used = {tendon.motor for segment in self.segments for tendon in segment.tendons}
        if missing := set(range(1, max(used, default=0) + 1)) - used:
            raise ValueError(
                f"robot.segments: no tendon is wound by motor {min(missing)} of {max(used)}"
            )
        return self


class Servo(Section):
    """The two servos as the board drives them; index 0 bends segment 1."""

    angle_min_deg: Both[_Angle] = (-85.0, -85.0)
    """Lower limit of the commanded angle."""
    angle_max_deg: Both[_Angle] = (85.0, 85.0)
    """Upper limit of the commanded angle."""
    rest_deg: Both[_Angle] = (0.0, 0.0)
    """Angle to which the board returns the servo when the host is silent."""
    slew_deg_s: Both[Annotated[float, within(5, 1000)]] = (300.0, 300.0)
    """Limit of the commanded rate, enforced by the board."""
    acceleration_deg_s2: Both[Annotated[float, within(0, 50_000)]] = (0.0, 0.0)
    """Limit of the commanded acceleration, enforced by the board: 25 or more; 0 for none. The
    setpoint then lags a ramp by up to rate^2 / (2 acceleration), which controllers do not model."""
    neutral_pulse_us: Both[Pulse] = (1500.0, 1500.0)
    """Pulse width at 0 deg."""
    pulse_per_90_deg_us: Both[PulseSpan] = (1000.0, 1000.0)
    """Pulse change for +90 deg; negative for a servo mounted the other way round."""
    pulse_min_us: Both[Pulse] = (500.0, 500.0)
    """Shortest pulse that the board ever sends, whatever the angle."""
    pulse_max_us: Both[Pulse] = (2500.0, 2500.0)
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
            if abs(span_us) < LEAST_SPAN_US:
                raise ValueError(
                    f"servo.pulse_per_90_deg_us = {span_us:g} {of_axis} is nearer to 0 than "
                    f"{LEAST_SPAN_US:g}"
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


class Link(Section):
    """The serial link, and the staged reaction of the board to a silent host."""

    baud: Annotated[int, within(9600, 2_000_000)] = 250_000
    """Bit rate of the serial port."""
    target_validity_periods: Annotated[float, within(1.1, 100)] = 2.5
    """A target is valid for this many control periods; after that the board holds its pose."""
    relax_after_ms: Annotated[int, within(200, 60_000)] = 2000
    """Time from hold to the slow return to the rest pose."""
    relax_slew_deg_s: Annotated[float, within(5, 250)] = 30.0
    """Rate of that return."""
    arm_axis_ms: Annotated[int, within(20, 5000)] = 300
    """Time between enabling one servo and the next."""


class Control(Section):
    """The paper's controller (Section IV-A); its angles are taken as radians, see docs."""

    horizon: Annotated[int, within(2, 100)] = 4
    """N of (14), steps."""
    position_weight: Annotated[float, within(1e-6, 1e6)] = 1.0
    """Q of (15), per mm^2."""
    effort_weight: Annotated[float, within(0, 1e6)] = 0.5
    """R of (15), per rad^2."""
    step_bound_rad: Annotated[float, within(0.001, 10)] = 2.0
    """|u| of (15), per control step."""
    solver: Literal["daqp", "compiled"] = "daqp"
    """`compiled` runs `mpc` and the model of `adaptive` as machine code (extra `fast`)."""
    settle_s: Annotated[float, within(0, 60)] = 2.0
    """Time from the first command to the start of the path."""
    stale_after_ms: Annotated[int, within(1, 60_000)] = 250
    """A sample older than this counts as lost."""
    coast_s: Annotated[float, within(0, 600)] = 2.0
    """Time for which the controller continues on its model alone while no markers are seen."""
    hold_s: Annotated[float, within(0, 600)] = 3.0
    """Time for which the pose is then held before the run ends and the robot is disarmed."""


class Registration(Section):
    """Orientation of the camera, measured by ``ccr-host register``."""

    camera_to_robot_deg: tuple[Turn, Turn, Turn]
    """Rotation vector of R: a vector v in the camera frame is R v in the frame of (10)."""
    uncertainty_deg: tuple[Turn, Turn, Turn] | None = None
    """Standard deviation about x, y and z of (10)."""
    residual_mm: Annotated[float, within(0, 1000)] | None = None
    """RMS distance of the markers from the fitted shapes."""
    scale: Annotated[float, within(0.01, 100)] | None = None
    """Measured length of segment 2 over its length in the model."""
    date: Annotated[str, BeforeValidator(str)] = ""
    """Date of the registration."""


_MotorAngle = Annotated[float, within(-3, 3)]
_Pose = tuple[_MotorAngle, _MotorAngle]
_Coordinate = Annotated[float, within(-10_000, 10_000)]
_Place = tuple[_Coordinate, _Coordinate, _Coordinate]


class Identified(Section):
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
    count: tuple[Annotated[int, within(1, 1e9)], ...]
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


class Description(Section):
    """A whole robot description."""

    name: str = "robot"
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
    def _simulated_as_described(cls, section: Section, info: ValidationInfo) -> Section:
        """Simulate the user's robot instead of the paper's: copy the followed keys."""
        followed: dict[str, Any] = {}
        for name, field in type(section).model_fields.items():
            source, _, key = (followed_key(field) or "").partition(".")
            described = info.data.get(source)
            if described is not None and name not in section.model_fields_set:
                followed[name] = getattr(described, key)
        if "gravity_m_s2" in followed:
            followed["gravity_m_s2"] = [GRAVITY_M_S2 * share for share in followed["gravity_m_s2"]]
        expanded = type(section).model_validate(followed)
        return section.model_copy(update={name: getattr(expanded, name) for name in followed})


def load(source: str | None = None, overrides: Iterable[str] = ()) -> Description:
    """Read the description of a robot with two planar segments and apply overrides.

    Args and errors as those of :func:`load_any`.

    Raises:
        ConfigError: also if it describes a robot of another kind.
    """
    description = load_any(source, overrides)
    if description.robot.segments:
        raise ConfigError(
            f"robot.segments in {source}: so far only ccr-host identify reads robots of any number "
            "of segments",
            "describe two planar segments with robot.segment_lengths_mm and tendon_radius_mm",
        )
    return description


def load_any(source: str | None = None, overrides: Iterable[str] = ()) -> Description:
    """Read a description of a robot of any kind and apply overrides.

    Args:
        source: a TOML file, or the name of a shipped description; None for the default.
        overrides: ``section.key=value``, value in TOML notation.

    Raises:
        ConfigError: states the file or key, what is wrong with it, and what is allowed.
    """
    tree = tree_of(text_of(source), source)
    return _validated(tree_with(tree, overrides), source)


def parse(text: str) -> Description:
    """Parse a description from its TOML text.

    Raises:
        ConfigError: see :func:`load`.
    """
    return _validated(tree_of(text), None)


def _validated(tree: dict[str, Any], source: str | None) -> Description:
    try:
        return Description.model_validate(tree)
    except ValidationError as error:
        where = f" in {source}" if source else ""
        raise ConfigError(*explain(error, Description, where)) from None
