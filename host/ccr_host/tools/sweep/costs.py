"""Where the CPU time of a run goes.

Like a profiler, it times some calls from outside, so that the runs themselves know nothing of it.
"""

from __future__ import annotations

import functools
from collections import defaultdict
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from typing import Any

from ccr_host.control.registry import make_controller
from ccr_host.core.clock import CpuStopwatch, Stopwatch
from ccr_host.run.options import RunOptions
from ccr_host.sim.board.serial_line import SerialLine
from ccr_host.sim.robot.scene import TwinScene

_CALLS = ((TwinScene, "advance_to", "twin"), (SerialLine, "advance_to", "emulator"))
_CONTROLLER_CALLS = ("start", "approach", "step")


class CpuSeconds:
    """CPU time of one run in one thread: ``total``, and of its ``parts``.

    The parts are timed by the wall clock, whose reading costs an eighth of that of the CPU clock,
    and are shares of the total: on a busy machine all parts wait alike.
    """

    def __init__(self) -> None:
        self.wall_us: dict[str, float] = defaultdict(float)
        self.total_wall_us = 0.0
        self.total = 0.0

    @property
    def parts(self) -> dict[str, float]:
        """CPU seconds of ``twin``, ``emulator`` and ``controller``."""
        share = self.total / self.total_wall_us
        return {name: self.wall_us[name] * share for name in ("twin", "emulator", "controller")}


_running: ContextVar[CpuSeconds | None] = ContextVar("cpu seconds of this thread's run")


@contextmanager
def cpu_seconds_of(options: RunOptions) -> Iterator[CpuSeconds]:
    """CPU time that a run of these options costs this thread until the context is left."""
    for owner, name, part in _CALLS:
        _time(owner, name, part)
    controller = type(make_controller(options.controller, options.description()))
    for name in _CONTROLLER_CALLS:
        if hasattr(controller, name):
            _time(controller, name, "controller")
    spent = CpuSeconds()
    token = _running.set(spent)
    cpu, wall = CpuStopwatch(), Stopwatch()
    try:
        yield spent
    finally:
        spent.total, spent.total_wall_us = cpu.elapsed_s(), wall.elapsed_us()
        _running.reset(token)


def _time(owner: type, name: str, part: str) -> None:
    """Time a method while a run's costs are asked for."""
    method = getattr(owner, name)
    if not hasattr(method, "__wrapped__"):
        setattr(owner, name, _timed(method, part))


def _timed(method: Callable[..., Any], part: str) -> Callable[..., Any]:
    @functools.wraps(method)
    def timed(*args: object, **kwargs: object) -> object:
        spent = _running.get(None)
        if spent is None:
            return method(*args, **kwargs)
        stopwatch = Stopwatch()
        try:
            return method(*args, **kwargs)
        finally:
            spent.wall_us[part] += stopwatch.elapsed_us()

    return timed
