"""Puts an emulated board behind the port that a user has asked for."""

from __future__ import annotations

from pathlib import Path

from ccr_host.emulator.board import UnoEmulator
from ccr_host.emulator.eeprom import EepromFile
from ccr_host.emulator.pty_port import PtyPort
from ccr_host.emulator.serial_line import SerialLine
from ccr_host.emulator.server import BoardServer
from ccr_host.emulator.tcp_port import TcpPort
from ccr_host.errors import ConfigError
from ccr_host.run.clock import RealClock


def open_server(
    tcp_address: str | None, eeprom_file: Path | None, boot_loader_us: int
) -> BoardServer:
    """Make a board with its port, ready to run.

    Args:
        tcp_address: HOST:PORT, or None for a pseudo-terminal.
        eeprom_file: kept across runs; None for an erased EEPROM each time.
        boot_loader_us: how long the board is deaf after its port was opened.

    Raises:
        ConfigError: the address or the file cannot be used.
    """
    board = UnoEmulator(EepromFile(eeprom_file) if eeprom_file else None)
    port = PtyPort() if tcp_address is None else _tcp_port(tcp_address)
    return BoardServer(SerialLine(board), port, RealClock(), boot_loader_us=boot_loader_us)


def _tcp_port(address: str) -> TcpPort:
    host, colon, port = address.rpartition(":")
    if not (colon and host and port.isascii() and port.isdigit()):
        raise ConfigError(
            f"--tcp {address}: not a host and a port", "write e.g. --tcp 127.0.0.1:5025"
        )
    return TcpPort(int(port), host)
