"""What a log consists of: its topics and the schemas of their messages.

All messages are JSON. Lengths in ours are mm, angles rad, times us on the run's clock, as in the
rest of the host; Foxglove's own are metres.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

from pydantic_core import SchemaValidator

from ccr_host.control.base import Outcome
from ccr_host.record.log import schemas as foxglove
from ccr_host.record.log.schemas import (
    COUNT,
    FLAG,
    INTEGER,
    NUMBER,
    OBJECT,
    TEXT,
    Schema,
    array,
    described,
    nullable,
    record,
    validator,
)

_POINT_MM = described(array(NUMBER, 3), "f of (10): y, x and z of a path, in this order")
_ANGLES_RAD = array(NUMBER, 2)
_TIME_US = described(INTEGER, "on the run's clock")
_OUTCOME: Schema = {"type": "string", "enum": [outcome.value for outcome in Outcome]}


@dataclass(frozen=True, eq=False)
class Topic:
    """One kind of message."""

    name: str
    schema: Schema
    repeated: bool = False
    """Stands at the start of every file of a log, so that each can be read alone."""

    @property
    def schema_name(self) -> str:
        """Under which a viewer knows the schema."""
        title: str = self.schema["title"]
        return title

    def is_message(self, content: object) -> bool:
        """Whether content is of the types that the schema names."""
        return self._validator.isinstance_python(content)

    @cached_property
    def _validator(self) -> SchemaValidator:
        return validator(self.schema)


_REFERENCE = record(
    "ccr.ReferenceSummary",
    name=TEXT,
    period_s=NUMBER,
    samples=COUNT,
    laps={"type": "integer", "minimum": 1},
)

SETUP = Topic(
    "/run/setup",
    record(
        "ccr.RunSetup", versions=OBJECT, options=OBJECT, description=OBJECT, reference=_REFERENCE
    ),
    repeated=True,
)
REFERENCE = Topic(
    "/run/reference",
    record(
        "ccr.Reference",
        time_s=array(NUMBER),
        target_mm=array(_POINT_MM),
        q_rad=array(_ANGLES_RAD),
        unavoidable_mm=array(NUMBER),
    ),
)
EVENT = Topic("/run/event", foxglove.LOG)
INPUTS = Topic(
    "/run/inputs",
    record(
        "ccr.Inputs",
        start_us=_TIME_US,
        tokens=described(TEXT, "one letter an input, see docs/logs.md"),
        steps_us=described(array(INTEGER), "differences of the times that tokens carry"),
        errors=array(record("ccr.InputError", kind=TEXT, cause=TEXT, cure=TEXT)),
    ),
)
_FRAME = record("ccr.Frame", name=TEXT, sequence=COUNT, hex=described(TEXT, "as on the wire"))
SENT = Topic("/link/sent", _FRAME)
RECEIVED = Topic("/link/received", _FRAME)
STATE = Topic(
    "/board/state",
    record(
        "ccr.StateReport",
        tick=COUNT,
        state=TEXT,
        fault=TEXT,
        flags=COUNT,
        target_sequence=COUNT,
        target_age_ms=COUNT,
        target_cdeg=array(INTEGER, 2),
        setpoint_cdeg=array(INTEGER, 2),
        pulse_half_us=array(INTEGER, 2),
        link_errors=COUNT,
        free_stack_bytes=COUNT,
        supply_dv=COUNT,
    ),
)
MARKER_FRAME = Topic(
    "/tracker/frame",
    record(
        "ccr.MarkerFrame",
        exposed_us=_TIME_US,
        frame_number=INTEGER,
        points_mm=array(_POINT_MM),
        out_of_volume=array(FLAG),
        tools=described(OBJECT, "position_mm, quaternion (w, x, y, z) and error_mm by name"),
    ),
)
SAMPLE = Topic(
    "/tracker/sample",
    record(
        "ccr.Sample",
        exposed_us=_TIME_US,
        markers_mm=described(array(array(nullable(NUMBER), 3), 3), "M1, M2, M3; null where lost"),
    ),
)
CONTROL = Topic(
    "/control/command",
    record(
        "ccr.Control",
        step=nullable(INTEGER),
        tip_mm=nullable(_POINT_MM),
        tip_age_us=nullable(INTEGER),
        accepted_rad=nullable(_ANGLES_RAD),
        command_rad=_ANGLES_RAD,
        ramp_s=NUMBER,
        predicted_mm=array(_POINT_MM),
        outcome=_OUTCOME,
        detail=TEXT,
        iterations=nullable(INTEGER),
    ),
)
STEP = Topic(
    "/control/step",
    record(
        "ccr.Step",
        step=COUNT,
        time_s=described(NUMBER, "on the path's clock"),
        target_mm=_POINT_MM,
        q_rad=_ANGLES_RAD,
        outcome=_OUTCOME,
        detail=TEXT,
        late=FLAG,
        measured_mm=nullable(_POINT_MM),
        measured_age_us=nullable(INTEGER),
        true_mm=nullable(_POINT_MM),
        error_mm=nullable(NUMBER),
        solve_us=described(nullable(NUMBER), "in real time; in virtual time in files of its own"),
    ),
)
POSE_MEASURED = Topic("/pose/measured", foxglove.POSE_IN_FRAME)
POSE_DESIRED = Topic("/pose/desired", foxglove.POSE_IN_FRAME)
TRANSFORMS = Topic("/tf", foxglove.FRAME_TRANSFORMS)
DESIRED_PATH = Topic("/scene/path", foxglove.SCENE_UPDATE, repeated=True)
SCENE = Topic("/scene/robot", foxglove.SCENE_UPDATE)
DIAGNOSTICS = Topic("/diagnostics", foxglove.DIAGNOSTIC_ARRAY)

LOG_TOPICS = (
    SETUP, REFERENCE, EVENT, INPUTS, SENT, RECEIVED, STATE, MARKER_FRAME, SAMPLE,
    CONTROL, STEP, POSE_MEASURED, POSE_DESIRED, TRANSFORMS, DESIRED_PATH, SCENE, DIAGNOSTICS,
)  # fmt: skip

SOLVE_TIME = Topic("/timing/solve", record("ccr.SolveTime", step=COUNT, solve_us=NUMBER))
TIMING_TOPICS = (SOLVE_TIME,)
"""What measures the machine, where all else repeats with the seed: in files of its own."""
