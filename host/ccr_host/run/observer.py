"""What can be seen of a run while it happens: the log, the live page and whoever else looks on.

Nothing in it comes from the wall clock but ``StepRecord.solve_us``, so that in virtual time equal
seeds give equal logs.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from ccr_host.config import Description
from ccr_host.control.base import Command, Observation, Phase
from ccr_host.link.messages import StateReport
from ccr_host.robot.reference import Reference
from ccr_host.run.inputs.tape import TapePiece
from ccr_host.run.options import RunOptions
from ccr_host.run.step_record import StepRecord
from ccr_host.tracking.frame import MarkerFrame
from ccr_host.tracking.sample import Sample


@dataclass(frozen=True)
class RunSetup:
    """All that is settled before a run begins."""

    options: RunOptions
    description: Description
    reference: Reference


class RunObserver:
    """Looks on in the control loop's own thread: returns at once and never raises.

    To be inherited from: whoever looks on overrides what it wants to see.
    """

    def begin(self, setup: RunSetup) -> None:
        """Before anything else."""

    def frame(self, direction: str, time_us: int, data: bytes) -> None:
        """Bytes of one frame on the link, as sent (``sent``) or received (``received``)."""

    def state(self, time_us: int, report: StateReport) -> None:
        """A report of the board's state."""

    def marker_frame(self, time_us: int, frame: MarkerFrame) -> None:
        """What a camera has delivered, before its markers are identified."""

    def tracker_sample(self, time_us: int, sample: Sample) -> None:
        """A sample that has arrived, whether or not the control loop will use it."""

    def control(self, time_us: int, observation: Observation | None, command: Command) -> None:
        """What the controller was told and what it answered; no observation at its start."""

    def step(self, record: StepRecord) -> None:
        """The end of one control period."""

    def event(self, time_us: int, text: str) -> None:
        """Something worth knowing afterwards: faults, interruptions, what the board does alone."""

    def phase(self, time_us: int, phase: Phase) -> None:
        """What the run is doing from now on, or how much of that is done."""

    def inputs(self, piece: TapePiece) -> None:
        """The next piece of all that has come to the host from outside."""


class Observers(RunObserver):
    """Several observers as one."""

    def __init__(self, observers: Sequence[RunObserver] = ()) -> None:
        self._observers = tuple(observers)

    def begin(self, setup: RunSetup) -> None:
        for observer in self._observers:
            observer.begin(setup)

    def frame(self, direction: str, time_us: int, data: bytes) -> None:
        for observer in self._observers:
            observer.frame(direction, time_us, data)

    def state(self, time_us: int, report: StateReport) -> None:
        for observer in self._observers:
            observer.state(time_us, report)

    def marker_frame(self, time_us: int, frame: MarkerFrame) -> None:
        for observer in self._observers:
            observer.marker_frame(time_us, frame)

    def tracker_sample(self, time_us: int, sample: Sample) -> None:
        for observer in self._observers:
            observer.tracker_sample(time_us, sample)

    def control(self, time_us: int, observation: Observation | None, command: Command) -> None:
        for observer in self._observers:
            observer.control(time_us, observation, command)

    def step(self, record: StepRecord) -> None:
        for observer in self._observers:
            observer.step(record)

    def event(self, time_us: int, text: str) -> None:
        for observer in self._observers:
            observer.event(time_us, text)

    def phase(self, time_us: int, phase: Phase) -> None:
        for observer in self._observers:
            observer.phase(time_us, phase)

    def inputs(self, piece: TapePiece) -> None:
        for observer in self._observers:
            observer.inputs(piece)
