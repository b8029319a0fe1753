"""Serves emulated devices at the ports that the user asked for."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from ccr_host.core.addresses import host_and_port
from ccr_host.core.clock import RealClock
from ccr_host.description.schema import Description
from ccr_host.sim.board.board import UnoEmulator
from ccr_host.sim.board.eeprom import EepromFile
from ccr_host.sim.board.serial_line import SerialLine
from ccr_host.sim.polaris.line import faults_of, make_polaris
from ccr_host.sim.robot.scene import CoSimulation, TwinScene, make_plant
from ccr_host.sim.serving.ports import DEFAULT_HOST, PtyPort, TcpPort
from ccr_host.sim.serving.server import BoardServer, Station


@dataclass(frozen=True)
class ServedBoard:
    """A board and its port."""

    tcp_address: str | None
    """HOST:PORT, or None for a pseudo-terminal."""
    eeprom_file: Path | None
    """EEPROM kept across runs; None for an erased EEPROM each time."""
    axes: int
    """Number of servos that it drives."""
    boot_loader_us: int
    """Time for which the board does not listen after its port was opened."""


@dataclass(frozen=True)
class ServedCamera:
    """A Polaris that measures the simulated robot driven by the board."""

    tcp_address: str | None
    """HOST:PORT, or None for a pseudo-terminal."""
    description: Description
    """Description of the simulated robot and its camera."""
    plant: str
    """Name of the simulated robot, see `make_plant`."""
    seed: int
    """Seed of the camera's noise."""


@dataclass(frozen=True)
class Served:
    """A server ready to run, and the URIs of its devices."""

    server: BoardServer
    device_uri: str
    tracker_uri: str | None = None


def open_board(board: ServedBoard) -> Served:
    """Create a board and its port.

    Raises:
        ConfigError: the address or the file cannot be used.
    """
    line, port = SerialLine(_emulator(board)), _port(board.tcp_address, "--tcp")
    server = BoardServer(line, port, RealClock(), boot_loader_us=board.boot_loader_us)
    return Served(server, server.uri)


def open_board_with_camera(board: ServedBoard, camera: ServedCamera) -> Served:
    """Create a board, the twin driven by its pulses, and the camera that measures it.

    Raises:
        ConfigError: an address, the file or the description cannot be used.
    """
    description = camera.description
    camera_seed = np.random.SeedSequence(camera.seed).spawn(2)[1]
    faults = faults_of(description.polaris_faults, 0)
    polaris = make_polaris(
        description.tracker,
        camera_seed,
        # The port of another program cannot be removed, so an unplugged camera is a silent one.
        faults=replace(faults, silent_us=faults.silent_us + faults.unplugged_us, unplugged_us=()),
        paced=camera.tcp_address is None,
    )
    scene = TwinScene(make_plant(camera.plant, description), polaris.device.sensor)
    line = SerialLine(_emulator(board))
    board_port = _port(board.tcp_address, "--tcp")
    camera_port = _port(camera.tcp_address, "--polaris-tcp")
    server = BoardServer(
        line,
        board_port,
        RealClock(),
        boot_loader_us=board.boot_loader_us,
        world=CoSimulation(line, scene),
        beside=[Station(polaris, camera_port)],
    )
    return Served(server, server.uri, _tracker_uri(camera_port))


def _emulator(board: ServedBoard) -> UnoEmulator:
    eeprom = EepromFile(board.eeprom_file) if board.eeprom_file else None
    return UnoEmulator(eeprom, axes=board.axes)


def _port(tcp_address: str | None, option: str) -> PtyPort | TcpPort:
    if tcp_address is None:
        return PtyPort()
    host, port = host_and_port(
        tcp_address, f"{option} {tcp_address}", f"{option} {DEFAULT_HOST}:5025", least_port=0
    )
    return TcpPort(port, host)


def _tracker_uri(port: PtyPort | TcpPort) -> str:
    scheme, _, address = port.uri.partition(":")
    return f"ndi:{address}" if scheme == "serial" else f"ndi+tcp:{address}"
