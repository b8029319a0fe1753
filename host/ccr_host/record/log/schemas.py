"""Well-known schemas of Foxglove and ROS, in JSON Schema, as far as the log uses them.

Viewers know these messages by the schema's name (https://docs.foxglove.dev/docs/sdk/schemas).
"""

from __future__ import annotations

from typing import Any

from pydantic_core import SchemaValidator, core_schema

Schema = dict[str, Any]

NUMBER: Schema = {"type": "number"}
INTEGER: Schema = {"type": "integer"}
COUNT: Schema = {"type": "integer", "minimum": 0}
TEXT: Schema = {"type": "string"}
FLAG: Schema = {"type": "boolean"}
OBJECT: Schema = {"type": "object"}
_GREATEST = 2**53


def record(title: str, /, **fields: Schema) -> Schema:
    """An object that has all these fields."""
    return {"title": title, "type": "object", "properties": fields, "required": list(fields)}


def array(items: Schema, length: int | None = None) -> Schema:
    """An array of any or of a given length."""
    bounds = {} if length is None else {"minItems": length, "maxItems": length}
    return {"type": "array", "items": items, **bounds}


def nullable(schema: Schema) -> Schema:
    """The same, or null."""
    return {**schema, "type": [schema["type"], "null"]}


def described(schema: Schema, description: str) -> Schema:
    """The same, with a word on what it means."""
    return {**schema, "description": description}


def validator(schema: Schema) -> SchemaValidator:
    """Checks that what there is of a message has the right types; fields may be missing.

    Numbers are finite and integers are exact as floating-point numbers, so that whoever reads them
    may compute with them.
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
