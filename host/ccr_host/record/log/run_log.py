"""Observer that writes the log of a run."""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from cobs import cobs
from pydantic_core import PydanticSerializationError, to_json

from ccr_host.control.base import Command, Observation, Phase
from ccr_host.core.arrays import Array
from ccr_host.core.stop_signals import signals_deferred
from ccr_host.link.messages import MESSAGES, Arm, Fault, State, StateReport
from ccr_host.record.folder import remove_earlier_run, versions
from ccr_host.record.log import topics, visuals
from ccr_host.record.log.files import LOG_PREFIX, TIMING_PREFIX, LogFiles
from ccr_host.record.log.sinks import BackgroundSink, DirectSink, Sink
from ccr_host.record.log.topics import TIMING_TOPICS, Topic, topics_of
from ccr_host.robot.kinematics import ConstantCurvature
from ccr_host.robot.reference import Reference
from ccr_host.robot.workspace import MotorLimits
from ccr_host.run.observer import RunObserver, RunSetup, StepRecord
from ccr_host.run.recording import TapePiece
from ccr_host.tracking.tracker import MarkerFrame, Sample


@contextmanager
def open_run_log(folder: Path, *, realtime: bool) -> Iterator[RunLog]:
    """The log in its folder, closed at the end, however often it is interrupted then.

    Files of an earlier run are removed once this one starts. In real time a background thread
    writes, and machine timings are put into the same files.
    """

    def open_sinks(of_robot: Sequence[Topic]) -> tuple[Sink, Sink | None]:
        with suppress(OSError):  # if it stays so, the log has the same trouble
            remove_earlier_run(folder)
        if realtime:
            return BackgroundSink(LogFiles(folder, LOG_PREFIX, of_robot), of_robot), None
        log, timing = (
            DirectSink(LogFiles(folder, prefix, of), of)
            for prefix, of in ((LOG_PREFIX, of_robot), (TIMING_PREFIX, TIMING_TOPICS))
        )
        return log, timing

    run_log = RunLog(open_sinks)
    try:
        yield run_log
    finally:
        with signals_deferred():
            run_log.close()


_SCENE_PERIOD_US = 200_000
"""Pictures for people: five a second, however fast the control loop is."""
_DIAGNOSTICS_PERIOD_US = 1_000_000
_REFERENCE_PIECE = 1000
_BACKBONE_POINTS = 13
_PREDICTION_DECIMALS = 4
_UNTIL_SAMPLE_IS_OLD_US = 250_000


