import pytest

from ccr_host.core.errors import ConfigError
from ccr_host.link.transport import DeviceKind, open_transport, parse_device_uri


@pytest.mark.parametrize(
    ("text", "kind", "address"),
    [
        ("emulator:", DeviceKind.EMULATOR, ""),
        ("emulator+pty:", DeviceKind.EMULATOR_PTY, ""),
        ("serial:/dev/ttyACM0", DeviceKind.SERIAL, "/dev/ttyACM0"),
        ("serial:COM3", DeviceKind.SERIAL, "COM3"),
        ("serial:\\\\.\\COM12", DeviceKind.SERIAL, "\\\\.\\COM12"),
        ("serial:/dev/cu.usbmodem14101", DeviceKind.SERIAL, "/dev/cu.usbmodem14101"),
        ("tcp://localhost:5025", DeviceKind.TCP, "localhost:5025"),
        ("tcp://[::1]:5025", DeviceKind.TCP, "[::1]:5025"),
    ],
)
def test_known_forms_are_read_and_written_back(text, kind, address):
    uri = parse_device_uri(text)
    assert (uri.kind, uri.address) == (kind, address)
    assert str(uri) == text


@pytest.mark.parametrize(
    "text",
    [
        "",
        "emulator",
        "/dev/ttyACM0",
        "usb:1",
        "serial:",
        "emulator:x",
        "tcp:localhost:1",
        "tcp://localhost",
        "tcp://:1",
        "tcp://localhost:0",
        "tcp://localhost:65536",
        "tcp://localhost:one",
        "simavr",
    ],
)
def test_other_forms_are_refused_with_a_cure(text):
    with pytest.raises(ConfigError) as refusal:
        parse_device_uri(text)
    assert text in refusal.value.cause
    assert refusal.value.cure


def test_unknown_form_lists_the_known_ones():
    with pytest.raises(
        ConfigError,
        match=r"emulator:, emulator\+pty:, simavr:\[FILE.elf\], serial:PORT, tcp://HOST:PORT",
    ):
        parse_device_uri("usb:1")


def test_emulator_is_no_port_to_open():
    with pytest.raises(ConfigError):
        open_transport(parse_device_uri("emulator:"))
