"""A run as an OpenIGTLink server, read by pyigtl's client.

OpenIGTLink's own library reads a whole run in tests/system/test_igtl_server.py.
"""

import json
import logging
import socket
import time
from collections.abc import Iterator

import numpy as np
import pyigtl
import pytest

from ccr_host.control.base import Command, Outcome, Phase
from ccr_host.core.errors import ConfigError
from ccr_host.description import schema
from ccr_host.robot.chain import PAPER_FRAME, bend_of
from ccr_host.robot.kinematics import ConstantCurvature
from ccr_host.run import igtl_server
from ccr_host.run.execute import reference_of
from ccr_host.run.igtl_server import IgtlServer, parse_publish_uri, published
from ccr_host.run.observer import RunSetup
from ccr_host.run.options import RunOptions
from ccr_host.tracking.tracker import Sample
from tests.patience import PATIENCE_S

Q_RAD = np.array((0.3, -0.2))
NOT_A_CLIENTS_FAULT_S = 15
"""Who waits for a client that never reads waits for ever; a busy machine stops us for seconds."""


def markers_mm(description: schema.Description) -> np.ndarray:
    model = ConstantCurvature(description.robot)
    only_first = description.robot.model_copy(
        update={"segment_lengths_mm": (model.lengths_mm[0], 1e-9)}
    )
    middle = ConstantCurvature(only_first).tip_mm((Q_RAD[0], 0.0))
    return np.stack([np.zeros(3), middle, model.tip_mm(Q_RAD)]) + np.array((5.0, 6.0, 7.0))


def show(server: IgtlServer) -> None:
    """Let the observer see a moment of a run."""
    options = RunOptions(path="8shape")
    description, reference = options.description(), reference_of(options)
    watch = server.observer
    watch.begin(RunSetup(options, description, reference))
    watch.phase(1_000_000, Phase("following the path"))
    watch.control(2_000_000, None, Command(Q_RAD, np.empty((0, 3)), Outcome.SOLVED))
    watch.tracker_sample(2_600_000, Sample(2_500_000, markers_mm(description)))


@pytest.fixture
def server(monkeypatch: pytest.MonkeyPatch) -> Iterator[IgtlServer]:
    monkeypatch.setattr(igtl_server, "PERIOD_S", 0.005)
    with published("igtl://:0") as served:
        yield served


def connected(server: IgtlServer) -> socket.socket:
    host, _, port = server.address.rpartition(":")
    return socket.create_connection((host, int(port)), 10)


def test_pyigtl_reads_poses_points_and_state(
    server: IgtlServer, caplog: pytest.LogCaptureFixture
) -> None:
    caplog.set_level(logging.CRITICAL)
    show(server)
    client = pyigtl.OpenIGTLinkClient("127.0.0.1", int(server.address.rpartition(":")[2]))
    try:
        tip = client.wait_for_message("TipToBase", timeout=PATIENCE_S)
        rest = {
            name: client.wait_for_message(name, timeout=PATIENCE_S)
            for name in ("DesiredToBase", "Disk0ToBase", "Disk2ToBase", "Backbone", "State")
        }
    finally:
        client.stop()
    description = schema.load(None)
    model = ConstantCurvature(description.robot)
    assert tip.matrix[:3, 3] == pytest.approx(model.tip_mm(Q_RAD), abs=1e-3)
    assert tip.timestamp == pytest.approx(2.5)
    desired = reference_of(RunOptions(path="8shape")).target_mm[0]
    assert rest["DesiredToBase"].matrix[:3, 3] == pytest.approx(desired, abs=1e-3)
    offset_mm = description.robot.marker_offset_mm
    assert rest["Disk0ToBase"].matrix[:3, 3] == pytest.approx((0, 0, -offset_mm))
    curve_mm = np.array(rest["Backbone"].positions)
    assert curve_mm[[0, -1]] == pytest.approx(
        np.array([rest[disk].matrix[:3, 3] for disk in ("Disk0ToBase", "Disk2ToBase")]), abs=1e-3
    )
    told = json.loads(rest["State"].string)
    assert told["phase"] == "following the path"
    assert told["error_mm"] == pytest.approx(
        np.linalg.norm(model.tip_mm(Q_RAD) - desired), abs=0.01
    )


