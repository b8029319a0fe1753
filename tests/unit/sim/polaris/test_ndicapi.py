"""Independent witness: NDI's open client library drives the emulated camera over a pty and TCP."""

import ndicapy as ndi
import numpy as np
import pytest

from ccr_host.core.clock import Parts, RealClock
from ccr_host.description.simulation import Tracker
from ccr_host.sim.polaris.line import make_polaris
from ccr_host.sim.polaris.sensor import Placement
from ccr_host.sim.serving.ports import PtyPort, TcpPort
from ccr_host.sim.serving.server import BoardServer
from ccr_host.tracking.sources.ndi.rom import (
    DUMMY_MARKERS_MM,
    dummy_passive_rom,
    make_passive_rom,
    rom_blocks,
)
from tests.exposer import Exposer

MARKERS_MM = np.array([(0.0, 0.0, 15.0), (1.0, -58.0, 12.0), (20.0, -90.0, 10.0)])
CAMERA_MM = Placement().to_camera(MARKERS_MM)
MODE = 0x1801


@pytest.fixture(params=["pty", "tcp"])
def device(request):
    """A handle of the library on a camera that runs in the background."""
    paced = request.param == "pty"
    port = PtyPort() if paced else TcpPort(0)
    line = make_polaris(Tracker(noise_mm=0.0), np.random.SeedSequence(1), paced=paced)
    world = Parts()
    world.attach(line)
    world.attach(Exposer(line.device.sensor, lambda _: MARKERS_MM))
    server = BoardServer(line, port, RealClock(), world=world)
    with server:
        address = server.uri.partition(":")[2]
        if paced:
            handle = ndi.ndiOpen(address)
        else:
            host, _, number = address.removeprefix("//").rpartition(":")
            handle = ndi.ndiOpenNetwork(host, int(number))
        assert handle
        assert talk(handle, "INIT:") == "OKAY"
        if paced:
            assert talk(handle, "COMM:50000") == "OKAY"
        yield handle  # closed by its destructor; ndiClose would make it close a second time


def talk(device, command: str) -> str:
    reply = ndi.ndiCommand(device, command)
    assert ndi.ndiGetError(device) == ndi.NDI_OKAY, (command, reply)
    return reply


def load(device, rom: bytes) -> int:
    """Upload by single commands: ndiPVWRFromFile keeps the GIL, so the camera could not answer."""
    talk(device, "PHRQ:*********1****")
    handle = ndi.ndiGetPHRQHandle(device)
    for address, block in rom_blocks(rom):
        talk(device, f"PVWR:{handle:02X}{address:04X}{block.hex().upper()}")
    talk(device, f"PINIT:{handle:02X}")
    talk(device, f"PENA:{handle:02X}D")
    return handle


def test_library_tracks_tools_and_strays(device):
    load(device, dummy_passive_rom())
    port = load(device, make_passive_rom(np.array(DUMMY_MARKERS_MM), "CCR-M2"))
    tool = bytes([port])
    talk(device, "PHSR:04")
    assert ndi.ndiGetPHSRNumberOfHandles(device) == 2
    talk(device, "TSTART:80")
    frames = set()
    for _ in range(5000):
        talk(device, f"TX:{MODE:04X}")
        frames.add(ndi.ndiGetTXFrame(device, tool))
        if len(frames) == 6:
            break
    assert len(frames) == 6
    assert all(frame % 3 == 0 for frame in frames)
    transform = ndi.ndiGetTXTransform(device, tool)
    np.testing.assert_allclose(transform[:4], (1, 0, 0, 0), atol=1e-4)
    np.testing.assert_allclose(transform[4:7], CAMERA_MM[1], atol=0.006)
    assert ndi.ndiGetTXPortStatus(device, tool) == 0x31
    assert ndi.ndiGetTXNumberOfPassiveStrays(device) == 2
    strays_mm = [ndi.ndiGetTXPassiveStray(device, index) for index in range(2)]
    np.testing.assert_allclose(strays_mm, CAMERA_MM[[0, 2]], atol=0.006)
    assert ndi.ndiGetTXSystemStatus(device) == 0
    talk(device, "TSTOP:")


def test_library_understands_a_refusal(device):
    with pytest.raises(OSError, match="invalid while in the current mode"):
        ndi.ndiCommand(device, f"TX:{MODE:04X}")
    assert ndi.ndiGetError(device) == 0x0C


def test_library_sees_no_strays_while_the_illuminators_are_dark(device):
    talk(device, "TSTART:80")
    for _ in range(10):
        talk(device, f"TX:{MODE:04X}")
    assert ndi.ndiGetTXNumberOfPassiveStrays(device) == 0
