"""Runs one twin with each of its rates and controllers."""

from __future__ import annotations

import functools
import json
from collections import defaultdict
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from typing import Any

import numpy as np

from ccr_host.control.registry import make_controller
from ccr_host.core.arrays import Array, BoolArray
from ccr_host.core.clock import cpu_ns, wall_ns
from ccr_host.core.wire import CDEG_PER_DEG
from ccr_host.description.schema import Servo
from ccr_host.link.messages import TICK_US, StateReport
from ccr_host.run.execute import execute, reference_of
from ccr_host.run.observer import RunObserver, RunSetup, StepRecord, true_errors_mm
from ccr_host.run.options import RunOptions
from ccr_host.run.summary import RunResult, ratio_to_twin_floor, summarise
from ccr_host.run.twin_floor import twin_floor_mm
from ccr_host.sim.board.board import SerialLine
from ccr_host.sim.robot.mechanics import UnfitTwinError
from ccr_host.sim.robot.scene import TwinScene
from ccr_host.tools.sweep.plan import Drive, TwinJob

_CALLS = ((TwinScene, "advance_to", "twin"), (SerialLine, "advance_to", "emulator"))
_CONTROLLER_CALLS = ("start", "approach", "step")


class CpuSeconds:
    """CPU time of one run in one thread: ``total`` and its ``parts``.

    The parts are timed by the wall clock, which is eight times faster to read than the CPU clock,
    and scaled to the total: on a busy machine all parts wait alike.
    """

    def __init__(self) -> None:
        self.wall_ns: dict[str, int] = defaultdict(int)
        self.total_wall_ns = 0
        self.total = 0.0

    @property
    def parts(self) -> dict[str, float]:
        """CPU seconds of ``twin``, ``emulator`` and ``controller``."""
        share = self.total / self.total_wall_ns
        return {name: self.wall_ns[name] * share for name in ("twin", "emulator", "controller")}


_running: ContextVar[CpuSeconds | None] = ContextVar("cpu seconds of this thread's run")


@contextmanager
def cpu_seconds_of(options: RunOptions) -> Iterator[CpuSeconds]:
    """Measure the CPU time of a run with these options in this thread."""
    for owner, name, part in _CALLS:
        _time(owner, name, part)
    controller = type(make_controller(options.controller, options.description()))
    for name in _CONTROLLER_CALLS:
        if hasattr(controller, name):
            _time(controller, name, "controller")
    spent = CpuSeconds()
    token = _running.set(spent)
    start_cpu_ns, start_ns = cpu_ns(), wall_ns()
    try:
        yield spent
    finally:
        spent.total = (cpu_ns() - start_cpu_ns) * 1e-9
        spent.total_wall_ns = wall_ns() - start_ns
        _running.reset(token)


def _time(owner: type, name: str, part: str) -> None:
    """Wrap a method so that it is timed inside `cpu_seconds_of`."""
    method = getattr(owner, name)
    if not hasattr(method, "__wrapped__"):
        setattr(owner, name, _timed(method, part))


def _timed(method: Callable[..., Any], part: str) -> Callable[..., Any]:
    @functools.wraps(method)
    def timed(*args: object, **kwargs: object) -> object:
        spent = _running.get(None)
        if spent is None:
            return method(*args, **kwargs)
        start_ns = wall_ns()
        try:
            return method(*args, **kwargs)
        finally:
            spent.wall_ns[part] += wall_ns() - start_ns

    return timed


_CDEG_ROUNDING = 1.0
_PULSE_ROUNDING_US = 0.5
_RAD_ROUNDING = 1e-9


class LimitWatch(RunObserver):
    """Checks commands, and the board's targets, setpoints, rates and pulses, against the limits."""

    def __init__(self) -> None:
        self.violations: set[str] = set()
        """Quantities found outside: command, target, setpoint, slew, pulse."""
        self._last: StateReport | None = None

    def begin(self, setup: RunSetup) -> None:
        servo = setup.description.servo
        self._low_deg, self._high_deg = np.array(servo.angle_min_deg), np.array(servo.angle_max_deg)
        self._slew_deg_s = np.array(servo.slew_deg_s)
        self._low_us, self._high_us = _pulse_limits_us(servo)

    def step(self, record: StepRecord) -> None:
        self._check_angles("command", np.degrees(record.q_rad), np.degrees(_RAD_ROUNDING))

    def state(self, time_us: int, report: StateReport) -> None:
        rounding_deg = _CDEG_ROUNDING / CDEG_PER_DEG
        setpoint_deg = np.array(report.setpoint_cdeg) / CDEG_PER_DEG
        self._check_angles("target", np.array(report.target_cdeg) / CDEG_PER_DEG, rounding_deg)
        self._check_angles("setpoint", setpoint_deg, rounding_deg)
        if self._last is not None:
            travel_deg = setpoint_deg - np.array(self._last.setpoint_cdeg) / CDEG_PER_DEG
            period_s = (report.tick - self._last.tick) * TICK_US * 1e-6
            self._check("slew", np.abs(travel_deg) <= self._slew_deg_s * period_s + rounding_deg)
        pulses_us = np.array(report.pulse_half_us) / 2
        inside = (pulses_us >= self._low_us) & (pulses_us <= self._high_us)
        self._check("pulse", inside | (pulses_us == 0))
        self._last = report

    def _check_angles(self, what: str, angles_deg: Array, rounding: float) -> None:
        low, high = self._low_deg - rounding, self._high_deg + rounding
        self._check(what, (angles_deg >= low) & (angles_deg <= high))

    def _check(self, what: str, good: BoolArray) -> None:
        if not good.all():
            self.violations.add(what)


