"""Open loop on the twin, without board and camera, compared with the paper's results.

``python bench/twin_open_loop.py`` prints the results of the shipped description `paper`, or of
another one with ``--robot``; ``--sensitivity`` adds one row for each changed parameter (about four
minutes).
"""

from __future__ import annotations

import argparse
import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ccr_host.control.base import Observation
from ccr_host.control.open_loop import OpenLoop
from ccr_host.description.schema import Description, load
from ccr_host.description.simulation import Twin
from ccr_host.robot.kinematics import ConstantCurvature
from ccr_host.robot.paths import load_path
from ccr_host.robot.reference import Reference
from ccr_host.robot.workspace import MotorLimits, Workspace
from ccr_host.sim.robot.robot import TwinRobot

Array = NDArray[np.float64]

PERIOD_US = 1_000_000
SETTLE_US = 2_000_000

CHANGES: list[dict[str, object]] = [
    {"slack_mm": 1.0},
    {"slack_mm": 1.4},
    {"bending_stiffness_nm_rad": 0.018},
    {"bending_stiffness_nm_rad": 0.022},
    {"marker_mass_g": 2.7},
    {"marker_mass_g": 3.3},
    {"disk_mass_g": 0.72},
    {"disk_mass_g": 0.88},
    {"tendon_stiffness_n_m": 3600.0},
    {"tendon_stiffness_n_m": 4400.0},
    {"joint_damping": 1e-4},
    {"joint_damping": 4e-4},
    {"servo_rate_deg_s": 200.0},
    {"friction": 0.1},
    {"servo_deadband_deg": 0.45},
    {"flexures": (12, 10), "disk_mass_g": 0.4},
    {"time_step_ms": 0.1},
]


@dataclass(frozen=True)
class Paper:
    """The paper's measurements without feedback."""

    mean_error_mm: float
    shift_z_mm: float


PAPER = {
    "ellipse": Paper(22.4, -20.0),
    "8shape": Paper(21.3, -15.0),
    "star": Paper(18.5, -15.0),
}


@dataclass(frozen=True)
class Result:
    """Mean error and mean shift of the tip against the desired points."""

    mean_error_mm: float
    shift_mm: Array


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--robot", default="paper", help="a description, or a shipped one")
    parser.add_argument("--sensitivity", action="store_true", help="vary each parameter")
    arguments = parser.parse_args()
    twin, references = load(arguments.robot).twin, paper_paths()
    results = [open_loop(twin, reference) for reference in references]
    print("| path | paper | twin | off by | shift x, y, z of (10) | paper's z shift |")
    print("|---|---|---|---|---|---|")
    for reference, result in zip(references, results, strict=True):
        paper = PAPER[reference.name]
        off = result.mean_error_mm / paper.mean_error_mm - 1
        shift = ", ".join(f"{value:.1f}" for value in result.shift_mm)
        print(
            f"| {reference.name} | {paper.mean_error_mm} | {result.mean_error_mm:.2f} "
            f"| {off:+.1%} | {shift} | {paper.shift_z_mm:.0f} |"
        )
    if arguments.sensitivity:
        print_sensitivity(twin, references, results)


def print_sensitivity(twin: Twin, references: list[Reference], results: list[Result]) -> None:
    """Print the change of the mean errors for each changed parameter, mm."""
    print("\n| changed | " + " | ".join(reference.name for reference in references) + " |")
    print("|---|" + "---|" * len(references))
    for change in CHANGES:
        other = Twin.model_validate(twin.model_dump() | change)
        changed = [open_loop(other, reference) for reference in references]
        moved_mm = (
            after.mean_error_mm - before.mean_error_mm
            for before, after in zip(results, changed, strict=True)
        )
        keys = ", ".join(f"`{key}` {value}" for key, value in change.items())
        print(f"| {keys} | " + " | ".join(f"{mm:+.2f}" for mm in moved_mm) + " |", flush=True)


def open_loop(twin: Twin, reference: Reference) -> Result:
    """Errors of the open loop: command i starts period i, at whose end the error is taken."""
    robot = TwinRobot(twin)
    q_rad = algorithm_2(reference)
    robot.set_pulses_half_us(pulses_half_us(q_rad[0]))
    robot.advance_to(SETTLE_US)
    errors_mm = np.array(list(track(robot, q_rad))) - reference.target_mm
    mean_error_mm = float(np.linalg.norm(errors_mm, axis=1).mean())
    return Result(mean_error_mm, errors_mm.mean(axis=0))


def algorithm_2(reference: Reference) -> Array:
    """Motor angles of the paper's open loop, (N, 2)."""
    controller = OpenLoop(Description())
    commands = [controller.start(reference)]
    for step in range(1, len(reference)):
        q_rad = commands[-1].q_rad
        commands.append(controller.step(Observation(step, 0, None, 0, q_rad)))
    return np.array([command.q_rad for command in commands])


def track(robot: TwinRobot, q_rad: Array) -> Iterator[Array]:
    """Yield the tip at the end of each period."""
    for step, angles_rad in enumerate(q_rad):
        robot.set_pulses_half_us(pulses_half_us(angles_rad))
        robot.advance_to(SETTLE_US + (step + 1) * PERIOD_US)
        yield robot.tip_mm()


def pulses_half_us(angles_rad: Array) -> tuple[int, int]:
    """Pulse widths, rounded to the board's resolution of 0.5 us."""
    first, second = (round(3000 + 2000 * float(angle) / (math.pi / 2)) for angle in angles_rad)
    return first, second


def paper_paths() -> list[Reference]:
    """Sample the three paths of Section IV once per second."""
    description = Description()
    model, limits = ConstantCurvature(description.robot), MotorLimits.of(description.servo)
    return [load_path(name, 1.0, Workspace(model, limits)) for name in PAPER]


if __name__ == "__main__":
    main()
