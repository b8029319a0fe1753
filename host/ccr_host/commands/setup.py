"""The command ``ccr-host setup``."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from ccr_host.commands.options import (
    DeviceOption,
    KeepInOption,
    RealtimeOption,
    RobotOption,
    SeedOption,
    SetOption,
    TrackerOption,
    console,
    require_named_tracker,
)
from ccr_host.run.options import RigOptions

if TYPE_CHECKING:
    from rich.console import Console

    from ccr_host.tools.survey import Survey

_ROUNDS = 3
"""One finds what is to be corrected, the next one that nothing is left of it."""
_FIRST_PATH_S = 20
_FIRST_PATH_DEG = 15.0
"""Of both motors: well inside of what the tour has visited."""


def setup(
    context: typer.Context,
    robot: RobotOption = None,
    device: DeviceOption = "emulator:",
    tracker: TrackerOption = "twin:",
    seed: SeedOption = 1,
    overrides: SetOption = None,
    realtime: RealtimeOption = False,
    out: KeepInOption = None,
    yes: Annotated[
        bool, typer.Option("--yes", help="Do all that needs nobody's eyes, without asking.")
    ] = False,
) -> None:
    """Lead a new robot from its box to its first path, step by step.

    Board and firmware, servos by eye, camera, servos and rests under the camera, and a short path.
    The robot description keeps what is done: start it again, and it goes on there.

    Example: ccr-host setup --robot my-robot.toml --device serial:/dev/ttyACM0
    --tracker ndi:/dev/ttyUSB0
    """
    from ccr_host.core.errors import ConfigError
    from ccr_host.description.file import begin_description
    from ccr_host.tools.survey import file_for_calibration

    if not yes and not (sys.stdin and sys.stdin.isatty()):
        raise ConfigError("standard input is not a terminal", "start it from one, or give --yes")
    file = file_for_calibration(robot, out)
    options = RigOptions(
        robot=str(file),
        device=device,
        tracker=tracker,
        seed=seed,
        overrides=tuple(overrides or ()),
        realtime=realtime,
    )
    require_named_tracker(context, options)
    screen = console()
    if begin_description(file, robot):
        screen.print(f"made {file}: put what you can measure of your robot into it")
    guide = _Guide(screen, options, file, asks=not yes)
    guide.look()
    guide.lead_servos_by_eye()
    guide.survey()
    guide.look()
    guide.follow_first_path()
    words = " ".join(_words(options))
    screen.print(f"{file} is set up: ccr-host track 8shape {words}", soft_wrap=True)


def _words(options: RigOptions) -> Sequence[str]:
    return [
        f"--robot {options.robot}",
        f"--device {options.device}",
        f"--tracker {options.tracker}",
        *(f'--set "{override}"' for override in options.overrides),
    ]


@dataclass(frozen=True)
class _Guide:
    """The steps, each of which raises a CcrError if it fails and can then be taken again."""

    screen: Console
    options: RigOptions
    file: Path
    asks: bool

    def look(self) -> None:
        """Board, firmware and camera, as ``doctor`` does; nothing moves."""
        from ccr_host.commands.doctor import printed
        from ccr_host.link.transport import DeviceKind, parse_device_uri
        from ccr_host.tools.checks import Severity, exit_status
        from ccr_host.tools.doctor import examine

        self._title("board and camera")
        findings = [*printed(examine(self.options, Path()), self.screen)]
        device = parse_device_uri(self.options.device)
        board_failed = any(
            finding.subject == "board" and finding.severity is Severity.FAILURE
            for finding in findings
        )
        is_port = device.kind is DeviceKind.SERIAL
        if board_failed and is_port and self.asks and self._wanted("put the firmware onto it"):
            from ccr_host.commands.flash import flash

            flash(port=device.address)
            findings = [*printed(examine(self.options, Path()), self.screen)]
        if status := exit_status(findings):
            self.screen.print("correct what failed, then start again: it goes on here")
            raise typer.Exit(status)

    def lead_servos_by_eye(self) -> None:
        """Scale and limits, which no camera can tell; tendons off."""
        from ccr_host.commands.calibrate import lead_by_eye
        from ccr_host.link.transport import parse_device_uri
        from ccr_host.run.observer import Observers
        from ccr_host.run.open_rig import open_rig, sees_simulated_robot
        from ccr_host.tools.survey import keep_calibration

        self._title("servos by eye")
        if not self.asks or not parse_device_uri(self.options.device).is_outside:
            self.screen.print("left out: nobody sees the horns")
            return
        description = self.options.description()
        done = "pulse_per_90_deg_us" in description.servo.model_fields_set
        self.screen.print("tendons off, servo supply on, emergency stop at hand")
        if not self._wanted("lead each servo to marked angles with the arrow keys", done=done):
            return
        with open_rig(self.options, description, Observers()) as rig:
            blind = sees_simulated_robot(self.options)
            servo = lead_by_eye(self.screen, rig, description, simulated_tip=blind)
            if servo is None:
                self.screen.print("nothing was changed")
                return
            keep_calibration(rig.client, description, servo, self.file, str(self.file))
        self.screen.print(f"kept in {self.file} and in the board's EEPROM")

    def survey(self) -> None:
        """Camera, servos and rests, until the servos stand where they are said to."""
        from ccr_host.commands.terminal import steps_progress
        from ccr_host.commands.tracker_screen import registration_table
        from ccr_host.control.adaptive.identification import digest_of
        from ccr_host.run.observer import Observers
        from ccr_host.run.open_rig import open_rig
        from ccr_host.tools.calibrate import calibration_table
        from ccr_host.tools.servo_fit import CalibrationError
        from ccr_host.tools.survey import corrected, keep_calibration, survey

        self._title("camera, servos and rests")
        description = self.options.description()
        identified = description.identified
        done = identified is not None and identified.valid_for == digest_of(description)
        self.screen.print("tendons on, nothing near the robot: it tours some thirty poses")
        if not self._wanted("measure how camera and servos stand", done=done):
            return
        for _ in range(_ROUNDS):
            description = self.options.description()
            with (
                steps_progress(console(on_stderr=True), "poses") as on_pose,
                open_rig(self.options, description, Observers(), in_camera_frame=True) as rig,
            ):
                found = survey(rig, description, on_pose)
                self.screen.print(registration_table(found.registration))
                self.screen.print(calibration_table(found.servos, description))
                if found.servos_are_as_described:
                    self._keep(found)
                    return
                servo = corrected(description.servo, found.servos)
                keep_calibration(rig.client, description, servo, self.file, str(self.file))
            self.screen.print(f"servos corrected in {self.file} and in the EEPROM; once more")
        raise CalibrationError(
            "the servos stand elsewhere after each correction",
            "look for a horn, pulley or tendon that slips, then start again",
        )

    def follow_first_path(self) -> None:
        """A short loop, under the default controller."""
        import numpy as np

        from ccr_host.commands.track import track
        from ccr_host.robot.kinematics import ConstantCurvature

        self._title("a first short path")
        if not self._wanted("follow a loop of twenty seconds"):
            return
        time_s = np.arange(_FIRST_PATH_S + 1.0)
        phase = 2.0 * np.pi * time_s / _FIRST_PATH_S
        loop_rad = np.radians(_FIRST_PATH_DEG) * np.stack([np.sin(phase), np.cos(phase)], axis=1)
        tips_mm = ConstantCurvature(self.options.description().robot).tip_mm(loop_rad)
        path = self.file.with_name(f"{self.file.stem}-first-path.csv")
        rows = np.column_stack([time_s, tips_mm[:, 0], tips_mm[:, 2]])
        np.savetxt(path, rows, "%.3f", ",", header="t_s,y_mm,z_mm", comments="")
        options = self.options
        track(
            str(path),
            robot=options.robot,
            device=options.device,
            tracker=options.tracker,
            seed=options.seed,
            overrides=list(options.overrides),
            realtime=options.realtime,
            with_open=False,
        )

    def _keep(self, found: Survey) -> None:
        import datetime

        from ccr_host.description.file import keep_in
        from ccr_host.tools.register import REGISTRATION, registration_section
        from ccr_host.tools.survey import IDENTIFIED, identified_section

        today, own = datetime.date.today(), str(self.file)
        keep_in(self.file, {REGISTRATION: registration_section(found.registration, today)}, own)
        section = identified_section(found.rests, self.options.description(), today)
        keep_in(self.file, {IDENTIFIED: section}, own)
        self.screen.print(f"kept in {self.file}: camera and rests")

    def _title(self, text: str) -> None:
        self.screen.rule(text, align="left")

    def _wanted(self, step: str, *, done: bool = False) -> bool:
        """Whether to take a step: Enter does what is still to be done."""
        if not self.asks:
            return not done
        question = "done before; Enter goes on, r repeats" if done else "Enter begins, s skips"
        answer: str = typer.prompt(f"{step} ({question})", default="", show_default=False)
        return answer.strip().lower() == "r" if done else answer.strip().lower() != "s"
