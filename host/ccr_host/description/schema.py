"""Robot description: load, validate, override.

One TOML file describes a robot: the controller's model (``robot``, ``control``), the servos and
their limits (``servo``, ``link``), the measured orientation of the camera (``registration``), how
the twin and its camera differ from all that (``twin``, ``tracker``), and the measured rest
positions (``identified``). Every key has a unit in its name and a range; unknown keys are rejected.
``--set section.key=value`` overrides one key.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Annotated, Any, Literal

from pydantic import (
    BeforeValidator,
    Field,
    ValidationError,
    ValidationInfo,
    field_validator,
    model_validator,
)

from ccr_host.core.errors import ConfigError
from ccr_host.description.robot import MOST_MOTORS, Robot, Segment, Tendon, tendons_of
from ccr_host.description.section import (
    LEAST_SPAN_US,
    PerMotor,
    Pulse,
    PulseSpan,
    Section,
    Turn,
    explain,
    fitted,
    followed_key,
    within,
)
from ccr_host.description.simulation import GRAVITY_M_S2, PolarisFaults, Tracker, Twin
from ccr_host.description.source import text_and_encoding_of, tree_of, tree_with

__all__ = [
    "Control",
    "Description",
    "Identified",
    "Link",
    "Registration",
    "Robot",
    "Segment",
    "Servo",
    "Tendon",
    "load",
    "parse",
]

_Angle = Annotated[float, within(-135, 135)]
_LEAST_RANGE_DEG = 1.0
_LEAST_PULSE_RANGE_US = 1.0
"""The board counts in steps of 0.5 us."""
_MOST_BENDING_DEG = 540
"""1.5 turns of one segment; the paper's robot bends by 236 deg at its limits."""


class Servo(Section):
    """The servos as the board drives them; of the paper's robot the first bends segment 1."""

    angle_min_deg: PerMotor[_Angle] = (-85.0, -85.0)
    """Lower limit of the commanded angle."""
    angle_max_deg: PerMotor[_Angle] = (85.0, 85.0)
    """Upper limit of the commanded angle."""
    rest_deg: PerMotor[_Angle] = (0.0, 0.0)
    """Angle to which the board returns the servo when the host is silent."""
    slew_deg_s: PerMotor[Annotated[float, within(5, 1000)]] = (300.0, 300.0)
    """Limit of the commanded rate, enforced by the board."""
    acceleration_deg_s2: PerMotor[Annotated[float, within(0, 50_000)]] = (0.0, 0.0)
    """Limit of the commanded acceleration, enforced by the board: 25 or more; 0 for none. The
    setpoint then lags a ramp by up to rate^2 / (2 acceleration), which controllers do not model."""
    neutral_pulse_us: PerMotor[Pulse] = (1500.0, 1500.0)
    """Pulse width at 0 deg."""
    pulse_per_90_deg_us: PerMotor[PulseSpan] = (1000.0, 1000.0)
    """Pulse change for +90 deg; negative for a servo mounted the other way round."""
    pulse_min_us: PerMotor[Pulse] = (500.0, 500.0)
    """Shortest pulse that the board ever sends, whatever the angle."""
    pulse_max_us: PerMotor[Pulse] = (2500.0, 2500.0)
    """Longest pulse that the board ever sends, whatever the angle."""

    @model_validator(mode="after")
    def _limits_are_ordered(self) -> Servo:
        counts = {len(getattr(self, key)) for key in type(self).model_fields}
        if len(counts) > 1:
            raise ValueError(f"servo: {min(counts)} values of one key and {max(counts)} of another")
        for axis in range(max(counts)):
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
    bending: Literal["estimated", "commanded"] = "estimated"
    """The bending at which `mpc` takes J: `estimated` from all markers, so that slack and load do
    not lead it astray, or that of the `commanded` angles, Algorithm 1 as printed."""
    effort_weight: Annotated[float, within(0, 1e6)] | None = None
    """R of (15), per rad^2. Unless given, (0.2 J)^2 Q for a tip that moves by J with a radian, and
    moves along the path are no effort; 0.5 with `bending = "commanded"` and `mpc-offset`."""
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
_Pose = Annotated[tuple[_MotorAngle, ...], Field(min_length=1, max_length=MOST_MOTORS)]
_Coordinate = Annotated[float, within(-10_000, 10_000)]
_Place = tuple[_Coordinate, _Coordinate, _Coordinate]


