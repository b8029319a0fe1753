"""The emulated board behind a pty and TCP, in real time, reached through pyserial."""

import os
import signal
import socket
from types import SimpleNamespace

import numpy as np
import pytest

from ccr_host.core.clock import RealClock
from ccr_host.core.errors import ConfigError, DeviceError
from ccr_host.description.schema import load
from ccr_host.link import messages as m
from ccr_host.link.board import drawn_session
from ccr_host.link.board_config import board_config
from ccr_host.link.client import Client
from ccr_host.link.framing import encode_frame
from ccr_host.link.transport import open_transport, parse_device_uri
from ccr_host.sim.board.board import SerialLine, UnoEmulator
from ccr_host.sim.board.eeprom import EepromFile
from ccr_host.sim.serving.ports import PtyPort, TcpPort
from ccr_host.sim.serving.server import BoardServer
from tests.patience import PATIENCE_S, becomes_true
from tests.served import wait_until_left

BOOT_LOADER_US = 50_000


def open_tcp():
    return TcpPort(0)


@pytest.fixture(params=[PtyPort, open_tcp])
def served(request):
    """A board behind a port; the tests may look at the board, the server's thread moves it."""
    board = UnoEmulator()
    server = BoardServer(
        SerialLine(board), request.param(), RealClock(), boot_loader_us=BOOT_LOADER_US
    )
    with server:
        yield server, board


def connect(uri):
    clock = RealClock()
    client = Client(
        open_transport(parse_device_uri(uri)), clock, drawn_session(np.random.default_rng())
    )
    clock.attach(client)
    return client, clock


def test_run_through_the_port(served):
    server, board = served
    client, clock = connect(server.uri)
    with client:
        identity = client.connect()
        assert identity.reset_cause is m.ResetCause.EXTERNAL
        client.configure(board_config(load(None, ["link.arm_axis_ms=20"])))
        client.arm()
        for angle in (0.01, 0.02, 0.03):
            client.set_target((angle, 0), ramp_ms=0, validity_ms=10_000)
            clock.sleep_until_us(clock.now_us() + 30_000)
        assert client.accepted_rad[0] == pytest.approx(0.03, abs=1e-4)
    assert board.state is m.State.DISARMED
    statistics = client.statistics
    assert (statistics.crc_errors, statistics.unanswered_targets) == (0, 0)


def test_opening_the_port_resets_the_board_each_time(served):
    server, _ = served
    boot_ids = []
    for _ in range(3):
        client, _ = connect(server.uri)
        with client:
            boot_ids.append(client.connect().boot_id)
        if server.uri.startswith("serial:"):
            wait_until_left(server)
    assert boot_ids == [boot_ids[0], boot_ids[0] + 1, boot_ids[0] + 2]


def test_board_ticks_on_without_a_client(served):
    _, board = served
    before = board.report().tick
    assert becomes_true(lambda: board.report().tick > before)


def test_port_that_disappears_is_a_device_error():
    server = BoardServer(SerialLine(UnoEmulator()), TcpPort(0), RealClock(), boot_loader_us=0)
    with server:
        client, _ = connect(server.uri)
        client.connect()
    with pytest.raises(DeviceError, match="has closed the connection"):
        while True:
            client.read_state()


def test_second_tcp_client_is_told_busy_and_the_first_one_continues():
    server = BoardServer(SerialLine(UnoEmulator()), TcpPort(0), RealClock(), boot_loader_us=0)
    with server:
        client, _ = connect(server.uri)
        with client:
            client.connect()
            address = ("127.0.0.1", int(server.uri.rpartition(":")[2]))
            with socket.create_connection(address) as second:
                second.settimeout(PATIENCE_S)
                assert b"busy" in second.recv(100)
                assert second.recv(100) == b""
            assert client.read_state().state is m.State.DISARMED


def test_no_web_page_reaches_the_board_whatever_it_posts():
    server = BoardServer(SerialLine(UnoEmulator()), TcpPort(0), RealClock(), boot_loader_us=0)
    with server:
        address = ("127.0.0.1", int(server.uri.rpartition(":")[2]))
        with socket.create_connection(address) as page:
            page.settimeout(PATIENCE_S)
            frame = encode_frame(m.Stop.ID, 1, m.Stop().pack())
            page.sendall(b"POST / HTTP/1.1\r\nOrigin: http://evil.example\r\n\r\n" + frame)
            assert page.recv(100) == b""
        client, _ = connect(server.uri)
        with client:
            client.connect()


def test_second_host_cannot_open_the_same_pty():
    server = BoardServer(SerialLine(UnoEmulator()), PtyPort(), RealClock(), boot_loader_us=0)
    with server:
        client, _ = connect(server.uri)
        with client, pytest.raises(DeviceError, match="in use"):
            connect(server.uri)


def test_port_in_use_is_refused_with_a_cure():
    first = TcpPort(0)
    try:
        port = int(first.uri.rpartition(":")[2])
        with pytest.raises(ConfigError, match="already in use") as refusal:
            TcpPort(port)
        assert refusal.value.cure
    finally:
        first.close()


@pytest.mark.parametrize(
    ("uri", "cause"),
    [
        ("serial:/dev/nosuchport", "no such port"),
        ("serial:/dev/null", "not a serial port"),
        ("tcp://127.0.0.1:1", "refused"),
    ],
)
def test_port_that_cannot_be_opened_is_one_clear_line(uri, cause):
    with pytest.raises(DeviceError, match=cause) as refusal:
        open_transport(parse_device_uri(uri))
    assert refusal.value.cure
    assert "\n" not in str(refusal.value)


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_signal_ends_the_server_cleanly(number):
    handler_before = signal.getsignal(number)

    def send(_: int) -> None:  # a timer might be early, which would end the tests instead
        os.kill(os.getpid(), number)

    world = SimpleNamespace(advance_to=send)
    server = BoardServer(SerialLine(UnoEmulator()), TcpPort(0), RealClock(), world=world)
    server.run_until_signal()
    assert signal.getsignal(number) is handler_before
    with pytest.raises(DeviceError, match="refused"):
        open_transport(parse_device_uri(server.uri))


def test_eeprom_file_outlives_the_server(tmp_path):
    config = board_config(load())
    for first in (True, False):
        eeprom = EepromFile(tmp_path / "eeprom.bin")
        server = BoardServer(
            SerialLine(UnoEmulator(eeprom)), TcpPort(0), RealClock(), boot_loader_us=0
        )
        with server:
            client, _ = connect(server.uri)
            with client:
                client.connect()
                if first:
                    client.configure(config)
                    client.save_config()
                else:
                    assert client.read_config() == config
        eeprom.close()


def test_eeprom_file_of_another_size_is_refused(tmp_path):
    path = tmp_path / "eeprom.bin"
    path.write_bytes(b"short")
    with pytest.raises(ConfigError, match="not 1024 bytes long"):
        EepromFile(path)
    with pytest.raises(ConfigError, match="No such file"):
        EepromFile(tmp_path / "missing" / "eeprom.bin")


def test_the_world_advances_while_nobody_is_connected():
    times_us = []
    line = SerialLine(UnoEmulator())
    world = SimpleNamespace(advance_to=times_us.append)
    server = BoardServer(line, TcpPort(0), RealClock(), world=world)
    with server:
        assert becomes_true(lambda: len(times_us) > 3)
    assert times_us == sorted(times_us)
