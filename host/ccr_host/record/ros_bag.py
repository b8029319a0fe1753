"""The log of a run as a bag of ROS 2, in MCAP storage; no ROS is needed.

Topics are named after the CRTK convention (https://collaborative-robotics.github.io): ``_js`` joint
states, ``_cp`` Cartesian positions. The frame is ``robot``, that of (10), in metres; stamps are
times of the run's clock, which starts at 0. Hobby servos report no angle, so there is no
``measured_js``.

The robot itself is in it as URDF. That has rigid links only, so the segments are drawn straight,
one cylinder each, and bend nowhere.
"""

from __future__ import annotations

import json
import math
import re
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any
from xml.sax.saxutils import quoteattr

from ccr_host.core.errors import why
from ccr_host.core.plugins import import_optional
from ccr_host.core.user_file import replacing
from ccr_host.core.wire import cdeg_to_rad
from ccr_host.description.schema import Description
from ccr_host.record.folder import unwritable
from ccr_host.record.log import topics
from ccr_host.record.log.reader import LogMessage, RunRecording
from ccr_host.record.log.visuals import ROBOT_FRAME, UPRIGHT

Json = dict[str, Any]

NAMESPACE = "/ccr"
BAG_FILE, METADATA_FILE = "run_0.mcap", "metadata.yaml"
_VERSION = 5
"""Version of the metadata: that of ROS 2 Humble, which later ones read."""

_DEFINITIONS = {
    "builtin_interfaces/Time": "int32 sec\nuint32 nanosec",
    "std_msgs/Header": "builtin_interfaces/Time stamp\nstring frame_id",
    "std_msgs/String": "string data",
    "geometry_msgs/Point": "float64 x\nfloat64 y\nfloat64 z",
    "geometry_msgs/Vector3": "float64 x\nfloat64 y\nfloat64 z",
    "geometry_msgs/Quaternion": "float64 x\nfloat64 y\nfloat64 z\nfloat64 w",
    "geometry_msgs/Pose": "geometry_msgs/Point position\ngeometry_msgs/Quaternion orientation",
    "geometry_msgs/PoseStamped": "std_msgs/Header header\ngeometry_msgs/Pose pose",
    "geometry_msgs/Transform": (
        "geometry_msgs/Vector3 translation\ngeometry_msgs/Quaternion rotation"
    ),
    "geometry_msgs/TransformStamped": (
        "std_msgs/Header header\nstring child_frame_id\ngeometry_msgs/Transform transform"
    ),
    "nav_msgs/Path": "std_msgs/Header header\ngeometry_msgs/PoseStamped[] poses",
    "tf2_msgs/TFMessage": "geometry_msgs/TransformStamped[] transforms",
    "sensor_msgs/JointState": (
        "std_msgs/Header header\nstring[] name\n"
        "float64[] position\nfloat64[] velocity\nfloat64[] effort"
    ),
    "diagnostic_msgs/KeyValue": "string key\nstring value",
    "diagnostic_msgs/DiagnosticStatus": (
        "byte OK=0\nbyte WARN=1\nbyte ERROR=2\nbyte STALE=3\nbyte level\nstring name\n"
        "string message\nstring hardware_id\ndiagnostic_msgs/KeyValue[] values"
    ),
    "diagnostic_msgs/DiagnosticArray": (
        "std_msgs/Header header\ndiagnostic_msgs/DiagnosticStatus[] status"
    ),
}
"""The messages of ROS 2's common interfaces that are written, as their .msg files have them."""


def write_bag(recording: RunRecording, folder: Path) -> dict[str, int]:
    """Write a bag: one file with all messages, and the metadata that make it one.

    Returns:
        The number of messages by topic.

    Raises:
        ConfigError: a file cannot be written, the log cannot be read, or a package is missing.
    """
    ros2: Any = import_optional("mcap_ros2.writer", "ros", "--format rosbag2")
    counts: Counter[str] = Counter()
    types: dict[str, str] = {}
    last_us = 0
    try:
        with replacing(folder / BAG_FILE) as draft, draft.open("wb") as file:
            writer = ros2.Writer(file)
            schemas: dict[str, Any] = {}
            for time_us, topic, kind, message in _messages(recording):
                if kind not in schemas:
                    full_name = kind.replace("/", "/msg/")
                    schemas[kind] = writer.register_msgdef(full_name, _definition(kind))
                writer.write_message(topic, schemas[kind], message, time_us * 1000)
                types[topic] = kind
                counts[topic] += 1
                last_us = max(last_us, time_us)
            writer.finish()
        with replacing(folder / METADATA_FILE) as draft:
            draft.write_text(_metadata(counts, types, last_us * 1000), encoding="utf-8")
    except OSError as error:
        raise unwritable(folder, why(error)) from None
    return dict(counts)


