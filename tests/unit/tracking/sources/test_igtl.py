"""OpenIGTLink: what a server sends, and what pyigtl makes of a server that goes away."""

from dataclasses import dataclass, field

import numpy as np
import pyigtl
import pytest
from scipy.spatial.transform import Rotation

from ccr_host.core.clock import RealClock, VirtualClock
from ccr_host.tracking.sources.igtl import IgtlTracker
from tests.exposer import running
from tests.patience import PATIENCE_S

STEP_US = 50_000
MARKERS = ("M1", "M2", "M3")


@dataclass
class Message:
    """A message as pyigtl delivers it."""

    device_name: str
    timestamp: float
    matrix: np.ndarray = field(default_factory=lambda: np.eye(4))
    positions: np.ndarray | None = None
    metadata: dict[str, str] = field(default_factory=dict)

    @property
    def message_type(self) -> str:
        return "TRANSFORM" if self.positions is None else "POINT"


def transform(name: str, stamp_s: float, position_mm=(0, 0, 0)) -> Message:
    matrix = np.eye(4)
    matrix[:3, 3] = position_mm
    return Message(name, stamp_s, matrix)


class Stream:
    """A connection whose messages the test puts in."""

    def __init__(self) -> None:
        self.closed = False
        self.inbox: list[Message] = []
        self.skipped_types: set[str] = set()
        self.damaged = 0
        self.is_silent = False

    def messages(self) -> list[Message]:
        messages, self.inbox = self.inbox, []
        return messages

    def close(self) -> None:
        self.closed = True


class Rig:
    def __init__(self, **keys) -> None:
        self.streams: list[Stream] = []
        self.clock = VirtualClock()
        keys = {"expected_tools": MARKERS} | keys
        self.tracker = IgtlTracker("localhost", 1, open_stream=self._open, **keys)
        self.clock.attach(self.tracker)
        self.tracker.start()
        self.wait_us(1000)

    def _open(self) -> Stream:
        self.streams.append(Stream())
        return self.streams[-1]

    def wait_us(self, duration_us: int) -> None:
        self.clock.sleep_until_us(self.clock.now_us() + duration_us)

    def send(self, *messages: Message):
        self.streams[-1].inbox += messages
        self.wait_us(STEP_US)
        return self.tracker.newest_frame()


def all_three(stamp_s: float, x_mm: float = 0.0) -> list[Message]:
    return [transform(f"M{i}ToTracker", stamp_s, (x_mm, i, 0)) for i in (1, 2, 3)]


def test_transforms_of_one_stamp_are_one_frame():
    rig = Rig()
    frame = rig.send(*all_three(100.0, 7))
    assert set(frame.tools) == {"M1", "M2", "M3"}
    np.testing.assert_array_equal(frame.tools["M2"].position_mm, (7, 2, 0))
    assert rig.tracker.health.frames == 1


def test_incomplete_frame_comes_with_the_next_stamp():
    rig = Rig()
    assert rig.send(*all_three(100.0)[:2]) is None
    frame = rig.send(*all_three(100.05)[:1])
    assert set(frame.tools) == {"M1", "M2"}


def test_points_are_single_markers():
    rig = Rig(expected_tools=())
    points_mm = np.arange(9.0).reshape(3, 3)
    rig.send(Message("Strays", 100.0, positions=points_mm))
    frame = rig.send(Message("Strays", 100.05, positions=points_mm + 1))
    np.testing.assert_array_equal(frame.points_mm, points_mm)
    assert frame.tools == {}


def test_repeated_and_older_messages_are_no_frames():
    rig = Rig()
    rig.send(*all_three(100.0))
    rig.send(*all_three(100.0))
    rig.send(*all_three(99.0))
    assert rig.tracker.health.frames == 1


def test_time_of_exposure_follows_the_stamps_whatever_the_delay():
    rig = Rig(latency_us=60_000)
    rng = np.random.default_rng(1)
    start_us = rig.clock.now_us()
    exposed_us = []
    for step in range(60):
        delay_us = int(rng.integers(0, 20_000))
        due_us = start_us + step * STEP_US + delay_us
        rig.clock.sleep_until_us(due_us)
        rig.streams[-1].inbox += all_three(1e9 + step * STEP_US * 1e-6)
        rig.wait_us(1000)
        exposed_us.append(rig.tracker.newest_frame().exposed_us)
    late = np.array(exposed_us[20:]) - start_us - STEP_US * np.arange(20, 60) + 60_000
    assert late.min() >= 0
    assert late.max() <= 3000


def test_messages_without_stamp_are_ignored_and_said_so():
    rig = Rig()
    assert rig.send(*all_three(0.0)) is None
    assert "time stamp" in rig.tracker.health.warnings[0]


