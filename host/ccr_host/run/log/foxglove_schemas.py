"""Well-known schemas of Foxglove and ROS, in JSON Schema, as far as the log uses them.

Viewers know these messages by the schema's name (https://docs.foxglove.dev/docs/sdk/schemas).
"""

from __future__ import annotations

from ccr_host.run.log.json_schema import COUNT, FLAG, INTEGER, NUMBER, TEXT, Schema, array, record

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
