"""What a log consists of: its topics and the schemas of their messages.

All messages are JSON. Lengths in ours are mm, angles rad, times us on the run's clock, as in the
rest of the host; Foxglove's own are metres. Viewers know the messages of Foxglove and ROS by the
schema's name (https://docs.foxglove.dev/docs/sdk/schemas), of which those here hold as much as the
log uses. Foxglove's Python packages carry them for Protobuf and FlatBuffers alone.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

from pydantic_core import SchemaValidator, core_schema

from ccr_host.control.base import Outcome
from ccr_host.description.schema import Robot

Schema = dict[str, Any]

NUMBER: Schema = {"type": "number"}
INTEGER: Schema = {"type": "integer"}
COUNT: Schema = {"type": "integer", "minimum": 0}
TEXT: Schema = {"type": "string"}
FLAG: Schema = {"type": "boolean"}
OBJECT: Schema = {"type": "object"}
_GREATEST = 2**53
_MOTORS, _MARKERS = "motors", "markers"
"""Lengths of arrays that depend on the robot."""


def record(title: str, /, **fields: Schema) -> Schema:
    """An object that has all these fields."""
    return {"title": title, "type": "object", "properties": fields, "required": list(fields)}


def array(items: Schema, length: int | str | None = None) -> Schema:
    """An array of any length, of a given one, or of one that depends on the robot."""
    bounds = {} if length is None else {"minItems": length, "maxItems": length}
    return {"type": "array", "items": items, **bounds}


def nullable(schema: Schema) -> Schema:
    """The same schema, or null."""
    return {**schema, "type": [schema["type"], "null"]}


def described(schema: Schema, description: str) -> Schema:
    """The same schema with a description."""
    return {**schema, "description": description}


def validator(schema: Schema) -> SchemaValidator:
    """Checks that what there is of a message has the right types; fields may be missing.

    Numbers are finite, and integers are exactly representable as floating-point numbers, so readers
    can compute with them.
    """
    return SchemaValidator(_core(schema))


def _core(schema: Schema) -> core_schema.CoreSchema:
    kind = schema["type"]
    if isinstance(kind, list):
        return core_schema.nullable_schema(_core({**schema, "type": kind[0]}))
    if kind == "object":
        fields = {
            name: core_schema.typed_dict_field(_core(field), required=False)
            for name, field in schema.get("properties", {}).items()
        }
        return core_schema.typed_dict_schema(fields, extra_behavior="allow")
    if kind == "array":
        return core_schema.list_schema(
            _core(schema["items"]),
            min_length=schema.get("minItems"),
            max_length=schema.get("maxItems"),
            strict=True,
        )
    if "enum" in schema:
        return core_schema.literal_schema(schema["enum"])
    bounds = {"ge": schema.get("minimum", -_GREATEST), "le": schema.get("maximum", _GREATEST)}
    return {
        "number": core_schema.float_schema(**bounds, strict=True),
        "integer": core_schema.int_schema(**bounds, strict=True),
        "boolean": core_schema.bool_schema(strict=True),
        "string": core_schema.str_schema(strict=True),
    }[kind]


_NANOSECONDS: Schema = {"type": "integer", "minimum": 0, "maximum": 999_999_999}
TIME = record("time", sec=COUNT, nsec=_NANOSECONDS)
DURATION = record("duration", sec=INTEGER, nsec=_NANOSECONDS)
VECTOR3 = record("foxglove.Vector3", x=NUMBER, y=NUMBER, z=NUMBER)
POINT3 = record("foxglove.Point3", x=NUMBER, y=NUMBER, z=NUMBER)
QUATERNION = record("foxglove.Quaternion", x=NUMBER, y=NUMBER, z=NUMBER, w=NUMBER)
COLOR = record("foxglove.Color", r=NUMBER, g=NUMBER, b=NUMBER, a=NUMBER)
POSE = record("foxglove.Pose", position=VECTOR3, orientation=QUATERNION)
KEY_VALUE_PAIR = record("foxglove.KeyValuePair", key=TEXT, value=TEXT)

LOG = record(
    "foxglove.Log", timestamp=TIME, level=COUNT, message=TEXT, name=TEXT, file=TEXT, line=COUNT
)
POSE_IN_FRAME = record("foxglove.PoseInFrame", timestamp=TIME, frame_id=TEXT, pose=POSE)
FRAME_TRANSFORMS = record(
    "foxglove.FrameTransforms",
    transforms=array(
        record(
            "foxglove.FrameTransform",
            timestamp=TIME,
            parent_frame_id=TEXT,
            child_frame_id=TEXT,
            translation=VECTOR3,
            rotation=QUATERNION,
        )
    ),
)

_SPHERE = record("foxglove.SpherePrimitive", pose=POSE, size=VECTOR3, color=COLOR)
_LINE = record(
    "foxglove.LinePrimitive",
    type=COUNT,
    pose=POSE,
    thickness=NUMBER,
    scale_invariant=FLAG,
    points=array(POINT3),
    color=COLOR,
    colors=array(COLOR),
    indices=array(COUNT),
)
_UNUSED = array({"type": "object"})
_ENTITY = record(
    "foxglove.SceneEntity",
    timestamp=TIME,
    frame_id=TEXT,
    id=TEXT,
    lifetime=DURATION,
    frame_locked=FLAG,
    metadata=array(KEY_VALUE_PAIR),
    arrows=_UNUSED,
    cubes=_UNUSED,
    spheres=array(_SPHERE),
    cylinders=_UNUSED,
    lines=array(_LINE),
    triangles=_UNUSED,
    texts=_UNUSED,
    models=_UNUSED,
)
_DELETION = record("foxglove.SceneEntityDeletion", timestamp=TIME, type=COUNT, id=TEXT)
SCENE_UPDATE = record("foxglove.SceneUpdate", deletions=array(_DELETION), entities=array(_ENTITY))

_KEY_VALUE = record("diagnostic_msgs/KeyValue", key=TEXT, value=TEXT)
_STATUS = record(
    "diagnostic_msgs/DiagnosticStatus",
    level=COUNT,
    name=TEXT,
    message=TEXT,
    hardware_id=TEXT,
    values=array(_KEY_VALUE),
)
_HEADER = record("std_msgs/Header", seq=COUNT, stamp=TIME, frame_id=TEXT)
DIAGNOSTIC_ARRAY = record("diagnostic_msgs/DiagnosticArray", header=_HEADER, status=array(_STATUS))

_POINT_MM = described(array(NUMBER, 3), "f of (10): y, x and z of a path, in this order")
_ANGLES_RAD = array(NUMBER, _MOTORS)
_TIME_US = described(INTEGER, "on the run's clock")
_OUTCOME: Schema = {"type": "string", "enum": [outcome.value for outcome in Outcome]}


@dataclass(frozen=True, eq=False)
class Topic:
    """One kind of message."""

    name: str
    form: Schema
    """Its schema, with names for the lengths that depend on the robot."""
    repeated: bool = False
    """Whether every file of a log begins with it, so that each can be read alone."""
    sizes: Mapping[str, int] = field(default_factory=dict)
    """Those lengths; arrays whose length is not among them may have any."""

    @property
    def schema_name(self) -> str:
        """Name by which a viewer knows the schema."""
        title: str = self.form["title"]
        return title

    @cached_property
    def schema(self) -> Schema:
        return _sized(self.form, self.sizes)

    def is_message(self, content: object) -> bool:
        """Whether content is of the types that the schema names."""
        return self._validator.isinstance_python(content)

    @cached_property
    def _validator(self) -> SchemaValidator:
        return validator(self.schema)


def _sized(schema: Schema, sizes: Mapping[str, int]) -> Schema:
    """A schema with the lengths in place of their names."""
    found: Schema = {}
    for key, value in schema.items():
        if isinstance(value, dict):
            found[key] = _sized(value, sizes)
        elif key in ("minItems", "maxItems") and isinstance(value, str):
            if value in sizes:
                found[key] = sizes[value]
        elif key == "description":
            names = [f"M{number + 1}" for number in range(sizes.get(_MARKERS, 0))]
            found[key] = value.replace("{markers}", ", ".join(names))
        else:
            found[key] = value
    return found


_REFERENCE = record(
    "ccr.ReferenceSummary",
    name=TEXT,
    period_s=NUMBER,
    samples=COUNT,
    laps={"type": "integer", "minimum": 1},
)

SETUP = Topic(
    "/run/setup",
    record(
        "ccr.RunSetup", versions=OBJECT, options=OBJECT, description=OBJECT, reference=_REFERENCE
    ),
    repeated=True,
)
REFERENCE = Topic(
    "/run/reference",
    record(
        "ccr.Reference",
        time_s=array(NUMBER),
        target_mm=array(_POINT_MM),
        q_rad=array(_ANGLES_RAD),
        unavoidable_mm=array(NUMBER),
    ),
)
EVENT = Topic("/run/event", LOG)
INPUTS = Topic(
    "/run/inputs",
    record(
        "ccr.Inputs",
        start_us=_TIME_US,
        tokens=described(TEXT, "one letter an input, see docs/logs.md"),
        steps_us=described(array(INTEGER), "differences of the times that tokens carry"),
        errors=array(record("ccr.InputError", kind=TEXT, cause=TEXT, cure=TEXT)),
    ),
)
_FRAME = record("ccr.Frame", name=TEXT, sequence=COUNT, hex=described(TEXT, "as on the wire"))
SENT = Topic("/link/sent", _FRAME)
RECEIVED = Topic("/link/received", _FRAME)
STATE = Topic(
    "/board/state",
    record(
        "ccr.StateReport",
        tick=COUNT,
        state=TEXT,
        fault=TEXT,
        flags=COUNT,
        target_sequence=COUNT,
        target_age_ms=COUNT,
        target_cdeg=array(INTEGER, _MOTORS),
        setpoint_cdeg=array(INTEGER, _MOTORS),
        pulse_half_us=array(INTEGER, _MOTORS),
        link_errors=COUNT,
        free_stack_bytes=COUNT,
        supply_dv=COUNT,
    ),
)
MARKER_FRAME = Topic(
    "/tracker/frame",
    record(
        "ccr.MarkerFrame",
        exposed_us=_TIME_US,
        frame_number=INTEGER,
        points_mm=array(_POINT_MM),
        out_of_volume=array(FLAG),
        tools=described(OBJECT, "position_mm, quaternion (w, x, y, z) and error_mm by name"),
    ),
)
SAMPLE = Topic(
    "/tracker/sample",
    record(
        "ccr.Sample",
        exposed_us=_TIME_US,
        markers_mm=described(
            array(array(nullable(NUMBER), 3), _MARKERS), "{markers}; null where lost"
        ),
    ),
)
CONTROL = Topic(
    "/control/command",
    record(
        "ccr.Control",
        step=nullable(INTEGER),
        tip_mm=nullable(_POINT_MM),
        tip_age_us=nullable(INTEGER),
        accepted_rad=nullable(_ANGLES_RAD),
        command_rad=_ANGLES_RAD,
        ramp_s=NUMBER,
        predicted_mm=array(_POINT_MM),
        outcome=_OUTCOME,
        detail=TEXT,
        iterations=nullable(INTEGER),
    ),
)
STEP = Topic(
    "/control/step",
    record(
        "ccr.Step",
        step=COUNT,
        time_s=described(NUMBER, "on the path's clock"),
        target_mm=_POINT_MM,
        q_rad=_ANGLES_RAD,
        outcome=_OUTCOME,
        detail=TEXT,
        late=FLAG,
        measured_mm=nullable(_POINT_MM),
        measured_age_us=nullable(INTEGER),
        true_mm=nullable(_POINT_MM),
        error_mm=nullable(NUMBER),
        solve_us=described(nullable(NUMBER), "in real time; in virtual time in separate files"),
    ),
)
POSE_MEASURED = Topic("/pose/measured", POSE_IN_FRAME)
POSE_DESIRED = Topic("/pose/desired", POSE_IN_FRAME)
TRANSFORMS = Topic("/tf", FRAME_TRANSFORMS)
DESIRED_PATH = Topic("/scene/path", SCENE_UPDATE, repeated=True)
SCENE = Topic("/scene/robot", SCENE_UPDATE)
DIAGNOSTICS = Topic("/diagnostics", DIAGNOSTIC_ARRAY)

LOG_TOPICS = (
    SETUP, REFERENCE, EVENT, INPUTS, SENT, RECEIVED, STATE, MARKER_FRAME, SAMPLE,
    CONTROL, STEP, POSE_MEASURED, POSE_DESIRED, TRANSFORMS, DESIRED_PATH, SCENE, DIAGNOSTICS,
)  # fmt: skip


def topics_of(robot: Robot) -> tuple[Topic, ...]:
    """The topics of a robot's log."""
    sizes = {_MOTORS: robot.motors, _MARKERS: len(robot.markers)}
    return tuple(replace(topic, sizes=sizes) for topic in LOG_TOPICS)


SOLVE_TIME = Topic("/timing/solve", record("ccr.SolveTime", step=COUNT, solve_us=NUMBER))
TIMING_TOPICS = (SOLVE_TIME,)
"""Machine timings. They go into separate files where everything else repeats with the seed."""