def test_silent_connection_is_replaced_and_what_was_stale_does_not_count():
    rig = Rig()
    rig.send(*all_three(100.0))
    rig.send(*all_three(100.0))
    rig.wait_us(3_500_000)
    assert len(rig.streams) == 2
    assert rig.streams[0].closed
    assert not rig.tracker.health.tracking
    before = rig.tracker.newest_frame()
    frame = rig.send(*all_three(5.0, 9))  # the new server's clock may start anywhere
    assert frame.exposed_us > before.exposed_us
    assert rig.tracker.health.tracking
    assert rig.tracker.health.reconnections == 1


@pytest.mark.parametrize("lag_s", [0.0, 0.002])
def test_hung_server_that_repeats_its_last_message_to_every_client_is_lost(lag_s):
    rig = Rig()

    def last_words(stamp_s: float) -> list[Message]:
        return [transform(f"M{i}ToTracker", stamp_s + i * lag_s) for i in (1, 2, 3)]

    for step in range(40):
        rig.send(*last_words(100.0 + 0.05 * step))
    frames = rig.tracker.health.frames
    for _ in range(5):
        count = len(rig.streams)
        while len(rig.streams) == count:
            rig.wait_us(STEP_US)
        rig.send(*last_words(100.0 + 0.05 * 39))
        rig.send(*last_words(100.0 + 0.05 * 38))
        assert not rig.tracker.health.tracking
    assert rig.tracker.health.frames == frames
    assert "no new message" in rig.tracker.health.last_error


def test_words_that_a_server_kept_while_it_hung_are_as_old_as_they_are():
    rig = Rig(latency_us=60_000)
    for step in range(40):
        rig.send(*all_three(100.0 + 0.05 * step))
    rig.wait_us(3_500_000)
    frame = rig.send(*all_three(102.0))
    assert rig.clock.now_us() - frame.exposed_us > 3_000_000
    frame = rig.send(*all_three(105.6))
    assert rig.clock.now_us() - frame.exposed_us < 200_000


@pytest.mark.parametrize(
    ("metadata", "is_there"),
    [
        ({"TransformStatus": "OK", "TransformValid": "true"}, True),
        ({"TransformValid": "1"}, True),
        ({"Other": "MISSING"}, True),
        ({"TransformStatus": "MISSING"}, False),
        ({"TransformStatus": "OUT_OF_VIEW"}, False),
        ({"TransformStatus": "INVALID", "TransformValid": "false"}, False),
        ({"TransformValid": "False"}, False),
        ({"TransformValid": "0", "TransformStatus": "OK"}, False),
        ({"transformstatus": "Missing"}, False),
        ({"M3ToTrackerTransformStatus": "MISSING"}, False),
        ({"M1ToTrackerTransformStatus": "MISSING"}, True),
        ({"Transform_Status": "OUT_OF_VOLUME"}, False),
        ({"ToolStatus": "TOOL_OK"}, True),
        ({"Status": ""}, False),
        ({"M3ToTracker.Valid": "no"}, False),
    ],
)
def test_transform_that_the_server_says_is_not_ok_is_no_marker(metadata, is_there):
    rig = Rig()
    messages = all_three(100.0)
    messages[2].metadata = metadata
    frame = rig.send(*messages)
    assert set(frame.tools) == ({"M1", "M2", "M3"} if is_there else {"M1", "M2"})
    assert any("M3 is" in text for text in rig.tracker.health.warnings) is not is_there


@pytest.mark.parametrize("ahead_s", [0.5, 3600.0])
def test_one_stamp_ahead_of_its_time_does_not_make_the_following_seem_old(ahead_s):
    rig = Rig(latency_us=60_000)
    for step in range(100):
        frame = rig.send(*all_three(1e9 + 0.05 * step + (ahead_s if step == 50 else 0.0)))
        assert rig.clock.now_us() - frame.exposed_us < 200_000
    assert rig.tracker.health.frames == 99


@pytest.mark.parametrize("step_s", [-3600.0, -1.01, -0.51, 1.0, 3600.0])
def test_a_servers_clock_that_is_set_costs_half_a_second(step_s):
    rig = Rig(latency_us=60_000)
    for step in range(100):
        frame = rig.send(*all_three(1e9 + 0.05 * step + (step_s if step >= 50 else 0.0)))
        if not 50 <= step < 60:
            assert rig.clock.now_us() - frame.exposed_us < 200_000
    assert rig.tracker.health.reconnections == 0


