"""Stop and pause, in virtual time, seen on the wire."""

from pathlib import Path

import numpy as np
import pytest

from ccr_host.control.base import Phase
from ccr_host.core.clock import VirtualClock
from ccr_host.core.errors import CcrError
from ccr_host.link.framing import FrameDecoder
from ccr_host.link.messages import MESSAGES, Disarm, Message, SetTarget, State, StateReport, Stop
from ccr_host.run.execute import execute
from ccr_host.run.observer import RunObserver, StepRecord
from ccr_host.run.options import RunOptions
from ccr_host.run.rig import OperatorStop
from ccr_host.run.summary import RunResult


class Witness(RunObserver):
    """Sees the run, and is its operator as well: presses at chosen moments."""

    def __init__(self, *, stop_after_step: int | None = None, stop_while: str = "") -> None:
        self.wants_stop = False
        self.stop_after_step = stop_after_step
        self.stop_while = stop_while
        self.pauses_left = 0
        self.untold: list[str] = []
        self.sent: list[Message] = []
        self.reports: list[StateReport] = []
        self.events: list[str] = []
        self.pressed_at: int | None = None
        self.records: list[StepRecord] = []
        self._decoder = FrameDecoder()

    @property
    def wants_pause(self) -> bool:
        self.pauses_left -= 1
        return self.pauses_left >= 0

    def news(self) -> str:
        return self.untold.pop(0) if self.untold else ""

    def event(self, time_us: int, text: str) -> None:
        self.events.append(text)

    def frame(self, direction: str, time_us: int, data: bytes) -> None:
        if direction == "sent":
            self.sent += [MESSAGES[f.id].unpack(f.payload) for f in self._decoder.feed(data)]

    def state(self, time_us: int, report: StateReport) -> None:
        self.reports.append(report)

    def step(self, record: StepRecord) -> None:
        self.records.append(record)
        if record.step == self.stop_after_step:
            self.press()

    def phase(self, time_us: int, phase: Phase) -> None:
        self.events.append(phase.name)
        if phase.name == self.stop_while:
            self.press()

    def press(self) -> None:
        self.wants_stop = True
        self.pressed_at = len(self.sent)


@pytest.fixture
def options(tmp_path: Path) -> RunOptions:
    path = tmp_path / "short.csv"
    path.write_text("t_s,y_mm,z_mm\n0,0,30\n5,10,35\n")
    return RunOptions(str(path), "mpc")


def run(options: RunOptions, witness: Witness) -> RunResult:
    return execute(options, witness, lambda *_: None, witness)


@pytest.mark.long
@pytest.mark.parametrize(
    "stop_while",
    ["looking for the markers", "arming", "approaching the first point", "following the path",
     "disarming"],
)  # fmt: skip
def test_stop_works_at_once_in_every_phase(options: RunOptions, stop_while: str) -> None:
    witness = Witness(stop_while=stop_while)
    result = run(options, witness)
    assert isinstance(result.failure, OperatorStop)
    after = witness.sent[witness.pressed_at :]
    stop = next(i for i, message in enumerate(after) if isinstance(message, Stop))
    assert stop <= 1, "at most the request that was being sent comes before it"
    assert not any(isinstance(message, SetTarget | Disarm) for message in after[stop:])
    assert witness.reports[-1].state is State.STOPPED
    assert witness.reports[-1].pulse_half_us == (0, 0)
    assert witness.events[-1] == "stopped by the operator"


def test_a_stopped_run_keeps_the_steps_that_it_has_made(options: RunOptions) -> None:
    result = run(options, Witness(stop_after_step=2))
    assert [record.step for record in result.records] == [0, 1, 2]


@pytest.mark.long
def test_a_pause_in_virtual_time_changes_nothing_of_the_path(options: RunOptions) -> None:
    free, paused = Witness(), Witness()
    run(options, free)
    paused.pauses_left = 3
    run(options, paused)
    assert paused.events.count("paused") == 1
    assert len(free.records) == len(paused.records) == 6
    for one, other in zip(free.records, paused.records, strict=True):
        np.testing.assert_array_equal(one.measured_mm, other.measured_mm)
        assert one.end_us == other.end_us


@pytest.mark.parametrize("stall_at", ["step", "pause"])
def test_no_step_ends_within_a_pause_though_the_host_stalls(
    options: RunOptions, monkeypatch: pytest.MonkeyPatch, stall_at: str
) -> None:
    class Stalling(Witness):
        stalls = False
        continued_us: int | None = None
        steps_before = 0

        def step(self, record: StepRecord) -> None:
            super().step(record)
            if record.step == 1:
                self.stalls = stall_at == "step"
            elif record.step == 2:
                self.pauses_left = 3

        def phase(self, time_us: int, phase: Phase) -> None:
            super().phase(time_us, phase)
            if phase.name == "paused":
                self.steps_before, self.stalls = len(self.records), stall_at == "pause"
            elif self.steps_before and phase.name == "following the path":
                self.continued_us = time_us

    witness = Stalling()
    sleep_until_us = VirtualClock.sleep_until_us

    def overslept(clock: VirtualClock, time_us: int) -> None:
        late_us = 2_500_000 if witness.stalls else 0
        witness.stalls = False
        sleep_until_us(clock, time_us + late_us)

    monkeypatch.setattr(VirtualClock, "sleep_until_us", overslept)
    result = run(options, witness)
    assert result.failure is None
    after = witness.records[witness.steps_before :]
    assert len(after) >= 1
    assert witness.continued_us is not None
    assert all(record.end_us > witness.continued_us for record in after)


@pytest.mark.long
def test_stop_ends_a_pause(options: RunOptions) -> None:
    witness = Witness(stop_while="paused")
    witness.pauses_left = 1_000_000
    assert isinstance(run(options, witness).failure, OperatorStop)
    assert witness.reports[-1].state is State.STOPPED


def test_a_pause_that_nobody_can_end_ends_the_run_safely(options: RunOptions) -> None:
    class Deserted(Witness):
        @property
        def wants_pause(self) -> bool:
            raise CcrError("the live page ended during a pause")

    witness = Deserted()
    assert isinstance(run(options, witness).failure, CcrError)
    assert witness.reports[-1].state is State.DISARMED
    assert witness.reports[-1].pulse_half_us == (0, 0)


def test_what_becomes_of_the_page_is_an_event_of_the_run(options: RunOptions) -> None:
    witness = Witness()
    witness.untold = ["the live page has died", "the live page: drawing has failed"]
    told = list(witness.untold)
    assert run(options, witness).failure is None
    assert [text for text in witness.events if text.startswith("the live page")] == told
