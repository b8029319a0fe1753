"""The front door: what ``import ccr_host`` offers to programs."""

from __future__ import annotations

import json
import warnings
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass
from functools import cached_property
from numbers import Real
from pathlib import Path
from typing import Any

import numpy as np

from ccr_host.control.base import Controller
from ccr_host.control.registry import DEFAULT_CONTROLLER, rate_note
from ccr_host.core.arrays import Array
from ccr_host.core.errors import ConfigError, DeviceError, TrackerError
from ccr_host.core.plugins import Given
from ccr_host.core.stop_signals import kill_interrupts
from ccr_host.description.schema import Description
from ccr_host.record.folder import TIMING_FILE, ResultFolder
from ccr_host.record.keep import execute_logged, keep_result
from ccr_host.record.log.reader import RunRecording
from ccr_host.record.log.tables import Arrays, arrays, tables_of
from ccr_host.record.report import read_run
from ccr_host.robot.workspace import MotorLimits
from ccr_host.run.execute import execute_quietly, reference_of
from ccr_host.run.igtl_server import published
from ccr_host.run.observer import Observers, RunObserver
from ccr_host.run.open_rig import is_simulated, open_rig
from ccr_host.run.options import RigOptions, RunOptions, SurfaceName
from ccr_host.run.rest_motion import command, move_to
from ccr_host.run.rig import Rig
from ccr_host.sim.robot.plant import TWIN, Plant
from ccr_host.tracking.tracker import RawTracker

_SAMPLE_TIMEOUT_US = 2_000_000
_LOOK_US = 10_000
_LONGEST_WAIT_S = 1e6


@dataclass(frozen=True)
class Run:
    """A recorded run."""

    folder: Path

    @cached_property
    def summary(self) -> dict[str, Any]:
        """The object that ``ccr-host track --json`` prints, see docs/command-line.md.

        For a run that was killed only the error statistics are known.
        """
        timing: dict[str, Any] = {}
        with suppress(OSError, ValueError):
            timing = json.loads((self.folder / TIMING_FILE).read_text(encoding="utf-8"))
        return {**read_run(self.folder).metrics, **timing}

    @property
    def steps(self) -> Arrays:
        """The table with one row per control step, see `table`."""
        return self.table("steps")

    def table(self, name: str) -> Arrays:
        """Read a table of the log; docs/logs.md lists the columns.

        Args:
            name: steps, commands, samples, states, frames or events.

        Returns:
            Columns by name, (N,) each, ready for ``pandas.DataFrame``. A missing number is NaN, a
            missing text is empty.

        Raises:
            ConfigError: no such table, or the log cannot be read.
        """
        recording = RunRecording(self.folder)
        tables = tables_of(recording.description.robot)
        for table in tables:
            if table.name == name:
                return arrays(recording, table)
        known = ", ".join(table.name for table in tables)
        raise ConfigError(f"no table {name} in the log of a run", f"one of {known}")


def load_run(folder: str | Path) -> Run:
    """Open a recorded run.

    Args:
        folder: the run's folder, or one file of its log.

    Raises:
        ConfigError: there is no log of a run.
    """
    path = _path(folder, "folder", "the folder of a run, or one of its files")
    _ = RunRecording(path).setup
    return Run(path)