@pytest.mark.parametrize("order", [(1, 2, 3), (3, 1, 2)])
def test_transforms_stamped_one_by_one_are_one_frame(order):
    rig = Rig()
    for step in range(3):
        stamps_s = [100.0 + 0.05 * step + 0.004 * place for place in range(3)]
        for i, stamp_s in zip(order, stamps_s, strict=True):
            frame = rig.send(transform(f"M{i}ToTracker", stamp_s, (step, i, 0)))
        assert set(frame.tools) == {"M1", "M2", "M3"}
        assert rig.tracker.health.frames == step + 1


def test_two_exposures_within_the_tolerance_stay_apart():
    rig = Rig()
    for step in range(4):  # 500 Hz
        rig.send(*all_three(100.0 + 0.002 * step, step)[:2])
    assert rig.tracker.health.frames == 3
    assert rig.tracker.newest_frame().tools["M1"].position_mm[0] == 2


def test_other_names_are_listed_beside_the_expected_ones():
    rig = Rig()
    rig.send(transform("ProbeToTracker", 100.0), transform("StylusToReference", 100.0))
    (warning,) = rig.tracker.health.warnings
    for word in ("Probe", "Stylus", "M1", "M2", "M3"):
        assert word in warning
    assert rig.tracker.newest_frame() is None


def test_further_tools_beside_the_expected_ones_do_no_harm():
    rig = Rig()
    for step in range(3):
        stamp_s = 100.0 + 0.05 * step
        rig.send(transform("StylusToTracker", stamp_s + 0.02), *all_three(stamp_s))
    assert rig.tracker.health.frames == 3
    assert rig.tracker.health.warnings == ()


def test_server_that_sends_no_poses_is_told_what_it_sends():
    rig = Rig()
    rig.streams[0].skipped_types = {"IMAGE", "TDATA"}
    rig.wait_us(STEP_US)
    (warning,) = rig.tracker.health.warnings
    assert "IMAGE, TDATA" in warning
    assert "TRANSFORM" in warning


def test_infinite_matrix_is_no_pose():
    rig = Rig()
    frame = rig.send(*all_three(100.0)[:2], transform("M3ToTracker", 100.0, (np.nan, 0, 0)))
    frame = rig.send(*all_three(100.05))
    assert set(frame.tools) == {"M1", "M2", "M3"}
    assert rig.tracker.health.frames == 2


@pytest.mark.parametrize(
    ("diagonal", "told"),
    [((1, 1, -1), "left-handed"), ((1e3, 1e3, 1e3), "scaled or sh"), ((0, 0, 0), "scaled or sh")],
)
def test_a_matrix_that_is_no_rotation_is_no_pose_and_is_named(diagonal, told):
    rig = Rig()
    messages = all_three(100.0)
    messages[0].matrix[:3, :3] = np.diag(diagonal)
    assert set(rig.send(*messages).tools) == {"M2", "M3"}
    (warning,) = rig.tracker.health.warnings
    assert f"M1 is no rotation: its matrix is {told}" in warning


def test_rotation_of_a_tool_is_that_of_the_matrix():
    turn = Rotation.from_rotvec((0.3, -0.2, 2.0))
    messages = all_three(100.0)
    messages[0].matrix[:3, :3] = turn.as_matrix()
    w, x, y, z = Rig().send(*messages).tools["M1"].quaternion
    assert (Rotation.from_quat((x, y, z, w)) * turn.inv()).magnitude() < 1e-9


@pytest.mark.long
def test_real_server_that_goes_away_and_comes_back():
    clock = RealClock()
    server = pyigtl.OpenIGTLinkServer(port=0, local_server=True)
    port = server.server_address[1]
    stamp_s = 1000.0

    def stream_until(frames: int) -> None:
        nonlocal stamp_s
        while tracker.health.frames < frames and clock.now_us() < PATIENCE_S * 1e6:
            stamp_s += 0.05
            for message in all_three(stamp_s, stamp_s):
                server.send_message(
                    pyigtl.TransformMessage(
                        message.matrix, device_name=message.device_name, timestamp=stamp_s
                    ),
                    wait=False,
                )
            clock.sleep_until_us(clock.now_us() + STEP_US)

    tracker = IgtlTracker("127.0.0.1", port, expected_tools=MARKERS)
    clock.attach(tracker)
    with running(tracker):
        stream_until(6)
        assert tracker.health.frames >= 6
        assert tracker.newest_frame().tools["M2"].position_mm[1] == 2
        server.stop()
        while not tracker.health.reconnections and clock.now_us() < PATIENCE_S * 1e6:
            clock.sleep_until_us(clock.now_us() + STEP_US)
        assert tracker.health.reconnections >= 1
        count = tracker.health.frames
        server = pyigtl.OpenIGTLinkServer(port=port, local_server=True)
        stream_until(count + 6)
        assert tracker.health.tracking
        assert tracker.health.frames >= count + 6
    server.stop()