def _pulse_limits_us(servo: Servo) -> tuple[Array, Array]:
    """Shortest and longest pulse allowed by the angle and pulse limits, us, (2,) each."""
    at_limits_us = np.array(servo.neutral_pulse_us) + np.array(
        [servo.angle_min_deg, servo.angle_max_deg]
    ) / 90.0 * np.array(servo.pulse_per_90_deg_us)
    low = np.maximum(at_limits_us.min(axis=0), servo.pulse_min_us) - _PULSE_ROUNDING_US
    high = np.minimum(at_limits_us.max(axis=0), servo.pulse_max_us) + _PULSE_ROUNDING_US
    return low, high


Row = dict[str, Any]

_NO_FIGURES = (
    "path", "controller", "surface", "planned_steps", "device", "tracker", "laps", "open", "faults",
    "skipped_steps", "board_holds", "board_relaxes", "clamped_commands", "jumped_pictures",
)  # fmt: skip
"""Keys of the JSON summary left out: given otherwise, the same for all runs, or real-time only."""

LOST_MM = 15.0
"""A run counts as diverged if its mean error over the last quarter of the path exceeds its floor by
this: two thirds of the error of the paper's open loop, twice that of its controller."""


def run_job(job: TwinJob) -> list[Row]:
    """One row for each drive; the floor of a rate is computed once for all controllers.

    Raises:
        ConfigError: the job refers to a file that exists only on another machine.
    """
    floors_mm: dict[float, float | None] = {}
    for drive in job.drives:
        options = job.options(drive)
        if options.rate_hz not in floors_mm:
            floors_mm[options.rate_hz] = twin_floor_mm(options, reference_of(options))
    return [_run(job, drive, floors_mm[drive[0]]) for drive in job.drives]


def failed_row(job: TwinJob, drive: Drive, why: str) -> Row:
    """Row of a run without results."""
    return {**_identity(job, drive), "diverged": False, "within_limits": True, "fault": why}


def _run(job: TwinJob, drive: Drive, floor_mm: float | None) -> Row:
    options = job.options(drive)
    watch = LimitWatch()
    try:
        with cpu_seconds_of(options) as spent:
            result = execute(options, watch, lambda *_: None)
    except UnfitTwinError as error:
        return failed_row(job, drive, str(error))
    summary = summarise(result, twin_floor_mm=floor_mm)
    end_error_mm = _last_quarter_mm(result)
    return {
        **_identity(job, drive),
        **_flat(summary),
        "ratio": ratio_to_twin_floor(summary),
        "end_error_mm": end_error_mm,
        "diverged": end_error_mm is not None and end_error_mm > (floor_mm or 0.0) + LOST_MM,
        "within_limits": not watch.violations,
        "violations": " ".join(sorted(watch.violations)),
        "fault": summary["faults"][0] if summary["faults"] else "",
        **_cpu_columns(spent),
    }


def _identity(job: TwinJob, drive: Drive) -> Row:
    rate_hz, controller = drive
    return {
        "index": job.index,
        "path": job.base.path,
        "rate_hz": rate_hz,
        "controller": controller,
        "seed": job.base.seed,
        "overrides": json.dumps(job.base.overrides),
        "command": job.command(drive),
    }


def _flat(summary: dict[str, Any]) -> Row:
    """Figures of the JSON summary, nested ones named ``outer_inner``."""
    flat: Row = {}
    for key, value in summary.items():
        if isinstance(value, dict):
            flat |= {f"{key}_{inner}": figure for inner, figure in value.items()}
        elif key not in _NO_FIGURES:
            flat[key] = value
    return flat


def _last_quarter_mm(result: RunResult) -> float | None:
    """Mean true error over the last quarter of the executed steps."""
    errors_mm = true_errors_mm(result.records)
    if errors_mm is None or not len(errors_mm):
        return None
    quarter = -(-len(errors_mm) // 4)
    return float(np.linalg.norm(errors_mm[-quarter:], axis=1).mean())


def _cpu_columns(spent: CpuSeconds) -> Row:
    parts = spent.parts
    rest = spent.total - sum(parts.values())
    return {
        "cpu_s": spent.total,
        **{f"cpu_{part}_s": seconds for part, seconds in {**parts, "rest": rest}.items()},
    }
