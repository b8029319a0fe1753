"""Addresses as users write them: HOST:PORT, and the URIs of devices and trackers."""

from __future__ import annotations

import difflib
import errno
import ipaddress
import re
import socket
from collections.abc import Mapping
from enum import Enum

from ccr_host.core.errors import ConfigError
from ccr_host.core.plugins import FORM, plugin_names

HIGHEST_PORT = 65_535
_SERIAL_PORT = re.compile(r"/dev/.*|(\\\\.\\)?COM\d+|(tty|cu\.)\w+", re.IGNORECASE)
_HOST = re.compile(r"[\w.-]+")
_HOST_AND_PORT = re.compile(r"([\w.-]+|\[[\da-fA-F:]+\]):\d+")


class Role(Enum):
    """The option that a URI belongs to."""

    DEVICE = "device"
    TRACKER = "tracker"


_FORMS: Mapping[Role, Mapping[str, str]] = {
    Role.DEVICE: {
        "emulator": "emulator:",
        "emulator+pty": "emulator+pty:",
        "simavr": "simavr:[FILE.elf]",
        "serial": "serial:PORT",
        "tcp": "tcp://HOST:PORT",
    },
    Role.TRACKER: {
        "twin": "twin:",
        "ndi-emulator": "ndi-emulator:",
        "ndi": "ndi:PORT",
        "ndi+tcp": "ndi+tcp://HOST:PORT",
        "igtl": "igtl://HOST:PORT",
        "aruco": "aruco:N",
        "replay": "replay:FILE",
    },
}
_SERIAL = {Role.DEVICE: "serial", Role.TRACKER: "ndi"}
_TCP = {Role.DEVICE: ("tcp",), Role.TRACKER: ("ndi+tcp", "igtl")}


def known_forms(role: Role) -> list[str]:
    """All forms of a URI, including those of installed packages, for messages."""
    forms = [*_FORMS[role].values()]
    if role is Role.TRACKER:
        added = [name for name in plugin_names("tracker") if name not in _FORMS[role]]
        forms += [*(f"{name}:[ADDRESS]" for name in added), f"{FORM}[:ADDRESS]"]
    return forms


def split_uri(role: Role, text: str) -> tuple[str, str]:
    """Scheme in lower case, and the text after the colon.

    Raises:
        ConfigError: not a scheme of this role, or one without an address that has one; the cure
            suggests what was probably meant.
    """
    scheme, colon, rest = text.partition(":")
    scheme = scheme.lower()
    if not colon or scheme not in _FORMS[role]:
        raise _unknown_form(role, text)
    if rest and _FORMS[role][scheme] == f"{scheme}:":
        raise ConfigError(f"{role.value} {text}: nothing may follow the colon", f"write {scheme}:")
    if scheme == _SERIAL[role] and _HOST_AND_PORT.fullmatch(rest):
        raise ConfigError(
            f"{role.value} {text}: a host and a port, not a serial port",
            f"write {_on_tcp(role, rest)}",
        )
    return scheme, rest


def _unknown_form(role: Role, text: str) -> ConfigError:
    other = Role.TRACKER if role is Role.DEVICE else Role.DEVICE
    scheme, colon, rest = text.partition(":")
    scheme = scheme.lower()
    forms = f"use one of {', '.join(known_forms(role))}"
    if colon and scheme in _FORMS[other]:
        problem, cure = f"that is a {other.value}", f"give it with --{other.value}"
        if scheme == _SERIAL[other]:
            cure += f", or write {_SERIAL[role]}:{rest}"
        elif scheme in _TCP[other]:
            cure += f", or write {_on_tcp(role, rest.lstrip('/'))}"
    elif _SERIAL_PORT.fullmatch(text):
        problem, cure = "the scheme is missing", f"write {_SERIAL[role]}:{text}"
    elif not colon and scheme in _FORMS[role]:
        problem, cure = "the colon is missing", f"write {_FORMS[role][scheme]}"
    elif near := difflib.get_close_matches(scheme, _FORMS[role], n=1):
        problem, cure = "unknown form", f"did you mean {_FORMS[role][near[0]]}? {forms}"
    elif _HOST_AND_PORT.fullmatch(text):
        problem, cure = "the scheme is missing", f"write {_on_tcp(role, text)}, or {forms}"
    else:
        problem, cure = "unknown form", forms
    return ConfigError(f"{role.value} {text}: {problem}", cure)


