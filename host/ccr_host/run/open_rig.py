"""Composition root of a run: turns device and tracker URIs into a board and a tracker.

This is the only place that knows what is real and what is simulated.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import ExitStack, closing, contextmanager
from dataclasses import replace

import numpy as np

from ccr_host.core.arrays import Array
from ccr_host.core.clock import Clock, RealClock, VirtualClock
from ccr_host.core.errors import DeviceError
from ccr_host.description.schema import Description
from ccr_host.link.board import TelemetryObserver, drawn_session
from ccr_host.link.board_config import board_config
from ccr_host.link.client import Client
from ccr_host.link.exchange import Transport
from ccr_host.link.messages import State, StateReport
from ccr_host.link.transport import (
    DeviceKind,
    DeviceUri,
    open_transport,
    parse_device_uri,
)
from ccr_host.run.observer import RunObserver
from ccr_host.run.options import RigOptions
from ccr_host.run.recording import (
    HostClock,
    RecordedTracker,
    RecordedTransport,
    Tape,
    recorded_frames,
)
from ccr_host.run.rig import Rig
from ccr_host.run.tracker_rig import TrackerRig
from ccr_host.sim.board.board import SerialLine, UnoEmulator
from ccr_host.sim.robot.scene import CoSimulation, TwinScene
from ccr_host.sim.serving.ports import PtyPort
from ccr_host.sim.serving.server import BoardServer
from ccr_host.sim.simavr.board import SimavrBoard, SimavrCoSimulation, SimavrLine
from ccr_host.sim.simavr.flash_image import board_for, find_firmware, read_flash_image
from ccr_host.tracking.uri import parse_tracker_uri


def is_simulated(options: RigOptions) -> bool:
    """Whether a rig needs nothing outside this process and no real time.

    Raises:
        ConfigError: the device or tracker URI is invalid.
    """
    device, tracker = parse_device_uri(options.device), parse_tracker_uri(options.tracker)
    return device.in_process and tracker.in_process and not options.realtime


def sees_simulated_robot(options: RigOptions) -> bool:
    """Whether the board is outside this program, but the robot that is seen is simulated in it.

    Raises:
        ConfigError: the device or tracker URI is invalid.
    """
    return (
        parse_device_uri(options.device).is_outside
        and parse_tracker_uri(options.tracker).is_simulated
    )


def mismatch_of(options: RigOptions) -> str:
    """The mismatch of a board and a tracker of which only one is simulated; empty if there is none.

    Raises:
        ConfigError: the device or tracker URI is invalid.
    """
    device, tracker = parse_device_uri(options.device), parse_tracker_uri(options.tracker)
    if sees_simulated_robot(options):
        return f"the board is on {device}, but the robot that is seen is simulated ({tracker})"
    if not device.is_outside and not tracker.in_process:
        return (
            f"the camera is on {tracker}, but nothing moves its robot: simulated board ({device})"
        )
    return ""


@contextmanager
def open_rig(
    options: RigOptions,
    description: Description,
    observer: RunObserver,
    *,
    in_camera_frame: bool = False,
) -> Iterator[Rig]:
    """Connect and configure the board; make the robot safe on leaving, whatever happens.

    With ``in_camera_frame`` samples stay in the camera's frame even if it is registered.

    Raises:
        ConfigError: unknown URI, or a description that board or tracker cannot use.
        DeviceError: no board, not one of ours, or another one than described.
        TrackerError: no camera, or one that does not begin to track.
    """
    device, motors = parse_device_uri(options.device), description.robot.motors
    session_seed, camera_seed = np.random.SeedSequence(options.seed).spawn(2)
    tracker_uri = parse_tracker_uri(options.tracker)
    eyes = TrackerRig(tracker_uri, description, camera_seed, options.plant)
    clock: Clock = VirtualClock() if is_simulated(options) else RealClock()
    tape = Tape(observer.inputs)
    hosts_clock = HostClock(clock, tape)
    with ExitStack() as stack:
        stack.enter_context(tape.passed_on())
        on_telemetry = _shown_to(observer)
        if eyes.scene is not None and not device.in_process:
            on_telemetry = _moving(eyes.scene, on_telemetry)
        with hosts_clock.recorded_end():
            transport = connect_board(device, eyes.scene, clock, description, stack)
            stack.enter_context(eyes.running(clock))
        hosts_clock.wake()
        client = stack.enter_context(
            Client(
                RecordedTransport(transport, hosts_clock, tape),
                hosts_clock,
                session_number(device, session_seed),
                motors=motors,
                on_frame=recorded_frames(observer.frame, tape),
                on_telemetry=on_telemetry,
            )
        )
        stack.enter_context(hosts_clock.recorded_end())
        hosts_clock.attach(client)
        meet_board(client, description, device)
        tracker = eyes.tracker(
            clock, lambda: believed_rad(client, motors), in_camera_frame=in_camera_frame
        )
        hosts_tracker = RecordedTracker(tracker, tape, observer)
        clock.attach(hosts_tracker)
        eyes.wait_until_tracking(clock)
        hosts_tracker.advance_to(clock.now_us())
        hosts_clock.wake()
        rig = Rig(hosts_clock, client, hosts_tracker, tape, eyes.start_path_clock)
        yield replace(rig, true_tip_mm=eyes.scene.true_tip_mm) if eyes.scene else rig


def meet_board(client: Client, description: Description, device: DeviceUri) -> None:
    """Connect to the board, check its name unless it is simulated, and configure it.

    Raises:
        ConfigError: a description that the board cannot take.
        DeviceError: no board, not one of ours, or another one than described.
    """
    client.connect()
    if device.is_outside:
        client.require_name(description.robot.board_name)
    client.configure(board_config(description))


@contextmanager
def open_board(
    device: DeviceUri, description: Description, seed: int
) -> Iterator[tuple[Client, Clock]]:
    """A board alone, connected but not configured, and its clock.

    Raises:
        DeviceError: no board, or not one of ours.
    """
    clock: Clock = VirtualClock() if device.in_process else RealClock()
    with ExitStack() as stack:
        transport = connect_board(device, None, clock, description, stack)
        session = session_number(device, np.random.SeedSequence(seed))
        motors = description.robot.motors
        client = stack.enter_context(Client(transport, clock, session, motors=motors))
        clock.attach(client)
        client.connect()
        yield client, clock


def connect_board(
    device: DeviceUri,
    scene: TwinScene | None,
    clock: Clock,
    description: Description,
    stack: ExitStack,
) -> Transport:
    """Connect to the board; its simulated parts, and the scene, are attached to the clock.

    A simulated board is one that drives the described robot's servos.

    Raises:
        ConfigError: there is no firmware for it.
        DeviceError: there is no such port.
    """
    motors = description.robot.motors
    if device.kind is DeviceKind.EMULATOR:
        line = SerialLine(UnoEmulator(axes=motors))
        clock.attach(line if scene is None else CoSimulation(line, scene))
        return line
    if device.kind is DeviceKind.SIMAVR:
        simulated = _simavr_line(device, motors, stack)
        clock.attach(simulated if scene is None else SimavrCoSimulation(simulated, scene, motors))
        return simulated
    if scene is not None:
        clock.attach(scene)
    if device.kind is DeviceKind.EMULATOR_PTY:
        line = SerialLine(UnoEmulator(axes=motors))
        server = BoardServer(line, PtyPort(), RealClock())
        device = parse_device_uri(stack.enter_context(server).uri)
    return open_transport(device, description.link.baud)


def believed_rad(client: Client, motors: int) -> Array:
    """Motor angles last accepted by the board, (motors,); zeros before arming."""
    try:
        return client.accepted_rad
    except DeviceError:  # not armed yet
        return np.zeros(motors)


def session_number(device: DeviceUri, seed: np.random.SeedSequence) -> int:
    """Session number from the seed, but random on a board that other hosts may use."""
    return drawn_session(np.random.default_rng(seed if device.in_process else None))


def _simavr_line(device: DeviceUri, motors: int, stack: ExitStack) -> SimavrLine:
    name = board_for(motors)
    firmware = read_flash_image(find_firmware(device.address, name), name)
    board = stack.enter_context(closing(SimavrBoard(firmware)))
    return SimavrLine(board)


_ON_ITS_OWN = {
    (State.ACTIVE, State.HOLD): "the board holds the pose: no fresh target",
    (State.HOLD, State.RELAXING): "the board begins to lead the robot to rest: no fresh target",
}


def _shown_to(observer: RunObserver) -> TelemetryObserver:
    """Show every report, and tell of what the board does without being asked."""
    before: State | None = None

    def show(report: StateReport, time_us: int) -> None:
        nonlocal before
        observer.state(time_us, report)
        if before is not None and (before, report.state) in _ON_ITS_OWN:
            observer.event(time_us, _ON_ITS_OWN[before, report.state])
        before = report.state

    return show


def _moving(scene: TwinScene, then: TelemetryObserver) -> TelemetryObserver:
    """Let a board elsewhere move the twin: real board, simulated robot."""

    def follow(report: StateReport, time_us: int) -> None:
        scene.set_pulses_half_us(report.pulse_half_us)
        then(report, time_us)

    return follow
