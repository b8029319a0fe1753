"""The driver through pyserial, on a pty and TCP, against the emulated camera in real time."""

import numpy as np
import pytest

from ccr_host.core.clock import Parts, RealClock
from ccr_host.core.errors import TrackerError
from ccr_host.description.simulation import Tracker
from ccr_host.sim.polaris.line import make_polaris
from ccr_host.sim.polaris.sensor import Placement
from ccr_host.sim.serving.ports import PtyPort
from ccr_host.sim.serving.ports import TcpPort as ServedTcp
from ccr_host.sim.serving.server import BoardServer
from ccr_host.tracking.sources.ndi.driver import NdiTracker
from ccr_host.tracking.sources.ndi.port import SerialPort, TcpPort
from ccr_host.tracking.tracker import wait_until_tracking
from tests.exposer import Exposer, running
from tests.served import wait_until_left
from tests.unit.tracking.sources.ndi.conftest import MARKERS_MM


@pytest.mark.parametrize("kind", ["pty", "tcp"])
def test_driver_tracks_and_leaves_the_camera_for_the_next_one(kind):
    port = PtyPort() if kind == "pty" else ServedTcp(0)
    seed = np.random.SeedSequence(1)
    line = make_polaris(Tracker(noise_mm=0.0), seed, paced=kind == "pty")
    world = Parts()
    world.attach(line)
    world.attach(Exposer(line.device.sensor, lambda _: MARKERS_MM))
    server = BoardServer(line, port, RealClock(), world=world)
    with server:
        address = server.uri.partition(":")[2].removeprefix("//")
        for _ in range(2):
            clock = RealClock()
            opener = SerialPort if kind == "pty" else TcpPort
            tracker = NdiTracker("ndi", lambda: opener(address))  # noqa: B023
            clock.attach(tracker)
            with running(tracker):
                wait_until_tracking(tracker, clock)
                clock.sleep_until_us(clock.now_us() + 500_000)
                frame = tracker.newest_frame()
                np.testing.assert_allclose(
                    frame.points_mm, Placement().to_camera(MARKERS_MM), atol=0.006
                )
            wait_until_left(server)


@pytest.mark.parametrize(
    ("open_port", "cause"),
    [
        (lambda: SerialPort("/dev/nosuchport"), "ndi:/dev/nosuchport: there is no such port"),
        (lambda: SerialPort("/dev/null"), "not a serial port"),
        (lambda: TcpPort("127.0.0.1:1"), "connection refused"),
    ],
)
def test_port_that_cannot_be_opened_is_one_clear_line(open_port, cause):
    with pytest.raises(TrackerError, match=cause) as refusal:
        NdiTracker("ndi", open_port).start()
    assert refusal.value.cure
    assert "\n" not in str(refusal.value)
