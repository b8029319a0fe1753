"""Which serial port is the UNO's."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Final, Protocol

from serial.tools import list_ports

from ccr_host.errors import ConfigError, DeviceError
from ccr_host.link.transport import open_transport
from ccr_host.link.uri import parse_device_uri

_UNO: Final = frozenset(
    {(0x2341, 0x0043), (0x2341, 0x0001), (0x2A03, 0x0043), (0x2341, 0x0243), (0x2341, 0x006A)}
)
"""USB vendor and product, from boards.txt of the Arduino core."""
_BRIDGE: Final = frozenset({(0x1A86, 0x7523), (0x0403, 0x6001), (0x10C4, 0xEA60)})
"""USB-to-serial chips of compatible boards, and of much else: CH340, FT232R, CP2102."""


class PortInfo(Protocol):
    """What pyserial tells of a port."""

    device: str
    vid: int | None
    pid: int | None


def choose_port(given: str | None, ports: Iterable[PortInfo] | None = None) -> str:
    """The given port, or the only one that an UNO can be on.

    Args:
        given: path of a port, which need not be a USB port; None to look for one.
        ports: to choose from; None for those of this machine.

    Raises:
        ConfigError: several fit.
        DeviceError: none fits, or it cannot be opened.
    """
    if given is None:
        given = _only_candidate(list_ports.comports() if ports is None else ports)
    open_transport(parse_device_uri(f"serial:{given}")).close()
    return given


def _only_candidate(ports: Iterable[PortInfo]) -> str:
    known = list(ports)
    for kind in (_UNO, _BRIDGE):
        fitting = [port.device for port in known if (port.vid, port.pid) in kind]
        if len(fitting) == 1:
            return fitting[0]
        if fitting:
            raise ConfigError(
                f"several boards: {', '.join(sorted(fitting))}", "name one with --port"
            )
    raise DeviceError(
        "no UNO found among the USB ports", "plug it in, or name its port with --port"
    )
