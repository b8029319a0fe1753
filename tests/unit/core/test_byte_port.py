"""Every failure of a port becomes one error with the true cause."""

import errno
import os
import pty
import socket
import termios
import threading

import pytest
import serial

from ccr_host.core.clock import RealClock
from ccr_host.core.errors import DeviceError, TrackerError
from ccr_host.link.transport import open_transport, parse_device_uri
from ccr_host.sim.board.board import SerialLine, UnoEmulator
from ccr_host.sim.serving.ports import TcpPort
from ccr_host.sim.serving.server import BoardServer
from ccr_host.tracking.sources.ndi.port import SerialPort


@pytest.fixture
def terminal():
    """Path of a pseudo-terminal; its other end is open too."""
    master, slave = pty.openpty()
    yield os.ttyname(slave)
    os.close(master)
    os.close(slave)


def opened(text, baud=250_000):
    return open_transport(parse_device_uri(text), baud)


def failing(error):
    def fail(*_):
        raise error

    return fail


FAULTS_OF_A_DRIVER = [
    termios.error(errno.EIO, "Input/output error"),
    termios.error(errno.EINVAL, "Invalid argument"),
    termios.error("without a number"),
    OSError(errno.ENODEV, "No such device"),
    OverflowError("signed integer is greater than maximum"),
    ValueError("Failed to set custom baud rate (123456): [Errno 22] Invalid argument"),
]


@pytest.mark.parametrize("call", ["tcgetattr", "tcsetattr", "tcflush"])
@pytest.mark.parametrize("error", FAULTS_OF_A_DRIVER, ids=repr)
def test_a_driver_that_fails_while_the_port_opens_is_a_device_or_tracker_fault(
    terminal, call, error, monkeypatch
):
    monkeypatch.setattr(termios, call, failing(error))
    with pytest.raises(DeviceError, match=terminal):
        opened(f"serial:{terminal}")
    with pytest.raises(TrackerError, match=terminal):
        SerialPort(terminal)


@pytest.mark.parametrize("error", FAULTS_OF_A_DRIVER, ids=repr)
@pytest.mark.parametrize(
    ("call", "use"),
    [
        ("read", lambda port: port.read()),
        ("write", lambda port: port.write(b"x")),
        ("_reconfigure_port", lambda port: port.set_baud(9600)),
        ("_update_break_state", lambda port: port.set_break(True)),
    ],
)
def test_a_driver_that_fails_in_mid_run_is_a_tracker_fault(terminal, error, call, use, monkeypatch):
    port = SerialPort(terminal)
    monkeypatch.setattr(serial.Serial, call, failing(error))
    with pytest.raises(TrackerError, match=terminal):
        use(port)


def test_closing_a_port_that_is_gone_raises_nothing(terminal, monkeypatch):
    port = opened(f"serial:{terminal}")
    monkeypatch.setattr(serial.Serial, "close", failing(termios.error(errno.EIO, "gone")))
    port.close()


@pytest.mark.parametrize("baud", [1 << 31, 1 << 70, -1])
def test_a_rate_that_no_port_has_is_named_as_the_cause(terminal, baud):
    with pytest.raises(DeviceError, match="does not take this bit rate"):
        opened(f"serial:{terminal}", baud)


def fifo(folder):
    os.mkfifo(folder / "fifo")
    return folder / "fifo"


def text_file(folder):
    (folder / "notes.txt").write_text("no port")
    return folder / "notes.txt"


@pytest.mark.parametrize(
    "path",
    [fifo, text_file, lambda folder: folder, lambda _: "/dev/null", lambda _: "/dev/zero"],
)
def test_what_is_not_a_serial_port_is_reported(path, tmp_path):
    with pytest.raises(DeviceError, match=r"not a serial port.*ports of this computer"):
        opened(f"serial:{path(tmp_path)}")


