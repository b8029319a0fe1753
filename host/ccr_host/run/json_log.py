"""Writes the log of a run as it happens: one JSON object a line.

Nothing in it comes from the wall clock, so in virtual time equal seeds give equal bytes.
"""

from __future__ import annotations

import json
from typing import Any, TextIO

from ccr_host.link.messages import StateReport
from ccr_host.run.observer import RunSetup
from ccr_host.run.step_record import StepRecord, Vector
from ccr_host.tracking.sample import Sample


class JsonLog:
    """Observer that writes the log."""

    def __init__(self, file: TextIO) -> None:
        self._file = file

    def begin(self, setup: RunSetup) -> None:
        """What is run: options and robot description."""
        options = {**vars(setup.options), "overrides": list(setup.options.overrides)}
        self._write(
            {"kind": "run", "options": options, "description": setup.description.model_dump()}
        )

    def frame(self, direction: str, time_us: int, data: bytes) -> None:
        """Bytes of one frame on the link, as sent or received."""
        self._write({"kind": "frame", "t_us": time_us, "dir": direction, "hex": data.hex()})

    def state(self, time_us: int, report: StateReport) -> None:
        """Nothing: it is in the frames."""

    def sample(self, sample: Sample) -> None:
        """A tracker sample that the control loop has used."""
        self._write(
            {
                "kind": "sample",
                "exposed_us": sample.exposed_us,
                "markers_mm": sample.markers_mm.tolist(),
            }
        )

    def step(self, record: StepRecord) -> None:
        """One control period."""
        self._write(
            {
                "kind": "step",
                "step": record.step,
                "time_s": record.time_s,
                "target_mm": record.target_mm.tolist(),
                "q_rad": record.q_rad.tolist(),
                "outcome": record.outcome.name.lower(),
                "detail": record.detail,
                "predicted_mm": record.predicted_mm.tolist(),
                "late": record.late,
                "measured_mm": _listed(record.measured_mm),
                "measured_age_us": record.measured_age_us,
                "true_mm": _listed(record.true_mm),
            }
        )
        self._file.flush()

    def event(self, time_us: int, text: str) -> None:
        """Something worth knowing when the log is read: phase changes, faults, interruptions."""
        self._write({"kind": "event", "t_us": time_us, "text": text})
        self._file.flush()

    def _write(self, content: dict[str, Any]) -> None:
        self._file.write(json.dumps(content, separators=(",", ":")) + "\n")


def _listed(vector: Vector | None) -> list[float] | None:
    return None if vector is None else vector.tolist()
