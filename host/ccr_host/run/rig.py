"""Composition root of a run: turns device and tracker URIs into a board and a tracker.

This is the only place that knows what is real and what is simulated.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import ExitStack, closing, contextmanager
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ccr_host.config import Description
from ccr_host.emulator.board import UnoEmulator
from ccr_host.emulator.pty_port import PtyPort
from ccr_host.emulator.serial_line import SerialLine
from ccr_host.emulator.server import BackgroundServer, BoardServer
from ccr_host.errors import ConfigError
from ccr_host.link.board_config import board_config
from ccr_host.link.client import Client, TelemetryObserver
from ccr_host.link.messages import StateReport
from ccr_host.link.transport import Transport, open_transport
from ccr_host.link.uri import DeviceKind, DeviceUri, parse_device_uri
from ccr_host.run.clock import Clock, RealClock, VirtualClock
from ccr_host.run.observer import RunObserver
from ccr_host.run.options import RunOptions
from ccr_host.simavr.board import SimavrBoard
from ccr_host.simavr.cosim import SimavrCoSimulation
from ccr_host.simavr.files import find_firmware
from ccr_host.simavr.flash_image import read_flash_image
from ccr_host.simavr.line import SimavrLine
from ccr_host.tracking.tracker import Tracker
from ccr_host.tracking.twin_tracker import TwinTracker
from ccr_host.twin.camera import Camera
from ccr_host.twin.cosim import CoSimulation
from ccr_host.twin.robot import TwinRobot
from ccr_host.twin.scene import TwinScene

KNOWN_TRACKERS = "twin:"


@dataclass(frozen=True)
class Rig:
    """What the control loop works with."""

    clock: Clock
    client: Client
    tracker: Tracker
    scene: TwinScene | None
    """The simulated robot; None where the robot is real."""

    def start_path_clock(self, time_us: int) -> None:
        """Zero of the disturbances that the description times."""
        if self.scene is not None:
            self.scene.start_path_clock(time_us)

    def true_tip_mm(self) -> NDArray[np.float64] | None:
        """True f, (3,), for the metrics only; None where the robot is real."""
        return None if self.scene is None else self.scene.true_tip_mm()


def is_simulated(options: RunOptions) -> bool:
    """Whether a run needs nothing outside this process and no real time.

    Raises:
        ConfigError: the device URI is not one.
    """
    return parse_device_uri(options.device).in_process and not options.realtime


@contextmanager
def open_rig(options: RunOptions, description: Description, observer: RunObserver) -> Iterator[Rig]:
    """Connect, configure the board, and make the robot safe on the way out, whatever happens.

    Raises:
        ConfigError: unknown URI, or a description that the board cannot take.
        DeviceError: no board, or not one of ours.
    """
    device = parse_device_uri(options.device)
    if options.tracker != KNOWN_TRACKERS:
        raise ConfigError(f"tracker {options.tracker}: unknown form", f"use {KNOWN_TRACKERS}")
    session_seed, camera_seed = np.random.SeedSequence(options.seed).spawn(2)
    clock: Clock = VirtualClock() if is_simulated(options) else RealClock()
    robot = TwinRobot(description.twin)
    camera = Camera(description.tracker, np.random.default_rng(camera_seed))
    scene = TwinScene(robot, camera)
    with ExitStack() as stack:
        on_telemetry = _shown_to(observer)
        transport: Transport
        if device.kind is DeviceKind.EMULATOR:
            line = SerialLine(UnoEmulator())
            clock.attach(CoSimulation(line, scene))
            transport = line
        elif device.kind is DeviceKind.SIMAVR:
            transport = _simavr_line(device, stack)
            clock.attach(SimavrCoSimulation(transport, scene))
        else:
            clock.attach(scene)
            on_telemetry = _moving(scene, on_telemetry)
            transport = _open_port(device, description.link.baud, stack)
        client = stack.enter_context(
            Client(
                transport,
                clock,
                _session_generator(device, session_seed),
                on_frame=observer.frame,
                on_telemetry=on_telemetry,
            )
        )
        clock.attach(client)
        client.connect()
        client.configure(board_config(description))
        yield Rig(clock, client, TwinTracker(scene, clock), scene)


def _session_generator(device: DeviceUri, seed: np.random.SeedSequence) -> np.random.Generator:
    """Two hosts on one board must not share a session number, whatever their seeds."""
    return np.random.default_rng(seed) if device.in_process else np.random.default_rng()


def _simavr_line(device: DeviceUri, stack: ExitStack) -> SimavrLine:
    firmware = read_flash_image(find_firmware(device.address))
    board = stack.enter_context(closing(SimavrBoard(firmware)))
    return SimavrLine(board)


def _open_port(device: DeviceUri, baud: int, stack: ExitStack) -> Transport:
    if device.kind is DeviceKind.EMULATOR_PTY:
        server = BoardServer(SerialLine(UnoEmulator()), PtyPort(), RealClock())
        device = parse_device_uri(stack.enter_context(BackgroundServer(server)).uri)
    return open_transport(device, baud)


def _shown_to(observer: RunObserver) -> TelemetryObserver:
    def show(report: StateReport, time_us: int) -> None:
        observer.state(time_us, report)

    return show


def _moving(scene: TwinScene, then: TelemetryObserver) -> TelemetryObserver:
    """Let a board elsewhere move the twin: real board, simulated robot."""

    def follow(report: StateReport, time_us: int) -> None:
        scene.set_pulses_half_us(report.pulse_half_us)
        then(report, time_us)

    return follow