class Robot:
    """A connected robot, real or simulated, created by `open_robot`.

    Any method raises DeviceError if the board is lost, refuses a command or has latched a fault.
    In simulation every connection, and so every run, starts with a new robot at rest.
    """

    def __init__(self, options: RigOptions) -> None:
        self.description = options.description()
        """The robot description with its overrides applied."""
        self._options = options
        self._limits = MotorLimits.of(self.description.servo)
        self._connection = ExitStack()
        self._rig: Rig | None = None
        self._is_open = self._is_armed = False

    @property
    def angles_deg(self) -> Array:
        """Motor angles in degrees, (motors,), as last accepted by the board.

        Raises:
            DeviceError: the robot is not armed.
        """
        return np.degrees(self._armed().client.accepted_rad)

    def arm(self) -> None:
        """Enable the servos and move the robot to its rest pose."""
        self._is_armed = False
        self._connected().client.arm()
        self._is_armed = True

    def move(self, q_deg: Sequence[float] | Array, settle_s: float = 0.5) -> None:
        """Move smoothly to motor angles and return when the robot is there.

        Args:
            q_deg: degrees, (motors,).
            settle_s: how long to hold the pose before returning.

        Raises:
            ConfigError: not one finite angle for each motor, or outside the limits, or no time to
                settle; nothing moves.
            DeviceError: the robot is not armed.
        """
        q_rad, rig = self._checked(q_deg), self._armed()
        _require_seconds(settle_s, "settle_s")
        move_to(rig, rig.client.accepted_rad, q_rad)
        while (report := rig.client.read_state()).setpoint_cdeg != report.target_cdeg:
            command(rig, q_rad)
        self.wait(settle_s)

    def wait(self, duration_s: float) -> None:
        """Let time pass; an armed robot holds its pose.

        Between calls nothing is sent: after ``link.relax_after_ms`` the board moves an armed robot
        to rest and latches a fault, as for any silent host.

        Raises:
            ConfigError: not a time.
        """
        rig = self._connected()
        _require_seconds(duration_s, "duration_s")
        end_us = rig.clock.now_us() + round(duration_s * 1e6)
        while self._is_armed and rig.clock.now_us() < end_us:
            command(rig, rig.client.accepted_rad)
        rig.clock.sleep_until_us(end_us)

    def tip_mm(self) -> Array:
        """Tip position as measured, f of (10), in mm, (3,): the y, x and z of paths and tables.

        Returns:
            The newest sample, unless it is older than ``control.stale_after_ms``; then the next.

        Raises:
            TrackerError: no markers within two seconds.
        """
        rig = self._connected()
        stale_us = self.description.control.stale_after_ms * 1000
        start_us = rig.clock.now_us()
        while (now_us := rig.clock.now_us()) - start_us <= _SAMPLE_TIMEOUT_US:
            sample = rig.tracker.newest()
            if sample is not None and now_us - sample.exposed_us <= stale_us:
                return sample.tip_mm
            self.wait(_LOOK_US * 1e-6)
        trouble = rig.tracker.trouble()
        raise TrackerError(
            f"no markers from {rig.tracker.name}" + (f": {trouble}" if trouble else ""),
            "check line of sight, measurement volume and markers",
        )

    def disarm(self) -> None:
        """Move the robot to rest and end the pulses; no effect if it is not armed."""
        if self._is_armed:
            self._is_armed = False
            self._connected().client.disarm()

    def stop(self) -> None:
        """Emergency stop: end the pulses; `clear_fault` and `arm` enable them again."""
        self._is_armed = False
        self._connected().client.stop()

    def clear_fault(self) -> None:
        """Acknowledge a latched fault or an emergency stop; the robot is then disarmed."""
        self._is_armed = False
        self._connected().client.clear_fault()

    def track(
        self,
        path: str | Path,
        controller: str | Controller | Callable[[Description], Controller] | None = None,
        *,
        rate_hz: float = 1.0,
        laps: int = 1,
        surface: SurfaceName = "model",
        unchecked: bool = False,
        with_open: bool | None = None,
        out: str | Path | None = None,
        publish: str | None = None,
        observers: Sequence[RunObserver] = (),
    ) -> Run:
        """Follow a path as ``ccr-host track`` does: it arms, tracks and disarms.

        The run uses a new connection, so that its log can be replayed.

        Args:
            path: a built-in path, or a file.
            controller: a name, FILE.py:CLASS, a class, or an object with its methods; by default
                `adaptive`.
            rate_hz: control steps per second.
            laps: number of laps of a closed path.
            surface: whose surface gives a lateral path its third coordinate.
            unchecked: skip the checks of markers and motion.
            with_open: also run the open loop for comparison; by default if simulated.
            out: folder for the results; ``runs/<date>-...`` by default.
            publish: ``igtl://[HOST]:PORT``: serve the run by OpenIGTLink.
            observers: notified of all events of the run.

        Raises:
            ConfigError: unusable options; nothing was started.
            CcrError, KeyboardInterrupt: the run ended early; the folder contains the results so
                far.
        """
        name = _name(controller or DEFAULT_CONTROLLER)
        options = RunOptions(
            **vars(self._options),
            path=str(_path(path, "path", "the name of a path, or a file")),
            controller=name,
            rate_hz=rate_hz,
            laps=laps,
            checks="none" if unchecked else "motion",
            surface=surface,
        )
        if note := rate_note(name, options.rate_hz, options.description()):
            warnings.warn(note, stacklevel=2)
        wanted_folder = None if out is None else _path(out, "out", "a folder for the results")
        reference = reference_of(options)
        self._connected()
        self._disconnect()
        wanted = is_simulated(options) if with_open is None else with_open
        open_loop = options.with_controller("open-loop").on_the_twin()
        title = f"{reference.name}-{name}"
        with ExitStack() as stack:
            folder = stack.enter_context(ResultFolder(wanted_folder, title))
            if publish is not None:
                observers = (*observers, stack.enter_context(published(publish)).observer)
            result = execute_logged(options, folder.path, lambda *_: None, observers)
            compared = wanted and name != open_loop.controller
            kept = keep_result(
                folder, result, (lambda: execute_quietly(open_loop)) if compared else None
            )
        troubles = result.remark, folder.trouble, result.log_trouble, kept.no_open_loop
        for trouble in filter(None, troubles):
            warnings.warn(f"{folder.path}: {trouble}", stacklevel=2)
        if kept.failure is not None:
            if folder.kept:
                kept.failure.add_note(f"saved in {folder.path}: {', '.join(folder.kept)}")
            raise kept.failure
        return Run(folder.path)

    @contextmanager
    def _open(self) -> Iterator[None]:
        self._is_open = True
        try:
            with self._connection:
                self._connected()
                yield
        finally:
            self._is_open = False

    def _connected(self) -> Rig:
        if not self._is_open:
            raise DeviceError("the connection is closed", "use the robot inside its with block")
        if self._rig is None:
            rig = open_rig(self._options, self.description, Observers())
            self._rig = self._connection.enter_context(rig)
        return self._rig

    def _disconnect(self) -> None:
        self._rig, self._is_armed = None, False
        self._connection.close()

    def _armed(self) -> Rig:
        if not self._is_armed:
            raise DeviceError("the robot is not armed", "call arm() first")
        return self._connected()

    def _checked(self, q_deg: object) -> Array:
        try:
            asked_deg = np.asarray(q_deg, dtype=np.float64)
        except (TypeError, ValueError, OverflowError):
            asked_deg = np.full(1, np.nan)
        lower_deg, upper_deg = np.degrees([self._limits.lower_rad, self._limits.upper_rad])
        if asked_deg.shape != lower_deg.shape or not np.isfinite(asked_deg).all():
            raise ConfigError(
                f"move to {q_deg!r}: not {len(lower_deg)} finite angles",
                "give one angle in degrees for each motor",
            )
        for motor, (angle, low, high) in enumerate(
            zip(asked_deg, lower_deg, upper_deg, strict=True)
        ):
            if not low <= angle <= high:
                raise ConfigError(
                    f"motor {motor + 1}: {angle:g} deg is outside its limits {low:g} .. {high:g}",
                    "stay inside, or change servo.angle_min_deg and servo.angle_max_deg",
                )
        return np.radians(asked_deg)