@pytest.mark.parametrize(
    "name", ["/dev/ttyACM99", "COM3", "ttyACM0", "loop://", "socket://localhost:1", "/dev/null/x"]
)
def test_a_port_that_is_not_there_brings_those_that_are(name):
    with pytest.raises(DeviceError, match=r"no such port.*ports of this computer"):
        opened(f"serial:{name}")


def test_a_name_that_no_file_can_have_is_refused():
    with pytest.raises(DeviceError):
        opened("serial:/dev/tty\0S0")


def test_a_port_of_another_group_tells_how_to_join_it(monkeypatch):
    monkeypatch.setattr(os, "open", failing(PermissionError(errno.EACCES, "Permission denied")))
    with pytest.raises(DeviceError, match=r"permission denied.*dialout"):
        opened("serial:/dev/ttyACM0")


def test_a_port_that_another_program_holds_is_in_use(terminal):
    holder = opened(f"serial:{terminal}")
    with pytest.raises(DeviceError, match="in use by another program"):
        opened(f"serial:{terminal}")
    holder.close()


def test_an_unplugged_port_is_gone():
    master, slave = pty.openpty()
    port = opened(f"serial:{os.ttyname(slave)}")
    os.close(slave)
    os.close(master)
    with pytest.raises(DeviceError, match="the port is gone"):
        for _ in range(100):
            port.write(b"x")
            port.read()


def talk_until_lost(port):
    with pytest.raises(DeviceError) as lost:
        for _ in range(2000):
            port.write(b"\0")
            port.read()
            threading.Event().wait(0.001)
    return str(lost.value)


def test_a_busy_tcp_board_is_in_use_by_another_host():
    server = BoardServer(SerialLine(UnoEmulator()), TcpPort(0), RealClock())
    with server:
        first = opened(server.uri)
        assert "in use by another host" in talk_until_lost(opened(server.uri))
        first.close()


@pytest.mark.parametrize(
    ("greeting", "told"),
    [
        (b"Port already in use\n\r", "in use by another host"),
        (b"HTTP/1.1 400 Bad Request\r\n\r\n", 'not a board, it says "HTTP/1.1 400 Bad Request"'),
        (b"SSH-2.0-OpenSSH_9.2\r\n", "SSH-2.0-OpenSSH_9.2"),
        (b"", "closed the connection"),
        (b"\x03\x81\x05\x00\xff", "closed the connection"),
    ],
)
def test_what_the_other_end_says_before_it_hangs_up_is_passed_on(greeting, told):
    with socket.create_server(("127.0.0.1", 0)) as listening:

        def hang_up():
            client, _ = listening.accept()
            client.sendall(greeting)
            client.close()

        thread = threading.Thread(target=hang_up)
        thread.start()
        message = talk_until_lost(opened(f"tcp://127.0.0.1:{listening.getsockname()[1]}"))
        thread.join()
    assert told in message


def test_an_unknown_host_name_is_distinguished_from_a_refused_connection():
    with pytest.raises(DeviceError, match="unknown host name"):
        opened("tcp://nowhere.invalid:5025")


def test_a_host_stopped_while_it_wrote_has_not_lost_its_port(terminal, monkeypatch):
    port = opened(f"serial:{terminal}")
    write, expired = serial.Serial.write, iter([True])

    def stopped_once(self, data):
        if next(expired, False):
            raise serial.SerialTimeoutException("Write timeout")
        return write(self, data)

    monkeypatch.setattr(serial.Serial, "write", stopped_once)
    port.write(b"\x01\x02\x00")
    port.close()


def test_a_port_that_takes_nothing_is_lost(terminal, monkeypatch):
    port = opened(f"serial:{terminal}")
    monkeypatch.setattr(serial.Serial, "write", failing(serial.SerialTimeoutException("timeout")))
    with pytest.raises(DeviceError, match="nothing could be sent"):
        port.write(b"\x01\x02\x00")
    port.close()
