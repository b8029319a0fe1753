"""Controllers as users write them: slow ones, and ones that fail."""

import time
from dataclasses import replace
from typing import ClassVar

import numpy as np
import pytest

from ccr_host.control.base import Command, Outcome
from ccr_host.core.errors import CodeError
from ccr_host.core.plugins import Given
from ccr_host.link.messages import State
from ccr_host.record.keep import execute_logged
from ccr_host.record.log import topics
from ccr_host.record.log.reader import RunRecording
from ccr_host.record.replay import replay
from ccr_host.run.options import RunOptions
from ccr_host.run.summary import summarise

LONGER_THAN_THE_BOARD_WAITS_S = 3.5
"""A busy computer may stop any host for a second: the descriptions below have 2 s of validity at
10 Hz, and 0.5 s of holding."""
QUICK = (
    "control.settle_s=0.1",
    "link.relax_after_ms=500",
    "link.target_validity_periods=20",
    "link.arm_axis_ms=20",
)


class Still:
    """Stays at zero; what it is to do besides is told by method and step."""

    deeds: ClassVar[dict] = {}

    def __init__(self, description) -> None:
        pass

    def start(self, reference) -> Command:
        return self.answer("start", 0)

    def step(self, observation) -> Command:
        return self.answer("step", observation.step)

    def answer(self, method: str, step: int) -> Command:
        deed = self.deeds.get((method, step))
        command = Command(np.zeros(2), np.zeros((0, 3)), Outcome.SOLVED)
        return command if deed is None else deed(command)


class Leading(Still):
    """One that leads the robot itself."""

    def approach(self, observation) -> Command | None:
        self.calls = getattr(self, "calls", -1) + 1
        return None if self.calls == 5 else self.answer("approach", self.calls)


@pytest.fixture
def run(monkeypatch, tmp_path):
    """Execute a path with a controller that does something at one of its calls."""

    def execute(deeds, *, realtime=False, kind=Still):
        monkeypatch.setattr(kind, "deeds", deeds, raising=False)
        path = tmp_path / "short.csv"
        path.write_text("t_s,y_mm,z_mm\n0,0,30\n4,0,35\n")
        options = RunOptions(
            path=str(path),
            controller=Given(kind),
            rate_hz=10.0,
            realtime=realtime,
            overrides=QUICK,
        )
        (tmp_path / "kept").mkdir(exist_ok=True)
        return execute_logged(options, tmp_path / "kept", lambda *_: None)

    return execute


def dawdle(command: Command) -> Command:
    time.sleep(LONGER_THAN_THE_BOARD_WAITS_S)
    return command


@pytest.mark.long
@pytest.mark.parametrize("call", [("start", 0), ("approach", 2), ("step", 0), ("step", 4)])
def test_a_controller_may_take_its_time_wherever_it_likes_and_the_board_is_fed(
    run, tmp_path, call
) -> None:
    kind = Still if call == ("start", 0) else Leading
    result = run({call: dawdle}, realtime=True, kind=kind)
    assert result.failure is None
    summary = summarise(result)
    assert summary["board_holds"] == summary["board_relaxes"] == 0
    assert summary["steps"] == 41
    late = [record.step for record in result.records if record.late]
    assert (len(late) >= 30) == (call[0] == "step")
    assert replay(RunRecording(tmp_path / "kept"), controller=Given(kind)).difference is None


def raising(error):
    def deed(command):
        raise error

    return deed


UNUSABLE = {
    "nothing": lambda command: None,
    "numbers": lambda command: np.zeros(2),
    "NaN": lambda command: replace(command, q_rad=np.array([0.0, np.nan])),
    "infinite": lambda command: replace(command, q_rad=np.array([np.inf, 0.0])),
    "complex": lambda command: replace(command, q_rad=np.array([1j, 0.0])),
    "three angles": lambda command: replace(command, q_rad=np.zeros(3)),
    "a matrix": lambda command: replace(command, q_rad=np.zeros((2, 1))),
    "words": lambda command: replace(command, q_rad="left"),
    "prediction of NaN": lambda command: replace(command, predicted_mm=np.full((1, 3), np.nan)),
    "flat prediction": lambda command: replace(command, predicted_mm=np.zeros(3)),
    "no outcome": lambda command: replace(command, outcome="solved"),
    "ramp backwards": lambda command: replace(command, ramp_s=-1.0),
    "ramp of NaN": lambda command: replace(command, ramp_s=float("nan")),
    "endless ramp": lambda command: replace(command, ramp_s=3600.0),
}


