"""Number of Python calls of a control step: the host's own work between two waits.

    python -m bench.step_calls [--rate 20] [--by-function]

Counted over the steps of a run in virtual time with a controller that computes nothing, including
Python functions of libraries. Not counted are the controller, work while the loop waits, and the
simulated hardware: board, line and camera.
"""

from __future__ import annotations

import argparse
import sys
from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from types import CodeType, FrameType

import numpy as np

from ccr_host import sim
from ccr_host.control.base import Command, Observation, Outcome
from ccr_host.core.clock import VirtualClock
from ccr_host.robot.reference import Reference
from ccr_host.run.execute import reference_of
from ccr_host.run.loop import PathRun
from ccr_host.run.observer import Observers, StepRecord
from ccr_host.run.open_rig import open_rig
from ccr_host.run.options import RunOptions
from ccr_host.tracking.markers.check import MarkerCheck
from ccr_host.tracking.sources import twin

_COMMAND = Command(np.zeros(2), np.zeros((0, 3)), Outcome.SOLVED)


class Trivial:
    """A controller that computes nothing."""

    name = "trivial"

    def start(self, reference: Reference) -> Command:
        return _COMMAND

    def step(self, observation: Observation) -> Command:
        return _COMMAND


_LEFT_OUT = (VirtualClock.sleep_until_us.__code__, Trivial.step.__code__)
_SIMULATION = (str(Path(sim.__path__[0])), str(twin.__file__))


class CallCounter:
    """Counts calls of Python functions, from the first step's end to the last step's."""

    def __init__(self, last: int) -> None:
        self.calls: Counter[CodeType] = Counter()
        self.steps = 0
        self._last = last
        self._within: FrameType | None = None

    def on_step(self, step: int, steps: int, record: StepRecord) -> None:
        """Callback of the loop at the end of each step."""
        if step == 0:
            sys.setprofile(self._profile)
        elif step == self._last:
            sys.setprofile(None)
        self.steps = step

    def _profile(self, frame: FrameType, event: str, _: object) -> None:
        if self._within is not None:
            if event == "return" and frame is self._within:
                self._within = None
        elif event == "call" and frame.f_code is not CallCounter.on_step.__code__:
            code = frame.f_code
            if code in _LEFT_OUT or code.co_filename.startswith(_SIMULATION):
                self._within = frame
            else:
                self.calls[code] += 1


def count(rate_hz: float) -> CallCounter:
    """Run the figure of eight with the controller that computes nothing."""
    options = RunOptions(path="8shape", rate_hz=rate_hz)
    description, reference = options.description(), reference_of(options)
    counter = CallCounter(len(reference) - 1)
    with open_rig(options, description, Observers()) as rig:
        PathRun(
            rig, Trivial(), reference, description, Observers(), counter.on_step,
            markers=MarkerCheck(description),
        ).execute()  # fmt: skip
    return counter


def main(arguments: Sequence[str] | None = None) -> None:
    """Print calls per step by file, or by function."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--rate", type=float, default=20.0, help="Hz")
    parser.add_argument("--by-function", action="store_true")
    options = parser.parse_args(arguments)
    counter = count(options.rate)
    groups: Counter[str] = Counter()
    for code, calls in counter.calls.items():
        file = code.co_filename.partition("ccr_host/")[2] or code.co_filename.rpartition("/")[2]
        groups[f"{file} {code.co_qualname}" if options.by_function else file] += calls
    for name, calls in groups.most_common():
        print(f"{calls / counter.steps:8.2f}  {name}")
    print(f"{counter.calls.total() / counter.steps:8.2f}  calls per step, {counter.steps} steps")


if __name__ == "__main__":
    main()