def _messages(recording: RunRecording) -> Iterator[tuple[int, str, str, Json]]:
    """Time in us, topic, type and content of each message."""
    yield 0, "/robot_description", "std_msgs/String", {"data": urdf_of(recording.description)}
    yield (
        0,
        f"{NAMESPACE}/desired_path",
        "nav_msgs/Path",
        {
            "header": _header(0),
            "poses": [_pose_stamped(0, f_mm) for f_mm in recording.reference.target_mm.tolist()],
        },
    )
    for message in recording.messages(*_MAKERS):
        for made in _MAKERS[_TOPICS[message.topic]](message):
            yield message.time_us, *made


Made = tuple[str, str, Json]


def _state(message: LogMessage) -> Iterator[Made]:
    setpoint_rad = cdeg_to_rad(message.content["setpoint_cdeg"]).tolist()
    yield _joints(message.time_us, "setpoint_js", setpoint_rad)


def _control(message: LogMessage) -> Iterator[Made]:
    yield _joints(message.time_us, "servo_jp", message.content["command_rad"])


def _sample(message: LogMessage) -> Iterator[Made]:
    exposed_us = max(0, message.content["exposed_us"])
    markers_mm = message.content["markers_mm"]
    base_mm = markers_mm[0]
    seen = {
        f"m{number}": [coordinate - base for coordinate, base in zip(at, base_mm, strict=True)]
        for number, at in enumerate(markers_mm, 1)
        if None not in (*at, *base_mm)
    }
    if tip_mm := seen.get(f"m{len(markers_mm)}"):
        yield (
            f"{NAMESPACE}/measured_cp",
            "geometry_msgs/PoseStamped",
            _pose_stamped(exposed_us, tip_mm),
        )
    transforms = [
        {
            "header": _header(exposed_us),
            "child_frame_id": name,
            "transform": {"translation": _metres(at_mm), "rotation": UPRIGHT},
        }
        for name, at_mm in seen.items()
    ]
    if transforms:
        yield "/tf", "tf2_msgs/TFMessage", {"transforms": transforms}


def _step(message: LogMessage) -> Iterator[Made]:
    wanted = _pose_stamped(message.time_us, message.content["target_mm"])
    yield f"{NAMESPACE}/setpoint_cp", "geometry_msgs/PoseStamped", wanted


def _diagnostics(message: LogMessage) -> Iterator[Made]:
    statuses = message.content["status"]
    content = {"header": _header(message.time_us, ""), "status": statuses}
    yield "/diagnostics", "diagnostic_msgs/DiagnosticArray", content


_MAKERS: dict[topics.Topic, Callable[[LogMessage], Iterator[Made]]] = {
    topics.STATE: _state,
    topics.CONTROL: _control,
    topics.SAMPLE: _sample,
    topics.STEP: _step,
    topics.DIAGNOSTICS: _diagnostics,
}
_TOPICS = {topic.name: topic for topic in _MAKERS}


def _joints(time_us: int, name: str, angles_rad: Sequence[float]) -> Made:
    content = {
        "header": _header(time_us),
        "name": [f"motor_{number}" for number in range(1, len(angles_rad) + 1)],
        "position": list(angles_rad),
        "velocity": [],
        "effort": [],
    }
    return f"{NAMESPACE}/{name}", "sensor_msgs/JointState", content


def _pose_stamped(time_us: int, position_mm: Sequence[float]) -> Json:
    pose = {"position": _metres(position_mm), "orientation": UPRIGHT}
    return {"header": _header(time_us), "pose": pose}


def _metres(position_mm: Sequence[float]) -> Json:
    return {axis: mm * 1e-3 for axis, mm in zip("xyz", position_mm, strict=True)}


