"""The error for a nearly correct URI or address suggests the one that was meant."""

from __future__ import annotations

from socket import AF_INET, AF_INET6, SOCK_STREAM

import pytest

from ccr_host.core.addresses import host_and_port, listening_socket
from ccr_host.core.errors import ConfigError
from ccr_host.link.transport import parse_device_uri
from ccr_host.sim.serving.ports import TcpPort
from ccr_host.tracking.uri import parse_tracker_uri


def refusal_of(parse, text):
    with pytest.raises(ConfigError) as refused:
        parse(text)
    return f"{refused.value.cause}; {refused.value.cure}"


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("/dev/ttyACM0", "the scheme is missing; write serial:/dev/ttyACM0"),
        ("/dev/serial/by-id/usb-Arduino", "write serial:/dev/serial/by-id/usb-Arduino"),
        ("COM3", "write serial:COM3"),
        ("/dev/cu.usbmodem14101", "write serial:/dev/cu.usbmodem14101"),
        ("cu.usbmodem14101", "write serial:cu.usbmodem14101"),
        ("ttyACM0", "write serial:ttyACM0"),
        ("localhost:5025", "write tcp://localhost:5025"),
        ("[::1]:5025", "write tcp://[::1]:5025"),
        ("tcp:localhost:5025", "// is missing after the colon; write tcp://localhost:5025"),
        ("tcp:/localhost:5025", "write tcp://localhost:5025"),
        ("tcp:localhost", "write tcp://localhost:5025"),
        ("serial:localhost:5025", "not a serial port; write tcp://localhost:5025"),
        ("emulator", "the colon is missing; write emulator:"),
        ("simavr", "the colon is missing; write simavr:[FILE.elf]"),
        ("emulater:", "did you mean emulator:?"),
        ("seral:/dev/ttyACM0", "did you mean serial:PORT?"),
        ("twin:", "that is a tracker; give it with --tracker"),
        ("aruco:0", "that is a tracker; give it with --tracker"),
        ("ndi:/dev/ttyUSB0", "--tracker, or write serial:/dev/ttyUSB0"),
        ("igtl://localhost:18944", "--tracker, or write tcp://localhost:18944"),
        ("http://localhost:80", "unknown form; use one of emulator:, emulator+pty:"),
        ("", "unknown form"),
        ("tcp://localhost", "the port is missing; write e.g. tcp://localhost:5025"),
        ("tcp://[::1]", "the port is missing"),
        ("tcp://:5025", "the host is missing"),
        ("tcp://::1:5025", "an IPv6 address needs brackets, as in [::1]"),
        ("tcp://[::g]:5025", "[::g] is neither a host name nor an address"),
        ("tcp://a b:5025", "a b is neither"),
        ("tcp://localhost/x:5025", "localhost/x is neither"),
        ("tcp://user@host:5025", "user@host is neither"),
        ("tcp://localhost:x", "x is not a port number"),
        ("tcp://localhost:", "nothing is not a port number"),
        ("tcp://localhost:-1", "-1 is not a port number"),
        ("tcp://localhost:0", "port 0 is not in 1..65535"),
        ("tcp://localhost:99999999999999999999", "is not in 1..65535"),
    ],
)
def test_a_device_that_is_nearly_right_gets_the_one_that_was_meant(text, told):
    assert told in refusal_of(parse_device_uri, text)


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("/dev/ttyUSB0", "write ndi:/dev/ttyUSB0"),
        ("COM7", "write ndi:COM7"),
        ("camera.lab:8765", "write ndi+tcp://camera.lab:8765 or igtl://camera.lab:8765"),
        ("ndi:camera.lab:8765", "not a serial port; write ndi+tcp://camera.lab:8765"),
        ("igtl:localhost:18944", "write igtl://localhost:18944"),
        ("ndi+tcp://[fe80::1]", "the port is missing"),
        ("twin", "the colon is missing; write twin:"),
        ("ndi", "the colon is missing; write ndi:PORT"),
        ("ndi:", "the address is missing; write e.g. ndi:/dev/ttyUSB0"),
        ("arcuo:0", "did you mean aruco:N?"),
        ("aruco:/dev/video2", "write aruco:2"),
        ("aruco:99999999999999999999", "not the number of a camera; write e.g. aruco:0"),
        ("emulator:", "that is a device; give it with --device"),
        ("serial:/dev/ttyUSB0", "--device, or write ndi:/dev/ttyUSB0"),
        ("tcp://camera:8765", "--device, or write ndi+tcp://camera:8765 or igtl://camera:8765"),
    ],
)
def test_a_tracker_that_is_nearly_right_gets_the_one_that_was_meant(text, told):
    assert told in refusal_of(parse_tracker_uri, text)


def test_schemes_may_be_in_capitals():
    assert str(parse_device_uri("TCP://localhost:5025")) == "tcp://localhost:5025"
    assert str(parse_tracker_uri("NDI:COM3")) == "ndi:COM3"


def test_brackets_are_for_people_only():
    assert host_and_port("[::1]:80", "", "") == ("::1", 80)
    assert parse_tracker_uri("igtl://[::1]:18944").host_and_port == ("::1", 18944)


@pytest.mark.parametrize("host", ["127.0.0.1", "::1"])
def test_a_board_is_served_on_either_kind_of_address(host):
    port = TcpPort(0, host)
    parse_device_uri(port.uri)
    port.close()


@pytest.mark.parametrize("families", [[AF_INET6], [AF_INET6, AF_INET]])
def test_a_name_is_listened_on_at_the_address_it_has_if_it_has_both_at_ipv4(monkeypatch, families):
    places = {AF_INET6: ("::1", 0, 0, 0), AF_INET: ("127.0.0.1", 0)}
    found = [(family, SOCK_STREAM, 6, "", places[family]) for family in families]
    monkeypatch.setattr("socket.getaddrinfo", lambda *_, **__: found)
    with listening_socket("robot-pc", 0) as listening:
        assert listening.family == families[-1]


@pytest.mark.parametrize(
    ("host", "told"),
    [("nowhere.invalid", "unknown host name"), ("192.0.2.1", "not an address of this computer")],
)
def test_an_unusable_listening_address_is_reported_with_its_true_cause(host, told):
    assert told in refusal_of(lambda _: TcpPort(0, host), "")