class Identified(Section):
    """Measurements of ``ccr-host calibrate``, to which `adaptive` fits its model.

    Kept as measured, one row per rest, so that they outlive changes of the model.
    """

    start_rad: _Pose
    """Motor angles before the first rest."""
    setpoint_rad: Annotated[tuple[_Pose, ...], Field(min_length=10)]
    """Motor angles of each rest, in the order of the tour."""
    from_rad: tuple[_Pose, ...] = ()
    """Motor angles from which the robot moved straight to each rest, if not those of the rest
    before it."""
    tip_mm: tuple[_Place, ...]
    """Mean measured tip position at each rest."""
    middle_mm: tuple[tuple[_Coordinate, ...], ...] = ()
    """Mean measured M2 - M1 at each rest, of more than two segments followed by M3 - M1 and so on,
    without the tip; missing in files from before December 2026, which may have M2 alone."""
    count: tuple[Annotated[int, within(1, 1e9)], ...]
    """Number of measurements behind each mean."""
    time_s: tuple[Annotated[float, within(-1e9, 1e9)], ...] = ()
    """When each rest was measured, after the first one; missing in files from before December 2026,
    whose robots count as free of creep."""
    valid_for: str
    """Digest of the geometry, the servos' pulses and the registration used for the tour."""
    date: Annotated[str, BeforeValidator(str)] = ""
    """Date of the tour."""

    @model_validator(mode="after")
    def _rows_belong_together(self) -> Identified:
        optional = (column for column in (self.from_rad, self.middle_mm, self.time_s) if column)
        columns = self.tip_mm, *optional, self.count
        if any(len(column) != len(self.setpoint_rad) for column in columns):
            raise ValueError(
                "identified.setpoint_rad, from_rad, tip_mm, middle_mm, count and time_s have "
                "different numbers of rows"
            )
        if any(len(row) % 3 or len(row) != len(self.middle_mm[0]) for row in self.middle_mm):
            raise ValueError(
                "the rows of identified.middle_mm differ in length, or are not whole places x, y, z"
            )
        if any(len(pose) != len(self.start_rad) for pose in self.setpoint_rad + self.from_rad):
            raise ValueError(
                "identified.setpoint_rad, from_rad and start_rad differ in the number of motors"
            )
        return self


class Description(Section):
    """A whole robot description."""

    name: str = "robot"
    """Name of the robot in run folders, free text."""
    robot: Robot = Robot()
    servo: Servo = Field(Servo(), validate_default=True)
    link: Link = Link()
    control: Control = Control()
    registration: Registration | None = None
    twin: Twin = Field(Twin(), validate_default=True)
    tracker: Tracker = Field(Tracker(), validate_default=True)
    polaris_faults: PolarisFaults = PolarisFaults()
    identified: Identified | None = None

    @field_validator("servo", "twin", mode="before")
    @classmethod
    def _completed_for_the_robot(cls, value: object, info: ValidationInfo) -> object:
        """Let single numbers and defaults stand for all parts of the robot."""
        robot, name = info.data.get("robot"), str(info.field_name)
        section = Servo if name == "servo" else Twin
        if robot is not None and robot.segments and isinstance(value, section):
            value = {key: getattr(value, key) for key in value.model_fields_set}
        if robot is None or not isinstance(value, dict):
            return value
        parts = {"motor": robot.motors, "segment": len(robot.chain), "tendon": len(robot.tendons)}
        return fitted(section, name, value, parts)

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
        chain = followed.pop("segments", ())
        if "tendon_radius_mm" in followed:
            radii_mm = [part.tendon_radius_mm for part in info.data["robot"].chain]
            followed["tendon_radius_mm"] = radii_mm
        expanded = type(section).model_validate(followed)
        update = {name: getattr(expanded, name) for name in followed}
        if chain:
            update["segments"] = chain
        return section.model_copy(update=update)

    @model_validator(mode="after")
    def _has_parts_as_simulated(self) -> Description:
        simulated, described = (
            {
                "segments": len(chain),
                "motors": max(tendon.motor for _, tendon in tendons_of(chain)),
                "tendons": len(tendons_of(chain)),
            }
            for chain in (self.twin.segments, self.robot.chain)
        )
        for part, count in simulated.items():
            if count != described[part]:
                raise ValueError(
                    f"twin.segments has {count} {part}, this robot has {described[part]}: they may "
                    "differ in their places, not in their numbers"
                )
        return self

    @model_validator(mode="after")
    def _was_identified_as_described(self) -> Description:
        if self.identified and len(self.identified.start_rad) != self.robot.motors:
            raise ValueError(
                f"identified.start_rad has {len(self.identified.start_rad)} values, this robot has "
                f"{self.robot.motors} motors: identify it again"
            )
        return self

    @model_validator(mode="after")
    def _bends_less_than_a_circle(self) -> Description:
        servo = self.servo
        for number, tendon in self.robot.tendons:
            axis = tendon.motor - 1
            limit_deg = max(abs(servo.angle_min_deg[axis]), abs(servo.angle_max_deg[axis]))
            radius_mm = self.robot.chain[number].tendon_radius_mm
            bent_deg = limit_deg * self.robot.pulley_radius_mm / radius_mm
            if bent_deg > _MOST_BENDING_DEG:
                raise ValueError(
                    f"a servo angle of {limit_deg:g} deg on a pulley of "
                    f"{self.robot.pulley_radius_mm:g} mm would bend a segment by {bent_deg:.0f} "
                    f"deg, {_MOST_BENDING_DEG:g} are allowed: correct robot.pulley_radius_mm or "
                    "tendon_radius_mm, or narrow servo.angle_min_deg and angle_max_deg"
                )
        return self


def load(source: str | None = None, overrides: Iterable[str] = ()) -> Description:
    """Read the description of a robot and apply overrides.

    Args:
        source: a TOML file, or the name of a shipped description; None for the default.
        overrides: ``section.key=value``, value in TOML notation.

    Raises:
        ConfigError: states the file or key, what is wrong with it, and what is allowed.
    """
    text, _ = text_and_encoding_of(source)
    tree = tree_of(text, source)
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
