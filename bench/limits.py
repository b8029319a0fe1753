"""All controllers compared with their limits: the twin's floor and feedforward that knows the twin.

    python bench/limits.py [--robot NAME] [--rate HZ ...] [--seed N ...] [--controller NAME ...]

Mean true error, mm, over the whole path. The feedforward knows the rest poses of the twin, its
servos and the delay; it uses no measurements and neglects friction and deadband.
"""

from __future__ import annotations

import argparse
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ccr_host.control.base import Command, Observation, Outcome
from ccr_host.control.registry import baseline_names, controller_names
from ccr_host.description.schema import Description
from ccr_host.robot.paths import PAPER_PATHS
from ccr_host.robot.reference import Reference
from ccr_host.robot.workspace import MotorLimits
from ccr_host.run.execute import execute, reference_of
from ccr_host.run.loop import follow_path
from ccr_host.run.observer import RunObserver, StepRecord, true_errors_mm
from ccr_host.run.open_rig import open_rig
from ccr_host.run.options import RunOptions
from ccr_host.run.twin_floor import default_cache, rests_along, twin_floor_mm

Array = NDArray[np.float64]

PREVIEWS = (0, 1, 2, 3)
"""Previews, in steps; the best one is used, since delay and servo rate are known."""
RAMP_SHARE = 0.8


class KnowingFeedforward:
    """Commands the rest poses of the twin that are nearest to the path."""

    name = "feedforward"

    def __init__(self, description: Description, preview: int) -> None:
        self._description, self._preview = description, preview

    def start(self, reference: Reference) -> Command:
        """Find all poses and command the first one."""
        self._ramp_s = RAMP_SHARE * reference.period_s
        shafts_rad, _ = rests_along(self._description, reference, cache=default_cache())
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


def mean_error_mm(records: list[StepRecord]) -> float:
    """Mean error of the true tip, mm."""
    errors_mm = true_errors_mm(records)
    return float("nan") if errors_mm is None else float(np.linalg.norm(errors_mm, axis=1).mean())


def feedforward_mm(options: RunOptions) -> float:
    """Mean error with the best preview, mm."""
    description, reference = options.description(), reference_of(options)
    errors_mm = []
    for preview in PREVIEWS:
        controller = KnowingFeedforward(description, preview)
        observer = RunObserver()
        with open_rig(options, description, observer) as rig:
            records = follow_path(
                rig, controller, reference, description, observer, lambda *_: None
            )
        errors_mm.append(mean_error_mm(records))
    return min(errors_mm)


def main() -> None:
    """Measure and print one table per rate."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--robot")
    parser.add_argument("--set", action="append", default=[], dest="overrides")
    parser.add_argument("--rate", type=float, nargs="+", default=[1.0, 20.0])
    parser.add_argument("--seed", type=int, nargs="+", default=[1])
    parser.add_argument("--controller", nargs="+", default=[*controller_names(), *baseline_names()])
    arguments = parser.parse_args()
    base = RunOptions(path="", robot=arguments.robot, overrides=tuple(arguments.overrides))
    paths = PAPER_PATHS
    for rate_hz in arguments.rate:
        runs = [replace(base, path=path, rate_hz=rate_hz) for path in paths]
        floors_mm = [twin_floor_mm(run, reference_of(run)) or float("nan") for run in runs]
        print(f"\n| {rate_hz:g} Hz | seed |", *(f"{path} | ratio |" for path in paths))
        print("|---" * (2 + 2 * len(paths)) + "|")
        _print_row("floor", "", floors_mm, floors_mm)
        known_mm = [feedforward_mm(run) for run in runs]
        _print_row("feedforward that knows the twin", "", known_mm, floors_mm)
        for name in arguments.controller:
            for seed in arguments.seed:
                results = [
                    execute(replace(run, controller=name, seed=seed), RunObserver(), _silent)
                    for run in runs
                ]
                errors_mm = [mean_error_mm(result.records) for result in results]
                _print_row(name, str(seed), errors_mm, floors_mm)


def _silent(*_: object) -> None:
    pass


def _print_row(name: str, seed: str, errors_mm: list[float], floors_mm: list[float]) -> None:
    cells = [
        f"{error:.3f} | {error / floor:.2f} |"
        for error, floor in zip(errors_mm, floors_mm, strict=True)
    ]
    print(f"| {name} | {seed} |", *cells, flush=True)


if __name__ == "__main__":
    main()
