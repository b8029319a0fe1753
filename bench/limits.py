"""All controllers compared with their limits: the twin's floor and feedforward that knows the twin.

    python bench/limits.py [--robot NAME] [--rate HZ ...] [--seed N ...] [--controller NAME ...]
        [--laps N] [--gravity X,Y,Z ...]

Mean true error of each lap, mm, and its ratio to the floor; one table for each direction of gravity
in the robot's frame, which the description states. The feedforward knows the twin's rest poses, its
servos and the delay; it uses no measurements and neglects friction and deadband.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ccr_host.control.base import Command, Observation, Outcome
from ccr_host.control.registry import baseline_names, controller_names
from ccr_host.core.user_file import cache_folder
from ccr_host.description.schema import Description
from ccr_host.robot.paths import PAPER_PATHS
from ccr_host.robot.reference import Reference
from ccr_host.robot.workspace import MotorLimits
from ccr_host.run.execute import execute, reference_of
from ccr_host.run.loop import PathRun
from ccr_host.run.observer import RunObserver, StepRecord, true_errors_mm
from ccr_host.run.open_rig import open_rig
from ccr_host.run.options import RunOptions
from ccr_host.run.twin_floor import rests_along, twin_floor_mm
from ccr_host.tracking.markers.check import MarkerCheck

Array = NDArray[np.float64]

PREVIEWS = (0, 1, 2, 3)
"""Previews, in steps; the best one is used, since delay and servo rate are known."""
RAMP_SHARE = 0.8
FEEDFORWARD = "feedforward"


class KnowingFeedforward:
    """Commands the rest poses of the twin that are nearest to the path."""

    name = FEEDFORWARD

    def __init__(self, description: Description, preview: int) -> None:
        self._description, self._preview = description, preview

    def start(self, reference: Reference) -> Command:
        """Find all poses and command the first one."""
        self._ramp_s = RAMP_SHARE * reference.period_s
        shafts_rad, _ = rests_along(self._description, reference, cache=cache_folder())
        self._commands_rad = self._commands_for(shafts_rad)
        return self._command(0)

    def step(self, observation: Observation) -> Command:
        """Command the pose ahead, whatever is measured."""
        return self._command(min(observation.step + self._preview, len(self._commands_rad) - 1))

    def _commands_for(self, shafts_rad: Array) -> Array:
        servo, twin = self._description.servo, self._description.twin
        per_rad_us = np.array(twin.servo_us_per_90_deg) / np.radians(90.0)
        pulses_us = np.array(twin.servo_neutral_us) + shafts_rad * per_rad_us
        host_per_rad_us = np.array(servo.pulse_per_90_deg_us) / np.radians(90.0)
        asked_rad = (pulses_us - servo.neutral_pulse_us) / host_per_rad_us
        return MotorLimits.of(servo).clip(asked_rad)

    def _command(self, index: int) -> Command:
        return Command(
            self._commands_rad[index], np.zeros((1, 3)), Outcome.SOLVED, ramp_s=self._ramp_s
        )


def lap_errors_mm(records: Sequence[StepRecord], reference: Reference) -> list[float]:
    """Mean error of the true tip over each lap, mm; NaN from a lap on that was not completed."""
    errors_mm = np.full((len(reference), 3), np.nan)
    true_mm = true_errors_mm(records)
    if true_mm is not None:
        errors_mm[: len(true_mm)] = true_mm
    norms_mm = np.linalg.norm(errors_mm, axis=1).reshape(reference.laps, -1)
    return [float(mm) for mm in norms_mm.mean(axis=1)]


def feedforward_mm(options: RunOptions) -> list[float]:
    """Mean error of each lap with the best preview, mm."""
    description, reference = options.description(), reference_of(options)
    errors_mm = []
    for preview in PREVIEWS:
        controller = KnowingFeedforward(description, preview)
        observer = RunObserver()
        with open_rig(options, description, observer) as rig:
            records = PathRun(
                rig, controller, reference, description, observer, lambda *_: None,
                markers=MarkerCheck(description),
            ).execute()  # fmt: skip
        errors_mm.append(lap_errors_mm(records, reference))
    return min(errors_mm)


def errors_mm_of(options: RunOptions) -> list[float]:
    """Mean error of each lap of a run, mm."""
    if options.controller == FEEDFORWARD:
        return feedforward_mm(options)
    result = execute(options, RunObserver(), lambda *_: None)
    return lap_errors_mm(result.records, result.reference)


def main() -> None:
    """Measure and print one table per mounting and rate."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--robot")
    parser.add_argument("--set", action="append", default=[], dest="overrides")
    parser.add_argument("--rate", type=float, nargs="+", default=[1.0, 20.0])
    parser.add_argument("--seed", type=int, nargs="+", default=[1])
    known = [FEEDFORWARD, *controller_names(), *baseline_names()]
    parser.add_argument("--controller", nargs="+", default=known)
    parser.add_argument("--laps", type=int, default=1)
    parser.add_argument("--gravity", nargs="+", default=[""], metavar="X,Y,Z")
    arguments = parser.parse_args()
    for direction in arguments.gravity:
        mounted = [f"robot.gravity_direction=[{direction}]"] if direction else []
        overrides = (*arguments.overrides, *mounted)
        base = RunOptions(path="", robot=arguments.robot, overrides=overrides, laps=arguments.laps)
        for rate_hz in arguments.rate:
            runs = [replace(base, path=path, rate_hz=rate_hz) for path in PAPER_PATHS]
            floors_mm = [twin_floor_mm(run, reference_of(run)) or float("nan") for run in runs]
            title = f"{rate_hz:g} Hz" + (f", gravity {direction}" if direction else "")
            heads = [title, "seed", "lap", *(f"{path} | ratio" for path in PAPER_PATHS)]
            print(f"\n| {' | '.join(heads)} |\n" + "|---" * (3 + 2 * len(runs)) + "|")
            _print_row("floor", "", "", floors_mm, floors_mm)
            for name in arguments.controller:
                for seed in arguments.seed:
                    seeded = [replace(run, controller=name, seed=seed) for run in runs]
                    of_laps_mm = zip(*map(errors_mm_of, seeded), strict=True)
                    for lap, errors_mm in enumerate(of_laps_mm, 1):
                        _print_row(name, str(seed), str(lap), errors_mm, floors_mm)


def _print_row(
    name: str, seed: str, lap: str, errors_mm: Sequence[float], floors_mm: Sequence[float]
) -> None:
    cells = [
        f"{error:.3f} | {error / floor:.2f}"
        for error, floor in zip(errors_mm, floors_mm, strict=True)
    ]
    print(f"| {' | '.join([name, seed, lap, *cells])} |", flush=True)


if __name__ == "__main__":
    main()
