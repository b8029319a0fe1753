"""Shows a recorded run to an observer, as the run itself did."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ccr_host.control.base import Command, Outcome, Phase
from ccr_host.core.errors import ConfigError
from ccr_host.record.log import topics
from ccr_host.record.log.reader import LogMessage, RunRecording
from ccr_host.record.log.visuals import PHASE
from ccr_host.run.observer import RunObserver, RunSetup, StepRecord
from ccr_host.tracking.tracker import Sample

FloatArray = NDArray[np.float64]

_SHOWN = (topics.SENT, topics.RECEIVED, topics.SAMPLE, topics.CONTROL, topics.STEP, topics.EVENT)


def play_run(source: Path, observer: RunObserver) -> None:
    """Show a recorded run, all at once.

    Args:
        source: the run's folder, or one file of its log.
        observer: gets the same calls as in the run.

    Raises:
        ConfigError: there is no log of a run that can be read.
    """
    recording = RunRecording(source)
    observer.begin(RunSetup(recording.options, recording.description, recording.reference))
    solve_us = recording.solve_times_us()
    try:
        for message in recording.messages(*_SHOWN):
            _show(message, observer, solve_us)
    except (KeyError, TypeError, ValueError) as error:
        raise ConfigError(
            f"recording {source}: a message of another version ({error})",
            "view it with the version that has written it",
        ) from None


def _show(message: LogMessage, observer: RunObserver, solve_us: dict[int, float]) -> None:
    content, time_us = message.content, message.time_us
    match message.topic:
        case topics.SENT.name:
            observer.frame("sent", time_us, bytes.fromhex(content["hex"]))
        case topics.RECEIVED.name:
            observer.frame("received", time_us, bytes.fromhex(content["hex"]))
        case topics.SAMPLE.name:
            observer.tracker_sample(time_us, _sample(content))
        case topics.CONTROL.name:
            observer.control(time_us, None, _command(content))
        case topics.STEP.name:
            observer.step(_step(content, time_us, solve_us.get(content["step"], 0.0)))
        case topics.EVENT.name if content["name"] == PHASE:
            observer.phase(time_us, Phase(content["message"]))
        case topics.EVENT.name:
            observer.event(time_us, content["message"])


def _sample(content: dict[str, Any]) -> Sample:
    markers_mm = np.array(content["markers_mm"], dtype=np.float64)  # None becomes NaN
    return Sample(content["exposed_us"], markers_mm)


def _command(content: dict[str, Any]) -> Command:
    return Command(
        q_rad=np.array(content["command_rad"]),
        predicted_mm=np.array(content["predicted_mm"]).reshape(-1, 3),
        outcome=Outcome(content["outcome"]),
        detail=content["detail"],
        ramp_s=content["ramp_s"],
    )


def _step(content: dict[str, Any], end_us: int, solve_us: float) -> StepRecord:
    return StepRecord(
        step=content["step"],
        end_us=end_us,
        time_s=content["time_s"],
        target_mm=np.array(content["target_mm"]),
        q_rad=np.array(content["q_rad"]),
        outcome=Outcome(content["outcome"]),
        detail=content["detail"],
        predicted_mm=np.empty((0, 3)),
        solve_us=solve_us,
        late=content["late"],
        measured_mm=_position(content["measured_mm"]),
        measured_age_us=content["measured_age_us"],
        true_mm=_position(content["true_mm"]),
    )


def _position(numbers: list[float] | None) -> FloatArray | None:
    return None if numbers is None else np.array(numbers)