@pytest.mark.long
@pytest.mark.parametrize("realtime", [False, True])
@pytest.mark.parametrize("call", [("start", 0), ("approach", 2), ("step", 0), ("step", 7)])
def test_a_controller_that_raises_ends_the_run_disarmed_with_log_and_traceback(
    run, tmp_path, call, realtime
) -> None:
    result = run({call: raising(ZeroDivisionError("my gain"))}, realtime=realtime, kind=Leading)
    assert isinstance(result.failure, CodeError)
    assert result.failure.exit_status == 2
    assert f"Leading.{call[0]} has failed: ZeroDivisionError: my gain" in str(result.failure)
    assert "robot is disarmed" in str(result.failure)
    assert "in deed" in result.failure.traceback
    assert len(result.records) == (call[1] if call[0] == "step" else 0)
    if call[0] == "start":
        assert not result.started, "it fails before the robot is armed, so nothing is kept"
        return
    recording = RunRecording(tmp_path / "kept")
    assert recording.end.is_complete
    states = [one.content["state"] for one in recording.messages(topics.STATE)]
    assert states[-1] == State.DISARMED.name.lower()
    assert replay(recording, controller=Given(Leading)).difference is None


class UnreadableError(BaseException):
    """Not an `Exception`, and without a message."""

    def __str__(self) -> str:
        raise ValueError("no text")


@pytest.mark.parametrize(
    "error",
    [
        SystemExit(7),
        MemoryError(),
        RecursionError("deep"),
        UnreadableError(),
        OSError("\x1b\n" * 999),
    ],
)
def test_nothing_that_a_controller_raises_gets_past_the_loop(run, error) -> None:
    failure = run({("step", 3): raising(error)}).failure
    assert isinstance(failure, CodeError)
    assert failure.cause.isprintable()
    assert len(failure.cause) < 400


def test_a_controller_that_changes_the_path_is_measured_against_the_true_one(run) -> None:
    class Cheat(Still):
        def start(self, reference) -> Command:
            reference.target_mm[:] = 0.0
            return super().start(reference)

    honest, cheated = (run({}, kind=kind).records for kind in (Still, Cheat))
    for one, other in zip(honest, cheated, strict=True):
        np.testing.assert_array_equal(one.target_mm, other.target_mm)


@pytest.mark.long
@pytest.mark.parametrize("method", ["start", "step"])
@pytest.mark.parametrize("deed", UNUSABLE.values(), ids=UNUSABLE)
def test_an_answer_that_is_no_command_ends_the_run_disarmed(run, deed, method) -> None:
    result = run({(method, 3 if method == "step" else 0): deed})
    assert isinstance(result.failure, CodeError)
    assert result.failure.cause.startswith(f"Still.{method} has answered ")
    assert "\n" not in result.failure.cause
    assert len(result.records) == (3 if method == "step" else 0)


@pytest.mark.filterwarnings("error::RuntimeWarning")
@pytest.mark.parametrize("angle", [2.0, -3.0, 1e300])
def test_commands_beyond_the_limits_are_clamped_and_counted(run, angle) -> None:
    far = {("step", step): lambda c: replace(c, q_rad=np.array([angle, 0.0])) for step in (4, 5)}
    result = run(far)
    assert result.failure is None
    assert summarise(result)["clamped_commands"] == 2


def test_a_controller_that_cannot_be_made_is_told_with_its_traceback(run, monkeypatch) -> None:
    def unmakable(self, description) -> None:
        raise KeyError("gain")

    monkeypatch.setattr(Still, "__init__", unmakable)
    with pytest.raises(CodeError, match="KeyError: 'gain'") as failed:
        run({})
    assert "unmakable" in failed.value.traceback


def test_a_controller_without_a_step_is_refused_before_the_robot_moves(run) -> None:
    class Unfinished:
        def __init__(self, description) -> None:
            pass

        def start(self, reference) -> None:
            pass

    with pytest.raises(CodeError, match="'Unfinished' object has no attribute 'step'"):
        run({}, kind=Unfinished)
