"""OpenIGTLink: what a server sends, and what pyigtl makes of a server that goes away."""

from dataclasses import dataclass, field

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from ccr_host.run.clock import RealClock, VirtualClock
from ccr_host.tracking.igtl import IgtlTracker

STEP_US = 50_000


@dataclass
class Message:
    """As pyigtl delivers it."""

    device_name: str
    timestamp: float
    matrix: np.ndarray = field(default_factory=lambda: np.eye(4))
    positions: np.ndarray | None = None

    @property
    def message_type(self) -> str:
        return "TRANSFORM" if self.positions is None else "POINT"


def transform(name: str, stamp_s: float, position_mm=(0, 0, 0)) -> Message:
    matrix = np.eye(4)
    matrix[:3, 3] = position_mm
    return Message(name, stamp_s, matrix)


class Client:
    """A client whose messages the test puts in."""

    def __init__(self) -> None:
        self.communication_thread_stop_requested = False
        self.inbox: list[Message] = []

    def get_latest_messages(self) -> list[Message]:
        messages, self.inbox = self.inbox, []
        return messages


class Rig:
    def __init__(self, **keys) -> None:
        self.clients: list[Client] = []
        self.clock = VirtualClock()
        self.tracker = IgtlTracker("localhost", 1, make_client=self._make, **keys)
        self.clock.attach(self.tracker)
        self.tracker.start()
        self.wait_us(1000)

    def _make(self) -> Client:
        self.clients.append(Client())
        return self.clients[-1]

    def wait_us(self, duration_us: int) -> None:
        self.clock.sleep_until_us(self.clock.now_us() + duration_us)

    def send(self, *messages: Message):
        self.clients[-1].inbox += messages
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
        rig.clients[-1].inbox += all_three(1e9 + step * STEP_US * 1e-6)
        rig.wait_us(1000)
        exposed_us.append(rig.tracker.newest_frame().exposed_us)
    late = np.array(exposed_us[20:]) - start_us - STEP_US * np.arange(20, 60) + 60_000
    assert late.min() >= 0
    assert late.max() <= 3000


def test_messages_without_stamp_are_ignored_and_said_so():
    rig = Rig()
    assert rig.send(*all_three(0.0)) is None
    assert "time stamp" in rig.tracker.health.warnings[0]


def test_silent_client_is_replaced_and_what_was_stale_does_not_count():
    rig = Rig()
    rig.send(*all_three(100.0))
    rig.send(*all_three(100.0))  # what pyigtl delivers again after the server has closed
    rig.wait_us(2_500_000)
    assert len(rig.clients) == 2
    assert rig.clients[0].communication_thread_stop_requested
    assert not rig.tracker.health.tracking
    before = rig.tracker.newest_frame()
    frame = rig.send(*all_three(5.0, 9))  # the new server's clock may start anywhere
    assert frame.exposed_us > before.exposed_us
    assert rig.tracker.health.tracking
    assert rig.tracker.health.reconnections == 1


def test_infinite_matrix_is_no_pose():
    rig = Rig()
    frame = rig.send(*all_three(100.0)[:2], transform("M3ToTracker", 100.0, (np.nan, 0, 0)))
    frame = rig.send(*all_three(100.05))
    assert set(frame.tools) == {"M1", "M2", "M3"}
    assert rig.tracker.health.frames == 2


def test_rotation_of_a_tool_is_that_of_the_matrix():
    turn = Rotation.from_rotvec((0.3, -0.2, 2.0))
    messages = all_three(100.0)
    messages[0].matrix[:3, :3] = turn.as_matrix()
    w, x, y, z = Rig().send(*messages).tools["M1"].quaternion
    assert (Rotation.from_quat((x, y, z, w)) * turn.inv()).magnitude() < 1e-9


def test_real_server_that_goes_away_and_comes_back():
    pyigtl = pytest.importorskip("pyigtl")
    clock = RealClock()
    server = pyigtl.OpenIGTLinkServer(port=0, local_server=True)
    port = server.server_address[1]
    stamp_s = 1000.0

    def stream(duration_us: int) -> None:
        nonlocal stamp_s
        end_us = clock.now_us() + duration_us
        while clock.now_us() < end_us:
            stamp_s += 0.05
            for message in all_three(stamp_s, stamp_s):
                server.send_message(
                    pyigtl.TransformMessage(
                        message.matrix, device_name=message.device_name, timestamp=stamp_s
                    ),
                    wait=False,
                )
            clock.sleep_until_us(clock.now_us() + STEP_US)

    tracker = IgtlTracker("127.0.0.1", port)
    clock.attach(tracker)
    with tracker:
        stream(800_000)
        assert tracker.health.frames > 5
        assert tracker.newest_frame().tools["M2"].position_mm[1] == 2
        server.stop()
        count = tracker.health.frames
        clock.sleep_until_us(clock.now_us() + 2_500_000)
        assert tracker.health.frames <= count + 1
        assert tracker.health.reconnections >= 1
        server = pyigtl.OpenIGTLinkServer(port=port, local_server=True)
        stream(1_500_000)
        assert tracker.health.tracking
        assert tracker.health.frames > count + 5
    server.stop()
