"""Serves emulated devices at the ports that the user asked for."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from ccr_host.core.addresses import host_and_port
from ccr_host.core.clock import RealClock
from ccr_host.description.schema import Description
from ccr_host.sim.board.board import SerialLine, UnoEmulator
from ccr_host.sim.board.eeprom import EepromFile
from ccr_host.sim.polaris.line import PolarisLine, faults_of, make_polaris
from ccr_host.sim.robot.scene import CoSimulation, TwinScene, make_plant
from ccr_host.sim.serving.ports import DEFAULT_HOST, PtyPort, TcpPort
from ccr_host.sim.serving.server import BoardServer, Port, Station


@dataclass(frozen=True)
class ServedCamera:
    """A Polaris that measures the simulated robot driven by the board."""

    tcp_address: str | None
    """HOST:PORT, or None for a pseudo-terminal."""
    plant: str
    """Name of the simulated robot, see `make_plant`."""
    seed: int
    """Seed of the camera's noise."""


def open_server(
    description: Description,
    tcp_address: str | None,
    eeprom_file: Path | None,
    boot_loader_us: int,
    camera: ServedCamera | None,
) -> tuple[BoardServer, str | None]:
    """Create a board that drives the robot's servos, and its port; the URI of the camera, if any.

    Without an address the board is on a pseudo-terminal; without a file its EEPROM is erased.

    Raises:
        ConfigError: an address, the file or the description cannot be used.
    """
    eeprom = EepromFile(eeprom_file) if eeprom_file else None
    line = SerialLine(UnoEmulator(eeprom, axes=description.robot.motors))
    board_port = _port(tcp_address, "--tcp")
    world, beside = None, []
    if camera is not None:
        polaris = _polaris(description, camera)
        world = CoSimulation(
            line, TwinScene(make_plant(camera.plant, description), polaris.device.sensor)
        )
        beside = [Station(polaris, _port(camera.tcp_address, "--polaris-tcp"))]
    server = BoardServer(
        line, board_port, RealClock(), boot_loader_us=boot_loader_us, world=world, beside=beside
    )
    return server, _tracker_uri(beside[0].port) if beside else None


def _polaris(description: Description, camera: ServedCamera) -> PolarisLine:
    faults = faults_of(description.polaris_faults, 0)
    return make_polaris(
        description.tracker,
        np.random.SeedSequence(camera.seed).spawn(2)[1],
        # The port of another program cannot be removed, so an unplugged camera is a silent one.
        faults=replace(faults, silent_us=faults.silent_us + faults.unplugged_us, unplugged_us=()),
        paced=camera.tcp_address is None,
    )


def _port(tcp_address: str | None, option: str) -> Port:
    if tcp_address is None:
        return PtyPort()
    host, port = host_and_port(
        tcp_address, f"{option} {tcp_address}", f"{option} {DEFAULT_HOST}:5025", least_port=0
    )
    return TcpPort(port, host)


def _tracker_uri(port: Port) -> str:
    scheme, _, address = port.uri.partition(":")
    return f"ndi:{address}" if scheme == "serial" else f"ndi+tcp:{address}"