def _header(time_us: int, frame: str = ROBOT_FRAME) -> Json:
    stamp = {"sec": time_us // 1_000_000, "nanosec": time_us % 1_000_000 * 1000}
    return {"stamp": stamp, "frame_id": frame}


def _definition(kind: str) -> str:
    """A type's .msg text followed by those of all types in it, as MCAP wants it."""
    texts, open_kinds, done = [_DEFINITIONS[kind]], [kind], {kind}
    while open_kinds:
        for inner in re.findall(r"^(\w+/\w+)", _DEFINITIONS[open_kinds.pop()], re.M):
            if inner not in done:
                done.add(inner)
                open_kinds.append(inner)
                texts.append(f"{'=' * 80}\nMSG: {inner}\n{_DEFINITIONS[inner]}")
    return "\n".join(texts) + "\n"


def _metadata(counts: Counter[str], types: dict[str, str], duration_ns: int) -> str:
    """Metadata of the bag, as JSON, which every reader of YAML takes."""
    span = {
        "duration": {"nanoseconds": duration_ns},
        "starting_time": {"nanoseconds_since_epoch": 0},
        "message_count": counts.total(),
    }
    described = [
        {
            "topic_metadata": {
                "name": topic,
                "type": kind.replace("/", "/msg/"),
                "serialization_format": "cdr",
                "offered_qos_profiles": "",
            },
            "message_count": counts[topic],
        }
        for topic, kind in types.items()
    ]
    information = {
        "version": _VERSION,
        "storage_identifier": "mcap",
        "relative_file_paths": [BAG_FILE],
        **span,
        "topics_with_message_count": described,
        "compression_format": "",
        "compression_mode": "",
        "files": [{"path": BAG_FILE, **span}],
    }
    return json.dumps({"rosbag2_bagfile_information": information}, indent=2) + "\n"


_ALONG = f"{math.pi / 2:.9f} 0 0"
"""Turns the z axis of a cylinder, and of each segment's frame, along the backbone: -y of (10)."""
_GREY = '<material name="nylon"><color rgba="0.8 0.8 0.8 1"/></material>'


def urdf_of(description: Description) -> str:
    """URDF in metres; the root is ``robot``, the frame of (10) with its origin in marker 1.

    ``base`` is the start of the backbone with its z axis along it, ``segment_1_end`` and so on the
    ends of the segments; the last one is the tip.
    """
    robot = description.robot
    bodies = [(segment.length_mm, segment.tendon_radius_mm) for segment in robot.chain]
    name = quoteattr(robot.board_name or "continuum_robot")
    parts = [f"<robot name={name}>", f'  <link name="{ROBOT_FRAME}"/>']
    parts += _fixed(ROBOT_FRAME, "base", (0.0, 0.0, -robot.marker_offset_mm), _ALONG)
    start = "base"
    for number, (length_mm, radius_mm) in enumerate(bodies, 1):
        end = f"segment_{number}_end"
        parts += _link(start, length_mm, radius_mm)
        parts += _fixed(start, end, (0.0, 0.0, length_mm), "0 0 0")
        start = end
    return "\n".join([*parts, f'  <link name="{start}"/>', "</robot>"]) + "\n"


def _link(name: str, length_mm: float, radius_mm: float) -> list[str]:
    """A link whose segment starts in its frame."""
    cylinder = f'<cylinder length="{length_mm * 1e-3:g}" radius="{radius_mm * 1e-3:g}"/>'
    middle = f'<origin xyz="0 0 {length_mm * 0.5e-3:g}" rpy="0 0 0"/>'
    return [
        f'  <link name="{name}">',
        f"    <visual>{middle}<geometry>{cylinder}</geometry>{_GREY}</visual>",
        "  </link>",
    ]


def _fixed(parent: str, child: str, at_mm: tuple[float, float, float], rpy: str) -> list[str]:
    xyz = " ".join(f"{mm * 1e-3:g}" for mm in at_mm)
    return [
        f'  <joint name="{parent}_to_{child}" type="fixed">',
        f'    <parent link="{parent}"/><child link="{child}"/>',
        f'    <origin xyz="{xyz}" rpy="{rpy}"/>',
        "  </joint>",
    ]
