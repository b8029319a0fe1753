"""A bag, read back by `rosbags`, an implementation of ROS's formats of its own."""

import math
from pathlib import Path

import mujoco
import numpy as np
import pytest
from rosbags.highlevel import AnyReader
from rosbags.typesys import Stores, get_typestore

from ccr_host.description import schema
from ccr_host.record.log import topics
from ccr_host.record.ros_bag import urdf_of, write_bag

TYPES = {
    "/robot_description": "std_msgs/msg/String",
    "/tf": "tf2_msgs/msg/TFMessage",
    "/diagnostics": "diagnostic_msgs/msg/DiagnosticArray",
    "/ccr/desired_path": "nav_msgs/msg/Path",
    "/ccr/setpoint_js": "sensor_msgs/msg/JointState",
    "/ccr/servo_jp": "sensor_msgs/msg/JointState",
    "/ccr/measured_cp": "geometry_msgs/msg/PoseStamped",
    "/ccr/setpoint_cp": "geometry_msgs/msg/PoseStamped",
}


@pytest.fixture(scope="module")
def bag(recording, tmp_path_factory) -> tuple[dict[str, list], dict[str, int], Path]:
    """Messages by topic, with their times, as rosbags reads them, and what was told of them."""
    folder = tmp_path_factory.mktemp("bag")
    told = write_bag(recording, folder)
    store = get_typestore(Stores.ROS2_HUMBLE)
    found: dict[str, list] = {topic: [] for topic in TYPES}
    with AnyReader([folder], default_typestore=store) as reader:
        assert {one.topic: one.msgtype for one in reader.connections} == TYPES
        for connection, time_ns, data in reader.messages():
            message = reader.deserialize(data, connection.msgtype)
            found[connection.topic].append((time_ns, message))
    return found, told, folder


def stamp_us(header) -> int:
    return header.stamp.sec * 1_000_000 + header.stamp.nanosec // 1000


def position_mm(pose) -> list[float]:
    return [1e3 * pose.position.x, 1e3 * pose.position.y, 1e3 * pose.position.z]


def test_every_message_arrives_and_metadata_and_command_tell_the_same_counts(bag) -> None:
    found, told, folder = bag
    assert {topic: len(messages) for topic, messages in found.items()} == told
    with AnyReader([folder]) as reader:
        assert reader.message_count == sum(told.values())
        assert {one.topic: one.msgcount for one in reader.connections} == told


def test_numbers_are_those_of_the_log_in_metres_and_radians(bag, recording) -> None:
    found, *_ = bag
    for topic, logged, field in (
        ("/ccr/setpoint_js", topics.STATE, "setpoint_cdeg"),
        ("/ccr/servo_jp", topics.CONTROL, "command_rad"),
    ):
        scale = math.radians(0.01) if field.endswith("cdeg") else 1.0
        messages = list(recording.messages(logged))
        for (time_ns, message), of_log in zip(found[topic], messages, strict=True):
            assert time_ns == of_log.time_us * 1000 == 1000 * stamp_us(message.header)
            assert message.position == pytest.approx(scale * np.array(of_log.content[field]))
            assert message.name == ["motor_1", "motor_2"]
    steps = list(recording.messages(topics.STEP))
    for (_, message), step in zip(found["/ccr/setpoint_cp"], steps, strict=True):
        assert position_mm(message.pose) == pytest.approx(step.content["target_mm"])
    (_, path), *others = found["/ccr/desired_path"]
    assert not others
    assert [position_mm(one.pose) for one in path.poses] == pytest.approx(
        recording.reference.target_mm
    )


def test_the_tip_is_stamped_with_its_exposure_and_lies_where_the_transforms_put_it(
    bag, recording
) -> None:
    found, *_ = bag
    samples = list(recording.messages(topics.SAMPLE))
    for (_, tip), (_, tf), sample in zip(
        found["/ccr/measured_cp"], found["/tf"], samples, strict=True
    ):
        m1, _, m3 = np.array(sample.content["markers_mm"])
        assert stamp_us(tip.header) == sample.content["exposed_us"]
        assert position_mm(tip.pose) == pytest.approx(m3 - m1)
        assert [one.child_frame_id for one in tf.transforms] == ["m1", "m2", "m3"]
        at = tf.transforms[2].transform.translation
        assert [at.x, at.y, at.z] == pytest.approx((m3 - m1) * 1e-3)
        assert tip.header.frame_id == tf.transforms[2].header.frame_id == "robot"


def test_diagnostics_keep_names_levels_and_values(bag, recording) -> None:
    found, *_ = bag
    logged = [message.content["status"] for message in recording.messages(topics.DIAGNOSTICS)]
    assert len(logged) == len(found["/diagnostics"]) > 0
    for (_, message), statuses in zip(found["/diagnostics"], logged, strict=True):
        assert [
            {
                "level": one.level,
                "name": one.name,
                "message": one.message,
                "hardware_id": one.hardware_id,
                "values": [{"key": pair.key, "value": pair.value} for pair in one.values],
            }
            for one in message.status
        ] == statuses


@pytest.mark.parametrize("lengths", ["[58.5, 43.5]", "[70, 30]"])
def test_mujoco_reads_the_urdf_and_finds_tip_and_base_where_the_straight_robot_has_them(
    lengths,
) -> None:
    description = schema.load(None, (f"robot.segment_lengths_mm={lengths}",))
    head, _, rest = urdf_of(description).partition(">")
    every_link = '<mujoco><compiler fusestatic="false" discardvisual="false"/></mujoco>'
    model = mujoco.MjModel.from_xml_string(f"{head}>{every_link}{rest}")
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    at = {name: 1e3 * data.body(name).xpos for name in ("base", "segment_1_end", "segment_2_end")}
    first, second = description.robot.segment_lengths_mm
    assert at["base"] == pytest.approx([0, 0, -15])
    assert at["segment_1_end"] == pytest.approx([0, -first, -15], abs=1e-4)
    assert at["segment_2_end"] == pytest.approx([0, -first - second, -15], abs=1e-4)
