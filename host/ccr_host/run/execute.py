"""One run from its options to its result, in this process."""

from __future__ import annotations

from functools import lru_cache

from ccr_host.control.adaptive.surface import IdentifiedSurface
from ccr_host.control.base import Phase
from ccr_host.control.registry import make_controller
from ccr_host.core.clock import wall_ns
from ccr_host.core.errors import DeviceError, TrackerError, full_text
from ccr_host.description.schema import Description
from ccr_host.robot.kinematics import ConstantCurvature
from ccr_host.robot.paths import load_path
from ccr_host.robot.reference import Reference
from ccr_host.robot.workspace import MotorLimits, Surface, Workspace
from ccr_host.run.loop import PathRun, Progress
from ccr_host.run.observer import Observers, RunObserver, RunSetup, StepRecord
from ccr_host.run.open_rig import open_rig
from ccr_host.run.options import RunOptions
from ccr_host.run.recording import RecordedOperator
from ccr_host.run.rig import NoOperator, Operator, Rig, stopping_at_once
from ccr_host.run.robot_check import motion_check
from ccr_host.run.summary import RunResult
from ccr_host.tracking.markers.check import MarkerCheck


def reference_of(options: RunOptions) -> Reference:
    """The desired path, on the surface that the options name.

    Raises:
        ConfigError: unknown path, unusable file or description, laps of an open path, or a robot
            that was not identified.
    """
    if options.surface == "robot":
        surface: Surface = _identified_surface(options.description().model_dump_json())
    else:
        surface = workspace_of(options)
    return load_path(options.path, options.rate_hz, surface).repeated(options.laps)


@lru_cache(maxsize=1)
def _identified_surface(description: str) -> IdentifiedSurface:
    """Kept, as its fit takes seconds of CPU in plain Python."""
    return IdentifiedSurface(Description.model_validate_json(description))


def workspace_of(options: RunOptions) -> Workspace:
    """What the robot reaches according to (10)."""
    description = options.description()
    return Workspace(ConstantCurvature(description.robot), MotorLimits.of(description.servo))


def execute(
    options: RunOptions,
    observer: RunObserver,
    on_step: Progress,
    operator: Operator | None = None,
) -> RunResult:
    """Execute a run, and return its result even if it ended early.

    Whatever ends it (a device or tracker fault, Ctrl-C, the operator's stop or a defect), the
    robot is made safe, the result contains the steps done so far, and ``failure`` says why.

    Raises:
        ConfigError: the options are unusable; nothing was started.
    """
    start_ns = wall_ns()
    description = options.description()
    reference = reference_of(options)
    controller = make_controller(options.controller, description)
    markers = None if options.effective_checks == "none" else MarkerCheck(description)
    motion = motion_check(options, controller, description, reference)
    observer.begin(RunSetup(options, description, reference))
    records: list[StepRecord] = []

    def keep(step: int, steps: int, record: StepRecord) -> None:
        records.append(record)
        on_step(step, steps, record)

    failure: Exception | KeyboardInterrupt | None = None
    rig: Rig | None = None
    try:
        with open_rig(options, description, observer) as rig:
            heard = RecordedOperator(operator, rig.tape) if operator else NoOperator()
            with stopping_at_once(heard, rig.clock, rig.client, observer):
                PathRun(
                    rig,
                    controller,
                    reference,
                    description,
                    observer,
                    keep,
                    heard,
                    markers=markers,
                    motion=motion,
                ).execute()
    except (Exception, KeyboardInterrupt) as error:
        if rig is None and not isinstance(error, DeviceError | TrackerError | KeyboardInterrupt):
            raise
        failure = error
    end_us = rig.clock.now_us() if rig else 0
    observer.phase(end_us, Phase("done" if failure is None else _describe(failure)))
    return RunResult(
        options=options,
        reference=reference,
        records=records,
        link=rig.client.statistics if rig else None,
        failure=failure,
        wall_s=(wall_ns() - start_ns) * 1e-9,
        jumped_pictures=0 if markers is None else markers.jumped,
        remark="" if motion is None else motion.remark,
    )


def execute_quietly(options: RunOptions) -> RunResult:
    """Execute a run without a log; for worker processes."""
    return execute(options, Observers(), lambda *_: None)


def _describe(error: Exception | KeyboardInterrupt) -> str:
    return full_text(error) if isinstance(error, Exception) else str(error) or "interrupted"
