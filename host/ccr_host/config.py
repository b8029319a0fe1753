"""Robot description: load, validate, override.

One TOML file describes a robot: what the controller believes (``robot``, ``control``), the
servos and their limits (``servo``, ``link``), how the camera was found to stand
(``registration``), how the twin and its camera differ from all that (``twin``, ``tracker``), and
where the robot was found to rest (``identified``). Every key has a unit in its name and a range;
unknown keys are refused. ``--set section.key=value`` overrides one key.
"""

from __future__ import annotations

import tomllib
from collections.abc import Iterable, Mapping
from types import NoneType
from typing import Annotated, Any, Literal, get_args

from pydantic import (
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

from ccr_host.description_source import text_of
from ccr_host.errors import ConfigError

Pair = tuple[float, float]
PositivePair = tuple[Annotated[float, Field(gt=0)], Annotated[float, Field(gt=0)]]
Vector3 = tuple[float, float, float]


def _both_axes(value: object) -> object:
    """Let one number stand for both axes."""
    return (value, value) if isinstance(value, int | float) else value


def _as_in(key: str) -> dict[str, Any]:
    """Marks a key of the simulation that is taken from another section unless it is set."""
    return {"as_in": key}


def followed_key(field: FieldInfo) -> str | None:
    """The key, with its section, that a field of the simulation follows unless it is set."""
    extra = field.json_schema_extra
    return str(extra["as_in"]) if isinstance(extra, dict) and "as_in" in extra else None


class _Section(BaseModel):
    model_config = ConfigDict(
        frozen=True, extra="forbid", allow_inf_nan=False, use_attribute_docstrings=True
    )


class Robot(_Section):
    """Geometry as the controller believes it (the paper's Table I)."""

    segment_lengths_mm: PositivePair = (58.5, 43.5)
    """L_1 and L_2."""
    tendon_radius_mm: float = Field(4.5, gt=0)
    """r_c, from the cable hole to the centre of the disk."""
    marker_offset_mm: float = Field(15.0, ge=0)
    """d_m, from the centre of the disk to the marker."""
    pulley_radius_mm: float = Field(12.5, gt=0)
    """r_p of the pulley on the servo."""


class Servo(_Section):
    """The two servos as the board drives them; index 0 bends segment 1."""

    angle_min_deg: Annotated[Pair, BeforeValidator(_both_axes)] = (-85.0, -85.0)
    """Lower limit of the commanded angle."""
    angle_max_deg: Annotated[Pair, BeforeValidator(_both_axes)] = (85.0, 85.0)
    """Upper limit of the commanded angle."""
    rest_deg: Annotated[Pair, BeforeValidator(_both_axes)] = (0.0, 0.0)
    """Where the board brings the servo when the host stays silent."""
    slew_deg_s: Annotated[PositivePair, BeforeValidator(_both_axes)] = (300.0, 300.0)
    """The board's own limit on the commanded rate."""
    neutral_pulse_us: Annotated[PositivePair, BeforeValidator(_both_axes)] = (1500.0, 1500.0)
    """Pulse width at 0 deg."""
    pulse_per_90_deg_us: Annotated[Pair, BeforeValidator(_both_axes)] = (1000.0, 1000.0)
    """Pulse change for +90 deg; negative for a servo that turns the other way."""
    pulse_min_us: Annotated[PositivePair, BeforeValidator(_both_axes)] = (500.0, 500.0)
    """Shortest pulse that may leave the board, whatever the angle."""
    pulse_max_us: Annotated[PositivePair, BeforeValidator(_both_axes)] = (2500.0, 2500.0)
    """Longest pulse that may leave the board, whatever the angle."""

    @model_validator(mode="after")
    def _limits_are_ordered(self) -> Servo:
        for axis in (0, 1):
            if not self.angle_min_deg[axis] < self.angle_max_deg[axis]:
                raise ValueError(f"angle_min_deg must lie below angle_max_deg (axis {axis + 1})")
            if not self.angle_min_deg[axis] <= self.rest_deg[axis] <= self.angle_max_deg[axis]:
                raise ValueError(f"rest_deg must lie between the angle limits (axis {axis + 1})")
            if not self.pulse_min_us[axis] < self.pulse_max_us[axis]:
                raise ValueError(f"pulse_min_us must lie below pulse_max_us (axis {axis + 1})")
            if self.pulse_per_90_deg_us[axis] == 0:
                raise ValueError(f"pulse_per_90_deg_us must not be 0 (axis {axis + 1})")
        return self


class Link(_Section):
    """Staged reaction of the board to a silent host."""

    baud: int = Field(250_000, gt=0)
    """Bit rate of the serial port."""
    target_validity_periods: float = Field(2.5, gt=1)
    """A target stays fresh for this many control periods; then the board holds its pose."""
    relax_after_ms: int = Field(2000, ge=20, le=60_000)
    """From hold to the slow return to the rest pose."""
    relax_slew_deg_s: float = Field(30.0, ge=5)
    """Rate of that return."""
    arm_axis_ms: int = Field(300, ge=20, le=5000)
    """Between enabling one servo and the next."""


class Control(_Section):
    """The paper's controller (Section IV-A); angles read as radians, see docs."""

    horizon: int = Field(4, ge=2, le=100)
    """N of (14)."""
    position_weight: float = Field(1.0, gt=0)
    """Q of (15), per mm^2."""
    effort_weight: float = Field(0.5, ge=0)
    """R of (15), per rad^2."""
    step_bound_rad: float = Field(2.0, gt=0)
    """|u| of (15), per control step."""
    solver: Literal["daqp", "compiled"] = "daqp"
    """`compiled`: `mpc` and the model of `adaptive` in machine code (extra `fast`)."""
    settle_s: float = Field(2.0, ge=0)
    """From the first command to the start of the path's clock."""
    stale_after_ms: int = Field(250, ge=1)
    """A sample older than this counts as lost."""
    coast_s: float = Field(2.0, ge=0)
    """For so long without markers the controller goes on with its model alone."""
    hold_s: float = Field(3.0, ge=0)
    """For so long after that the pose is held; then the run ends and the robot is disarmed."""


class Push(_Section):
    """A force on the tip over a span of the run's time."""

    force_n: Vector3
    """Along x, y, z of (10), on the centre of the last disk."""
    start_s: float = Field(ge=0)
    """Of the path's clock."""
    end_s: float = Field(ge=0)
    """Of the path's clock."""

    @model_validator(mode="after")
    def _ends_after_its_start(self) -> Push:
        if not self.start_s < self.end_s:
            raise ValueError("start_s must lie below end_s")
        return self


class Twin(_Section):
    """The simulated robot; docs/twin.md tells how each default was chosen."""

    flexures: tuple[Annotated[int, Field(ge=1, le=40)], Annotated[int, Field(ge=1, le=40)]] = (6, 5)
    """Hinges of each segment, evenly spaced."""
    segment_lengths_mm: PositivePair = Field(
        (58.5, 43.5), json_schema_extra=_as_in("robot.segment_lengths_mm")
    )
    """True L_1 and L_2."""
    tendon_radius_mm: float = Field(4.5, gt=0, json_schema_extra=_as_in("robot.tendon_radius_mm"))
    """True r_c."""
    marker_offset_mm: float = Field(15.0, ge=0, json_schema_extra=_as_in("robot.marker_offset_mm"))
    """True d_m."""
    pulley_radius_mm: float = Field(12.5, gt=0, json_schema_extra=_as_in("robot.pulley_radius_mm"))
    """True r_p."""
    bending_stiffness_nm_rad: Annotated[PositivePair, BeforeValidator(_both_axes)] = (0.02, 0.02)
    """Of a whole segment: its moment over its total bending angle."""
    joint_damping: float = Field(2e-4, ge=0)
    """Of each flexure, N m s/rad."""
    friction: float = Field(0.0, ge=0)
    """Dry friction of each tendon, N."""
    disk_mass_g: float = Field(0.8, gt=0)
    """Of each disk; there are as many as flexures."""
    marker_mass_g: float = Field(3.0, gt=0)
    """Of each of the two moving markers."""
    payload_g: float = Field(0.0, ge=0)
    """Mass on the centre of the last disk."""
    payload_start_s: float = Field(0.0, ge=0)
    """When the payload is hung on, on the path's clock; 0: it is there from power-up."""
    slack_mm: float = Field(1.2, ge=0)
    """Excess length of each tendon at rest."""
    tendon_stiffness_n_m: float = Field(4000.0, gt=0)
    """Pull of a taut tendon over its stretch."""
    tendon_force_max_n: float = Field(60.0, gt=0)
    """A tendon never pulls harder."""
    servo_rate_deg_s: float = Field(300.0, gt=0)
    """Speed at which the shaft turns towards its goal."""
    servo_deadband_deg: float = Field(0.0, ge=0)
    """The shaft rests while its goal is no further away."""
    servo_neutral_us: Annotated[PositivePair, BeforeValidator(_both_axes)] = Field(
        (1500.0, 1500.0), json_schema_extra=_as_in("servo.neutral_pulse_us")
    )
    """True pulse width at which the shaft stands at 0 deg."""
    servo_us_per_90_deg: Annotated[Pair, BeforeValidator(_both_axes)] = Field(
        (1000.0, 1000.0), json_schema_extra=_as_in("servo.pulse_per_90_deg_us")
    )
    """True pulse change for +90 deg; negative for a servo that turns the other way."""
    gravity_m_s2: float = 9.81
    """Along -z; negative hangs the robot upside down."""
    push: Push | None = None
    """A force on the tip, as a table: {force_n = [0, 0, 0.1], start_s = 10, end_s = 12}."""
    time_step_ms: float = Field(0.5, gt=0, le=2)
    """Longest step of the physics; stiff or light robots take a shorter one by themselves."""

    @model_validator(mode="after")
    def _servos_turn(self) -> Twin:
        if 0 in self.servo_us_per_90_deg:
            raise ValueError("servo_us_per_90_deg must not be 0")
        return self


def _rotation(value: object) -> object:
    """One number turns about the axis (1, 1, 1); three are a rotation vector."""
    return (float(value) / 3**0.5,) * 3 if isinstance(value, int | float) else value


class Tracker(_Section):
    """The camera: as the twin simulates it, and what a real one needs."""

    noise_mm: float = Field(0.25, ge=0)
    """RMS length of the error of the measured vector M3 - M1."""
    rate_hz: float = Field(20.0, gt=0, le=1000)
    """Exposures a second."""
    latency_ms: float = Field(40.0, ge=0)
    """From an exposure to the earliest time at which the host can have it; of a real camera too."""
    dropout: float = Field(0.0, ge=0, lt=1)
    """Share of exposures without a sample."""
    rotation_deg: Annotated[Vector3, BeforeValidator(_rotation)] = Field(
        (0.0, 0.0, 0.0), json_schema_extra=_as_in("registration.camera_to_robot_deg")
    )
    """Rotation vector of the camera's frame against the robot's.

    One number turns it about the axis (1, 1, 1). Only simulated cameras are turned; unless told
    otherwise they stand as the registration says, so that nothing is left to correct.
    """
    tool_files: dict[str, str] = Field(default_factory=dict)
    """Tool definitions (.rom) of a Polaris by name: M1, M2, M3 stand for the markers, any other
    one only lights the illuminators."""
    camera_file: str | None = None
    """Calibration of a webcam, as OpenCV or ROS writes it."""
    tag_size_mm: float | None = Field(None, gt=0)
    """Edge of the tags under a webcam."""


_Probability = Annotated[float, Field(ge=0, le=1)]
_Span = tuple[Annotated[float, Field(ge=0)], Annotated[float, Field(ge=0)]]
"""From and to, s."""


class PolarisFaults(_Section):
    """What goes wrong with the emulated Polaris; times in s on the path's clock.

    Behind ``ccr-host emulate`` they count from its start.
    """

    shuffle: bool = False
    """Stray markers come in random order."""
    phantoms: int = Field(0, ge=0, le=40)
    """So many points a frame that are no marker."""
    occlusion: _Probability = 0.0
    """Probability that a marker is hidden in an exposure, each by itself."""
    bad_crc: _Probability = 0.0
    """Probability that a reply is damaged on its way."""
    occluded_s: tuple[_Span, ...] = ()
    """Spans in which all markers are hidden, e.g. [[10, 12], [30, 31]]."""
    out_of_volume_s: tuple[_Span, ...] = ()
    """Spans in which the scene is beyond the far end of the volume."""
    silent_s: tuple[_Span, ...] = ()
    """Spans in which the camera hears nothing."""
    unplugged_s: tuple[_Span, ...] = ()
    """Spans in which its port is gone."""
    reset_s: tuple[Annotated[float, Field(ge=0)], ...] = ()
    """When its power fails for a moment."""


class Registration(_Section):
    """How the camera stands, as ``ccr-host register`` has found out."""

    camera_to_robot_deg: Vector3
    """Rotation vector R: a vector v of the camera's frame is R v in that of (10)."""
    uncertainty_deg: Vector3 | None = None
    """Standard deviation about x, y and z of (10)."""
    residual_mm: float | None = Field(None, ge=0)
    """RMS distance of the markers from the fitted shapes."""
    scale: float | None = Field(None, gt=0)
    """Measured over believed length of segment 2."""
    date: Annotated[str, BeforeValidator(str)] = ""
    """Of the registration."""


class Identified(_Section):
    """What ``ccr-host calibrate --identify`` has measured; `adaptive` fits its model to it.

    Kept as measured, one row a rest, so that it outlives changes of the model.
    """

    start_rad: Pair
    """Motor angles that the tour came from."""
    setpoint_rad: Annotated[tuple[Pair, ...], Field(min_length=10)]
    """Motor angles of each rest, in the order of the tour."""
    tip_mm: tuple[Vector3, ...]
    """Mean of the tip measured at each rest."""
    count: tuple[Annotated[int, Field(ge=1)], ...]
    """Of the measurements behind each mean."""
    valid_for: str
    """Digest of the geometry, the servos' pulses and the registration that it was made with."""
    date: Annotated[str, BeforeValidator(str)] = ""
    """Of the tour."""

    @model_validator(mode="after")
    def _rows_belong_together(self) -> Identified:
        if not len(self.setpoint_rad) == len(self.tip_mm) == len(self.count):
            raise ValueError("setpoint_rad, tip_mm and count need a row for each rest")
        return self


class Description(_Section):
    """A whole robot description."""

    name: str = "paper"
    """Free text that names the robot in run folders."""
    robot: Robot = Robot()
    servo: Servo = Servo()
    link: Link = Link()
    control: Control = Control()
    registration: Registration | None = None
    twin: Twin = Field(Twin(), validate_default=True)
    tracker: Tracker = Field(Tracker(), validate_default=True)
    polaris_faults: PolarisFaults = PolarisFaults()
    identified: Identified | None = None

    @field_validator("twin", "tracker", mode="after")
    @classmethod
    def _simulated_as_described(cls, section: _Section, info: ValidationInfo) -> _Section:
        """Without hardware a user's robot is simulated, not the paper's."""
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
        ConfigError: names the file or key, what is wrong with it, and what is allowed.
    """
    tree = _tree(text_of(source), source)
    for override in overrides:
        _apply(tree, override)
    return _validated(tree, source)


def parse(text: str) -> Description:
    """A description from its TOML text.

    Raises:
        ConfigError: see :func:`load`.
    """
    return _validated(_tree(text, None), None)


def _validated(tree: dict[str, Any], source: str | None) -> Description:
    try:
        return Description.model_validate(tree)
    except ValidationError as error:
        raise ConfigError(*_explain(error, source)) from None


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


def _explain(error: ValidationError, source: str | None) -> tuple[str, str]:
    first = error.errors()[0]
    key = ".".join(str(part) for part in first["loc"]) or "description"
    more = f" (and {error.error_count() - 1} more)" if error.error_count() > 1 else ""
    where = f" in {source}" if source else ""
    if first["type"] == "extra_forbidden":
        return f"unknown key {key}{where}{more}", f"known: {', '.join(_siblings(first['loc']))}"
    shown = first["input"] if not isinstance(first["input"], Mapping) else "these values"
    message = first["msg"].removeprefix("Value error, ")
    return f"{key} = {shown}{where}: {message}{more}", "see docs/robot-description.md for ranges"


def _siblings(location: tuple[int | str, ...]) -> list[str]:
    model: Any = Description
    for part in location[:-1]:
        model = section_model(model.model_fields[part].annotation)
    return sorted(model.model_fields)


def section_model(annotation: Any) -> Any:  # noqa: ANN401 - pydantic's annotations
    """The section behind an annotation, also where the section may be left out."""
    return next((part for part in get_args(annotation) if part is not NoneType), annotation)