def _on_tcp(role: Role, address: str) -> str:
    return " or ".join(f"{scheme}://{address}" for scheme in _TCP[role])


def tcp_address(rest: str, subject: str, example: str) -> str:
    """HOST:PORT from the text after the scheme's colon.

    ``rest`` includes the slashes; ``subject``, the text that the user gave, and ``example``, a
    valid one, are for messages.

    Raises:
        ConfigError: not a valid address.
    """
    if not rest.startswith("//"):
        scheme = example.partition(":")[0]
        meant = f"{scheme}://{rest.lstrip('/')}" if _HOST_AND_PORT.fullmatch(rest) else example
        raise ConfigError(f"{subject}: // is missing after the colon", f"write {meant}")
    host, port = host_and_port(rest[2:], subject, example)
    return joined(host, port)


def host_and_port(text: str, subject: str, example: str, least_port: int = 1) -> tuple[str, int]:
    """Parse HOST:PORT; the brackets around an IPv6 address are removed.

    ``least_port`` is 0 where the system may choose the port; ``subject``, the text that the user
    gave, and ``example``, a valid one, are for messages.

    Raises:
        ConfigError: not a valid address.
    """
    host, colon, port = text.rpartition(":")
    bracketed = host.startswith("[") and host.endswith("]")
    problem = ""
    if text.endswith("]") or not colon:
        problem = "not a host and a port: the port is missing"
    elif not host:
        problem = "not a host and a port: the host is missing"
    elif not bracketed and (":" in host or host.startswith("[")):
        problem = "not a host and a port: an IPv6 address needs brackets, as in [::1]"
    elif not (_is_ipv6(host[1:-1]) if bracketed else _HOST.fullmatch(host)):
        problem = f"{host} is neither a host name nor an address"
    elif not (port.isascii() and port.isdigit()):
        problem = f"not a host and a port: {port or 'nothing'} is not a port number"
    elif len(port) > len(str(HIGHEST_PORT)) or not least_port <= int(port) <= HIGHEST_PORT:
        problem = f"port {port} is not in {least_port}..{HIGHEST_PORT}"
    if problem:
        raise ConfigError(f"{subject}: {problem}", f"write e.g. {example}")
    return host.strip("[]"), int(port)


def joined(host: str, port: int) -> str:
    """Format HOST:PORT, with brackets around an IPv6 address."""
    return f"[{host}]:{port}" if ":" in host else f"{host}:{port}"


def listening_socket(host: str, port: int) -> socket.socket:
    """Listen on an address of this computer; a host name's IPv4 address is preferred.

    An IPv6 address has no brackets here; port 0 takes a free one.

    Raises:
        ConfigError: the address cannot be used.
    """
    try:
        found = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM, flags=socket.AI_PASSIVE)
        family, *_, address = min(found, key=lambda one: one[0] != socket.AF_INET)
        return socket.create_server(address, family=family)
    except (OSError, UnicodeError) as error:
        cause, cure = _why_not_listening(error)
        raise ConfigError(f"cannot listen on {joined(host, port)}: {cause}", cure) from None


def _why_not_listening(error: OSError | UnicodeError) -> tuple[str, str]:
    if isinstance(error, socket.gaierror | UnicodeError):
        return "unknown host name", "give an address of this computer, e.g. 127.0.0.1"
    match error.errno:
        case errno.EADDRINUSE:
            return "already in use", "choose another port; 0 takes a free one"
        case errno.EACCES | errno.EPERM:
            return "not allowed", "choose a port above 1023; 0 takes a free one"
        case errno.EADDRNOTAVAIL | errno.EAFNOSUPPORT:
            return "not an address of this computer", "give one that is, e.g. 127.0.0.1"
    return error.strerror or str(error), "choose another address"


def _is_ipv6(text: str) -> bool:
    try:
        ipaddress.IPv6Address(text)
    except ValueError:
        return False
    return True
