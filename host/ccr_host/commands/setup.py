"""The command ``ccr-host setup``."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from ccr_host.commands.options import KeepInOption, Without, console, require_named_tracker
from ccr_host.run.options import RigOptions

if TYPE_CHECKING:
    from rich.console import Console


_ROUNDS = 3
"""The first round measures the corrections, the next one verifies them."""
_FIRST_PATH_S = 20
_FIRST_PATH_DEG = 15.0
"""Amplitude of both motors: well inside the range of the tour."""


def setup(
    context: typer.Context,
    rig: Annotated[RigOptions, Without("plant")],
    out: KeepInOption = None,
    yes: Annotated[
        bool, typer.Option("--yes", help="Do all steps that need no user, without asking.")
    ] = False,
) -> None:
    """Set up a new robot step by step, up to its first path.

    Board and firmware, servos by eye, camera, servos and rests with the camera, and a short path.
    Results are saved in the robot description: start it again to continue.

    Example: ccr-host setup --robot my-robot.toml --device serial:/dev/ttyACM0
    --tracker ndi:/dev/ttyUSB0
    """
    from ccr_host.core.errors import ConfigError
    from ccr_host.description.file import begin_description
    from ccr_host.tools.survey import file_for_calibration

    if not yes and not (sys.stdin and sys.stdin.isatty()):
        raise ConfigError("standard input is not a terminal", "use a terminal, or give --yes")
    file = file_for_calibration(rig.robot, out)
    options = replace(rig, robot=str(file))
    require_named_tracker(context, options)
    screen = console()
    if begin_description(file, rig.robot):
        screen.print(f"created {file}: enter the dimensions of your robot there")
    guide = _Guide(screen, options, file, asks=not yes)
    guide.check(before_survey=True)
    guide.move_servos_by_eye()
    guide.survey()
    guide.check()
    guide.follow_first_path()
    words = " ".join(_words(options))
    set_up = options.description().robot
    path = "8shape" if not set_up.segments else "circle" if set_up.motors > 1 else "swing"
    screen.print(f"{file} is set up: ccr-host track {path} {words}", soft_wrap=True)


def _words(options: RigOptions) -> Sequence[str]:
    return [
        f"--robot {options.robot}",
        f"--device {options.device}",
        f"--tracker {options.tracker}",
        *(f'--set "{override}"' for override in options.overrides),
    ]


@dataclass(frozen=True)
class _Guide:
    """The steps, each of which raises a CcrError if it fails and can then be repeated."""

    screen: Console
    options: RigOptions
    file: Path
    asks: bool

    def check(self, *, before_survey: bool = False) -> None:
        """Check board, firmware and camera, as ``doctor`` does; nothing moves.

        Rests that no longer fit the description are no obstacle before they are measured again.
        """
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
        if board_failed and is_port and self.asks and self._wanted("upload the firmware to it"):
            from ccr_host.commands.flash import flash

            flash(port=device.address)
            findings = [*printed(examine(self.options, Path()), self.screen)]
        if status := exit_status(
            finding
            for finding in findings
            if not (before_survey and finding.subject == "identification")
        ):
            self.screen.print("correct what failed, then start again: setup continues here")
            raise typer.Exit(status)

    def move_servos_by_eye(self) -> None:
        """Measure scale and limits, which no camera can measure; tendons off."""
        from ccr_host.commands.calibrate import move_by_eye
        from ccr_host.link.transport import parse_device_uri
        from ccr_host.run.observer import Observers
        from ccr_host.run.open_rig import open_rig, sees_simulated_robot
        from ccr_host.tools.survey import keep_calibration

        self._title("servos by eye")
        if not self.asks or not parse_device_uri(self.options.device).is_outside:
            self.screen.print("skipped: needs a user who sees the servo horns")
            return
        description = self.options.description()
        done = "pulse_per_90_deg_us" in description.servo.model_fields_set
        beware = "tendons off, servo supply on, emergency stop at hand"
        step = "move each servo to marked angles with the arrow keys"
        if not self._wanted(f"{beware}: {step}", done):
            return
        with open_rig(self.options, description, Observers()) as rig:
            blind = sees_simulated_robot(self.options)
            servo = move_by_eye(self.screen, rig, description, simulated_tip=blind)
            if servo is None:
                self.screen.print("nothing changed")
                return
            keep_calibration(rig.client, description, servo, self.file, str(self.file))
        self.screen.print(f"saved in {self.file} and in the board's EEPROM")

    def survey(self) -> None:
        """Measure camera, servos and rests until the servos match their description."""
        from ccr_host.commands.calibrate import survey_by_tracker
        from ccr_host.robot.rests import digest_of
        from ccr_host.run.observer import Observers
        from ccr_host.run.open_rig import open_rig
        from ccr_host.tools.survey import corrected, keep_calibration
        from ccr_host.tools.survey_starts import SurveyError

        self._title("camera, servos and rests")
        description = self.options.description()
        identified = description.identified
        done = identified is not None and identified.valid_for == digest_of(description)
        beware = "tendons on, nothing near the robot, which visits about forty poses"
        if not self._wanted(f"{beware}: measure camera and servos", done):
            return
        for _ in range(_ROUNDS):
            description = self.options.description()
            with open_rig(self.options, description, Observers(), in_camera_frame=True) as rig:
                found = survey_by_tracker(self.screen, rig, description)
                fits = found.servos_are_as_described
                servo = description.servo if fits else corrected(description.servo, found)
                # Without rests in the file, a setup that is stopped here still verifies the servos.
                measured = found if fits else None
                keep_calibration(
                    rig.client, description, servo, self.file, str(self.file), measured
                )
            if fits:
                self.screen.print(f"saved in {self.file}: camera and rests")
                return
            self.screen.print(f"servos corrected in {self.file} and in the EEPROM; measuring again")
        raise SurveyError(
            "the zeros of the servos are different after each correction",
            "check for a horn, pulley or tendon that slips, then start again",
        )

    def follow_first_path(self) -> None:
        """Follow a short loop with the default controller."""
        import numpy as np

        from ccr_host.commands.track import track
        from ccr_host.robot.kinematics import ConstantCurvature

        self._title("a first short path")
        if not self._wanted("follow a loop of twenty seconds"):
            return
        time_s = np.arange(_FIRST_PATH_S + 1.0)
        phase = 2.0 * np.pi * time_s / _FIRST_PATH_S
        robot = self.options.description().robot
        # All segments bend together, towards one direction after the other.
        towards = {t.motor: t.angle_deg for _, t in robot.tendons[::-1] if t.winding > 0}
        turn_rad = np.radians([towards.get(motor + 1, 0.0) for motor in range(robot.motors)])
        loop_rad = np.radians(_FIRST_PATH_DEG) * np.cos(phase[:, None] - turn_rad)
        tips_mm = ConstantCurvature(robot).tip_mm(loop_rad)
        path = self.file.with_name(f"{self.file.stem}-first-path.csv")
        rows = np.column_stack([time_s, tips_mm[:, 0], tips_mm[:, 2]])
        np.savetxt(path, rows, "%.3f", ",", header="t_s,y_mm,z_mm", comments="")
        track(str(path), self.options, with_open=False)

    def _title(self, text: str) -> None:
        self.screen.rule(text, align="left")

    def _wanted(self, step: str, done: bool = False) -> bool:
        """Whether to do a step; Enter does it if it was not done before."""
        if not self.asks:
            self.screen.print("done before" if done else step)
            return not done
        question = "done before; Enter continues, r repeats" if done else "Enter starts, s skips"
        answer: str = typer.prompt(f"{step} ({question})", default="", show_default=False)
        return answer.strip().lower() == "r" if done else answer.strip().lower() != "s"