@pytest.mark.parametrize("bending_rad", [(0.0, 0.0), (0.7, 0.0), (0.0, -0.9), (-1.1, 0.6)])
def test_disks_are_turned_as_the_chain_of_segments_is(bending_rad: tuple[float, float]) -> None:
    theta_1, theta_2 = bending_rad
    first, second = bend_of((0.0, theta_1)).turn, bend_of((theta_2, 0.0)).turn
    base, middle, tip = ConstantCurvature(schema.Robot()).disk_turns(np.array(bending_rad))
    assert base == pytest.approx(PAPER_FRAME)
    assert middle == pytest.approx(PAPER_FRAME @ first)
    along = PAPER_FRAME @ first @ second @ (0.0, 0.0, 1.0)
    assert tip[:, 2] == pytest.approx(along)
    for turn in (base, middle, tip):
        assert turn.T @ turn == pytest.approx(np.eye(3))
        assert np.linalg.det(turn) == pytest.approx(1)


def test_a_client_that_never_reads_is_dropped_and_delays_nobody(
    server: IgtlServer, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(igtl_server, "_PATIENCE", 20)
    show(server)
    with socket.socket() as stuck, connected(server) as reader:
        stuck.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 1)
        stuck.connect(reader.getpeername())
        while len(server._clients) != 2:
            server.observer.phase(3_000_000, Phase("following the path"))
            assert reader.recv(1 << 20)
        reader.settimeout(PATIENCE_S)
        deadline = time.monotonic() + PATIENCE_S
        slowest_s, read = 0.0, 0
        while len(server._clients) != 1 or not read:
            start_s = time.monotonic()
            assert start_s < deadline, "the stuck client is still there"
            server.observer.phase(3_000_000, Phase("following the path"))
            slowest_s = max(slowest_s, time.monotonic() - start_s)
            read += len(reader.recv(1 << 20))
        assert slowest_s < NOT_A_CLIENTS_FAULT_S
        assert read
        before = time.monotonic()
        server.close()
        assert time.monotonic() - before < NOT_A_CLIENTS_FAULT_S


def test_the_last_picture_is_sent_when_the_run_is_over(server: IgtlServer) -> None:
    show(server)
    with connected(server) as reader:
        reader.settimeout(PATIENCE_S)
        heard = reader.recv(1)
        server.observer.phase(9_000_000, Phase("done"))
        server.close()
        while data := reader.recv(1 << 16):
            heard += data
    assert heard.rfind(b'"phase": "done"') > heard.rfind(b"TipToBase")


def test_it_listens_on_this_computer_alone_unless_a_host_is_given(server: IgtlServer) -> None:
    assert server.address.startswith("127.0.0.1:")
    assert parse_publish_uri("igtl://:18944") == ("127.0.0.1", 18944)
    assert parse_publish_uri("igtl://0.0.0.0:1") == ("0.0.0.0", 1)
    assert parse_publish_uri("IGTL://[::1]:7") == ("::1", 7)


@pytest.mark.parametrize("uri", ["18944", "igtl:18944", "http://:80", "igtl://:x", "igtl://:99999"])
def test_an_address_that_cannot_be_is_refused_with_an_example(uri: str) -> None:
    with pytest.raises(ConfigError, match="igtl://:18944") as refused:
        parse_publish_uri(uri)
    assert uri in str(refused.value)


def test_a_port_that_is_taken_is_refused(server: IgtlServer) -> None:
    with pytest.raises(ConfigError, match="already in use"), published(f"igtl://{server.address}"):
        pass


def test_an_error_while_packing_ends_the_server_in_one_line_and_nothing_else(
    server: IgtlServer, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def fails(*_: object) -> None:
        raise ValueError("odd markers")

    monkeypatch.setattr(igtl_server, "fitted_bending_rad", fails)
    show(server)
    with connected(server):
        server._thread.join(PATIENCE_S)
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith("ccr-host: the OpenIGTLink server has ended")
    assert "odd markers" in line
    show(server)
