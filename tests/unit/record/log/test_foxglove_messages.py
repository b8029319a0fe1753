"""What viewers draw, against Foxglove's own definitions."""

from datetime import UTC, datetime

import numpy as np
import pytest
from foxglove_schemas_protobuf.FrameTransforms_pb2 import FrameTransforms
from foxglove_schemas_protobuf.Log_pb2 import Log
from foxglove_schemas_protobuf.PoseInFrame_pb2 import PoseInFrame
from foxglove_schemas_protobuf.SceneUpdate_pb2 import SceneUpdate
from google.protobuf.descriptor import FieldDescriptor
from google.protobuf.json_format import ParseDict

from ccr_host.record.log import topics
from ccr_host.record.log.topics import LOG_TOPICS

WITNESSES = {
    "foxglove.FrameTransforms": FrameTransforms,
    "foxglove.Log": Log,
    "foxglove.PoseInFrame": PoseInFrame,
    "foxglove.SceneUpdate": SceneUpdate,
}
WELL_KNOWN = [topic for topic in LOG_TOPICS if topic.schema_name.startswith("foxglove.")]
JSON_TYPES = {
    FieldDescriptor.CPPTYPE_BOOL: {"boolean"},
    FieldDescriptor.CPPTYPE_DOUBLE: {"number"},
    FieldDescriptor.CPPTYPE_ENUM: {"integer"},
    FieldDescriptor.CPPTYPE_MESSAGE: {"object"},
    FieldDescriptor.CPPTYPE_STRING: {"string"},
    FieldDescriptor.CPPTYPE_UINT32: {"integer"},
}


def with_protobuf_times(value):
    """Protobuf's JSON writes times as text, Foxglove's JSON schemas as seconds and nanoseconds."""
    if isinstance(value, list):
        return [with_protobuf_times(one) for one in value]
    if not isinstance(value, dict):
        return value
    if set(value) == {"sec", "nsec"}:
        return (value["sec"], value["nsec"])
    return {key: with_protobuf_times(one) for key, one in value.items()}


def as_protobuf(content, kind):
    def told(value, key=""):
        if isinstance(value, tuple):
            sec, nsec = value
            if key == "lifetime":
                return f"{sec}.{nsec:09d}s"
            moment = datetime.fromtimestamp(sec, UTC).strftime("%Y-%m-%dT%H:%M:%S")
            return f"{moment}.{nsec:09d}Z"
        if isinstance(value, list):
            return [told(one) for one in value]
        if isinstance(value, dict):
            return {name: told(one, name) for name, one in value.items()}
        return value

    return ParseDict(told(with_protobuf_times(content)), kind())


@pytest.mark.parametrize("topic", WELL_KNOWN, ids=lambda topic: topic.name)
def test_schemas_have_foxgloves_fields_with_their_types(topic):
    def compare(schema, descriptor):
        ours = schema["properties"]
        theirs = {field.name: field for field in descriptor.fields}
        assert set(ours) <= set(theirs)
        assert set(schema["required"]) == set(ours)
        for name, field in theirs.items():
            if name not in ours:
                continue
            inner = ours[name]
            if field.is_repeated:
                assert inner["type"] == "array"
                inner = inner["items"]
            assert inner["type"] in JSON_TYPES[field.cpp_type], f"{descriptor.name}.{name}"
            if "properties" in inner and set(inner["properties"]) != {"sec", "nsec"}:
                compare(inner, field.message_type)

    compare(topic.schema, WITNESSES[topic.schema_name].DESCRIPTOR)


@pytest.mark.parametrize("topic", WELL_KNOWN, ids=lambda topic: topic.name)
def test_every_message_in_a_log_is_one_of_foxgloves(recording, topic):
    contents = [message.content for message in recording.messages(topic)]
    assert contents
    for content in contents:
        as_protobuf(content, WITNESSES[topic.schema_name])


def test_the_scene_shows_what_the_step_says(recording):
    first_step = next(iter(recording.messages(topics.STEP)))
    scene = next(iter(recording.messages(topics.SCENE)))
    assert scene.time_us == first_step.time_us
    entities = {entity["id"]: entity for entity in scene.content["entities"]}
    assert set(entities) == {"backbone", "horizon", "markers"}
    backbone = entities["backbone"]["lines"][0]["points"]
    offset_m = recording.description.robot.marker_offset_mm * 1e-3
    assert backbone[0] == {"x": 0.0, "y": 0.0, "z": -offset_m}, "marker 1 is the origin"
    m1, m2, m3 = (sphere["pose"]["position"] for sphere in entities["markers"]["spheres"])
    assert m1 == {"x": 0.0, "y": 0.0, "z": 0.0}
    assert m2 != m1
    measured_m = np.array(first_step.content["measured_mm"]) * 1e-3
    assert [m3["x"], m3["y"], m3["z"]] == pytest.approx(measured_m, abs=1e-5)


def test_unreachable_parts_of_the_path_are_marked(recording):
    (path,) = recording.messages(topics.DESIRED_PATH)
    (line,) = path.content["entities"][0]["lines"]
    assert len(line["points"]) == len(line["colors"]) == 2 * (len(recording.reference) - 1)
    reachable = recording.reference.reachable
    red = [color["r"] > color["g"] for color in line["colors"][::2]]
    assert red == (~(reachable[:-1] & reachable[1:])).tolist()