class RunLog(RunObserver):
    """Turns what is observed into messages.

    They wait in memory until the robot is armed: a start that fails leaves no log, and the one of
    an earlier run in its place.

    Args:
        open_sinks: opens what takes all that repeats with the seed in virtual time, given its
            topics, and what takes that which measures the machine; None where that may stand in the
            log itself.
    """

    def __init__(self, open_sinks: Callable[[Sequence[Topic]], tuple[Sink, Sink | None]]) -> None:
        self._open_sinks = open_sinks
        self._log: Sink | None = None
        self._timing: Sink | None = None
        self._waiting: list[tuple[Topic, int, bytes]] = []
        self._next_scene_us = 0
        self._next_diagnostics_us = 0
        self._sample: Sample | None = None
        self._horizon_mm: Array = np.empty((0, 3))
        self._received = 0
        self._sent = 0
        self._phase = ""

    def begin(self, setup: RunSetup) -> None:
        reference = setup.reference
        self._topics = topics_of(setup.description.robot)
        content = {
            "versions": versions(),
            "options": vars(setup.options),
            "description": setup.description.model_dump(),
            "reference": {
                "name": reference.name,
                "period_s": reference.period_s,
                "samples": len(reference),
                "laps": reference.laps,
                **({"in_space": True} if reference.in_space else {}),
            },
        }
        self._write(topics.SETUP, 0, content)
        self._write_reference(reference)
        self._write(topics.DESIRED_PATH, 0, visuals.desired_path(0, reference))
        self._model = ConstantCurvature(setup.description.robot)
        self._limits = MotorLimits.of(setup.description.servo)

    def frame(self, direction: str, time_us: int, data: bytes) -> None:
        topic = topics.SENT if direction == "sent" else topics.RECEIVED
        self._sent += direction == "sent"
        self._received += direction != "sent"
        body = cobs.decode(data[:-1])
        kind = MESSAGES.get(body[0])
        if kind is Arm and self._log is None:
            self._start()
        name = f"0x{body[0]:02x}" if kind is None else kind.NAME
        self._write(topic, time_us, {"name": name, "sequence": body[1], "hex": data.hex()})

    def state(self, time_us: int, report: StateReport) -> None:
        content = {name: getattr(report, name) for name in _STATE_FIELDS}
        content["state"] = report.state.name.lower()
        content["fault"] = report.fault.name.lower()
        content["flags"] = int(report.flags)
        self._write(topics.STATE, time_us, content)
        if time_us >= self._next_diagnostics_us:
            self._next_diagnostics_us = time_us + _DIAGNOSTICS_PERIOD_US
            self._write(topics.DIAGNOSTICS, time_us, self._diagnostics(time_us, report))

    def marker_frame(self, time_us: int, frame: MarkerFrame) -> None:
        tools = {name: vars(tool) for name, tool in frame.tools.items()}
        self._write(topics.MARKER_FRAME, time_us, {**vars(frame), "tools": tools})

    def tracker_sample(self, time_us: int, sample: Sample) -> None:
        self._sample = sample
        self._write(topics.SAMPLE, time_us, vars(sample))

    def control(self, time_us: int, observation: Observation | None, command: Command) -> None:
        seen = observation
        self._horizon_mm = command.predicted_mm
        content = {
            "step": None if seen is None else seen.step,
            "tip_mm": None if seen is None else _listed(seen.tip_mm),
            "tip_age_us": None if seen is None else seen.tip_age_us,
            "accepted_rad": None if seen is None else seen.q_rad.tolist(),
            "command_rad": command.q_rad.tolist(),
            "ramp_s": command.ramp_s,
            "predicted_mm": command.predicted_mm.round(_PREDICTION_DECIMALS).tolist(),
            "outcome": command.outcome.value,
            "detail": command.detail,
            "iterations": command.iterations,
        }
        self._write(topics.CONTROL, time_us, content)

    def step(self, record: StepRecord) -> None:
        target_mm, measured_mm = record.target_mm.tolist(), _listed(record.measured_mm)
        content = {
            "step": record.step,
            "time_s": record.time_s,
            "target_mm": target_mm,
            "q_rad": record.q_rad.tolist(),
            "outcome": record.outcome.value,
            "detail": record.detail,
            "late": record.late,
            "measured_mm": measured_mm,
            "measured_age_us": record.measured_age_us,
            "true_mm": _listed(record.true_mm),
            "error_mm": None if measured_mm is None else math.dist(measured_mm, target_mm),
            "solve_us": record.solve_us if self._timing is None else None,
        }
        self._write(topics.STEP, record.end_us, content)
        if self._timing is not None:
            timing = {"step": record.step, "solve_us": record.solve_us}
            self._timing.write(topics.SOLVE_TIME, record.end_us, to_json(timing))
        if record.end_us >= self._next_scene_us:
            self._next_scene_us = record.end_us + _SCENE_PERIOD_US
            self._draw(record)

    def event(self, time_us: int, text: str) -> None:
        self._write(topics.EVENT, time_us, visuals.log_message(time_us, visuals.INFO, text))

    def phase(self, time_us: int, phase: Phase) -> None:
        if phase.name != self._phase:
            self._phase = phase.name
            content = visuals.log_message(time_us, visuals.INFO, phase.name, visuals.PHASE)
            self._write(topics.EVENT, time_us, content)

    def inputs(self, piece: TapePiece) -> None:
        times_us = [piece.start_us, *piece.times_us]
        content = {
            "start_us": piece.start_us,
            "tokens": piece.tokens,
            "steps_us": [after - before for before, after in pairwise(times_us)],
            "errors": [vars(error) for error in piece.errors],
        }
        self._write(topics.INPUTS, times_us[-1], content)

    @property
    def trouble(self) -> str:
        """What is missing in the log and why; empty if nothing is."""
        sinks = (self._log, self._timing)
        return next((sink.trouble for sink in sinks if sink is not None and sink.trouble), "")

    @property
    def started(self) -> bool:
        """Whether the robot was armed, and there is a log."""
        return self._log is not None

    def close(self) -> None:
        for sink in (self._log, self._timing):
            if sink is not None:
                sink.close()

    def _write(self, topic: Topic, time_us: int, content: dict[str, Any]) -> None:
        try:
            packed = to_json(content, inf_nan_mode="null", fallback=np.ndarray.tolist)
        except PydanticSerializationError:  # a file's name that is not UTF-8
            text = json.dumps(content, ensure_ascii=False, default=np.ndarray.tolist)
            packed = text.encode("utf-8", "replace")
        message = (topic, time_us, packed)
        if self._log is None:
            self._waiting.append(message)
        else:
            self._log.write(*message)

    def _start(self) -> None:
        self._log, self._timing = self._open_sinks(self._topics)
        for message in self._waiting:
            self._log.write(*message)
        self._waiting.clear()

    def _write_reference(self, reference: Reference) -> None:
        for start in range(0, len(reference), _REFERENCE_PIECE):
            piece = slice(start, start + _REFERENCE_PIECE)
            columns = ("time_s", "target_mm", "q_rad", "unavoidable_mm")
            content = {name: getattr(reference, name)[piece] for name in columns}
            self._write(topics.REFERENCE, 0, content)

    def _draw(self, record: StepRecord) -> None:
        time_us = record.end_us
        self._write(topics.POSE_DESIRED, time_us, visuals.pose(time_us, record.target_mm))
        if record.measured_mm is not None:
            frames = {"tip": record.measured_mm}
            self._write(topics.TRANSFORMS, time_us, visuals.transforms(time_us, frames))
            self._write(topics.POSE_MEASURED, time_us, visuals.pose(time_us, record.measured_mm))
        # The board takes no more than the limits, whatever was commanded.
        backbone_mm = self._model.backbone_mm(self._limits.clip(record.q_rad), _BACKBONE_POINTS)
        markers_mm = None if self._sample is None else self._sample.markers_mm
        if markers_mm is not None:
            markers_mm = markers_mm - markers_mm[0]
        scene = visuals.robot(time_us, backbone_mm, self._horizon_mm, markers_mm)
        self._write(topics.SCENE, time_us, scene)

    def _diagnostics(self, time_us: int, report: StateReport) -> dict[str, Any]:
        is_latched = report.state in (State.FAULT, State.STOPPED)
        board = visuals.diagnostic(
            "board",
            2 if is_latched else 0,
            report.state.name.lower(),
            {
                "fault": report.fault.name.lower() if report.fault is not Fault.NONE else "none",
                "link errors": report.link_errors,
                "free stack bytes": report.free_stack_bytes,
                "servo supply dV": report.supply_dv,
            },
        )
        link = visuals.diagnostic(
            "link", 0, "", {"frames sent": self._sent, "frames received": self._received}
        )
        return visuals.diagnostics(time_us, [board, link, self._tracker_status(time_us)])

    def _tracker_status(self, time_us: int) -> dict[str, Any]:
        if self._sample is None:
            return visuals.diagnostic("tracker", 1, "no sample yet", {})
        age_us = time_us - self._sample.exposed_us
        is_old = age_us > _UNTIL_SAMPLE_IS_OLD_US
        message = "no fresh sample" if is_old else "tracking"
        return visuals.diagnostic("tracker", int(is_old), message, {"sample age us": age_us})


_STATE_FIELDS = tuple(field.name for field in StateReport.FIELDS)


def _listed(vector: Array | None) -> list[float] | None:
    return None if vector is None else vector.tolist()