@contextmanager
def open_robot(
    *,
    robot: str | Path | None = None,
    device: str = "emulator:",
    tracker: str | Callable[[Description], RawTracker] = "twin:",
    plant: str | Callable[[Description], Plant] = TWIN,
    seed: int = 1,
    overrides: Iterable[str] = (),
    realtime: bool = False,
) -> Iterator[Robot]:
    """Connect to a robot for a ``with`` block; nothing is armed.

    However the block ends, including by an exception, Ctrl-C, SIGTERM or a closed terminal, the
    robot is made safe first: disarmed if possible, otherwise stopped.

    Args:
        robot: robot description file, or the name of a shipped one.
        device: device URI, see docs/command-line.md.
        tracker: tracker URI, FILE.py:CLASS, or a class that takes the description; a function that
            creates one will do unless the camera is simulated.
        plant: simulated robot: ``twin``, FILE.py:CLASS, or a class or function that creates one.
        seed: seed of all random numbers.
        overrides: ``section.key=value`` for the description, as with ``--set``.
        realtime: run in real time even if everything is simulated.

    Raises:
        ConfigError: unknown URI, or a description that board or tracker cannot use.
        DeviceError: no board, or another one than described.
        TrackerError: no camera, or one that does not start tracking.
        CodeError: a user-supplied class has failed.
    """
    options = RigOptions(
        robot=None if robot is None else str(_path(robot, "robot", "a description's name or file")),
        device=device,
        tracker=_name(tracker),
        plant=_name(plant),
        seed=seed,
        overrides=_texts(overrides),
        realtime=realtime,
    )
    made = Robot(options)
    with kill_interrupts(), made._open():
        yield made


def _path(value: object, what: str, wanted: str) -> Path:
    if not isinstance(value, str | Path) or "\0" in str(value):
        raise ConfigError(f"{what} = {value!r}: neither text nor a path", f"give {wanted}")
    return Path(value)


def _require_seconds(value: object, what: str) -> None:
    if not isinstance(value, Real) or not 0 <= float(value) <= _LONGEST_WAIT_S:
        raise ConfigError(
            f"{what} = {value!r}: no time", f"give seconds from 0 to {_LONGEST_WAIT_S:g}"
        )


def _texts(value: object) -> tuple[str, ...]:
    texts = tuple(value) if isinstance(value, Iterable) and not isinstance(value, str) else (None,)
    if not all(isinstance(text, str) for text in texts):
        raise ConfigError(
            f"overrides = {value!r}: not a list of texts", 'give e.g. ["twin.slack_mm=0.8"]'
        )
    return texts


def _name(plugin: object) -> str:
    return plugin if isinstance(plugin, str) else Given(plugin)
