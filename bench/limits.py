"""All controllers compared with their limits: the twin's floor and feedforward that knows the twin.

    python bench/limits.py [--robot NAME] [--rate HZ ...] [--seed N ...] [--controller NAME ...]

Mean true error, mm, over the whole path. The feedforward knows the static map of the twin, its
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
from ccr_host.run.twin_floor import floor_on_map_mm, static_map_of
from ccr_host.sim.robot.static_map import StaticMap, default_cache

Array = NDArray[np.float64]

PREVIEWS = (0, 1, 2, 3)
"""Previews, in steps; the best one is used, since delay and servo rate are known."""
FINER = 20
"""Subdivisions of a cell of the map for the search of the nearest pose."""
RAMP_SHARE = 0.8


class KnowingFeedforward:
    """Commands the poses nearest to the path on the twin's own map."""

    name = "feedforward"

    def __init__(self, description: Description, static_map: StaticMap, preview: int) -> None:
        self._description = description
        self._map = static_map
        self._preview = preview

    def start(self, reference: Reference) -> Command:
        """Look up all poses and command the first one."""
        self._ramp_s = RAMP_SHARE * reference.period_s
        shafts_rad = np.array([nearest_rad(self._map, point) for point in reference.target_mm])
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


def nearest_rad(static_map: StaticMap, point_mm: Array) -> Array:
    """Shaft angles with the rest nearest to a point, (2,), bilinear between nodes of the map."""
    distance_mm = np.linalg.norm(static_map.tip_mm - point_mm, axis=2)
    row, column = np.unravel_index(distance_mm.argmin(), distance_mm.shape)
    axes = static_map.axis_1_rad, static_map.axis_2_rad
    low = [max(node - 1, 0) for node in (int(row), int(column))]
    high = [min(node + 2, len(axis)) for node, axis in zip((row, column), axes, strict=True)]
    patch_mm = static_map.tip_mm[low[0] : high[0], low[1] : high[1]]
    for along in (0, 1):
        patch_mm = _finer(patch_mm, along)
    fine = [_finer(axis[begin:end], 0) for axis, begin, end in zip(axes, low, high, strict=True)]
    off_mm = np.linalg.norm(patch_mm - point_mm, axis=2)
    best = np.unravel_index(off_mm.argmin(), off_mm.shape)
    return np.array([angles[node] for angles, node in zip(fine, best, strict=True)])


def _finer(values: Array, along: int) -> Array:
    nodes = np.moveaxis(values, along, 0)
    position = np.linspace(0.0, len(nodes) - 1.0, FINER * (len(nodes) - 1) + 1)
    before = np.minimum(position.astype(int), len(nodes) - 2)
    share = (position - before).reshape(-1, *[1] * (nodes.ndim - 1))
    between: Array = (1.0 - share) * nodes[before] + share * nodes[before + 1]
    return np.moveaxis(between, 0, along)


def mean_error_mm(records: list[StepRecord]) -> float:
    """Mean error of the true tip, mm."""
    errors_mm = true_errors_mm(records)
    return float("nan") if errors_mm is None else float(np.linalg.norm(errors_mm, axis=1).mean())


def feedforward_mm(options: RunOptions, static_map: StaticMap) -> float:
    """Mean error with the best preview, mm."""
    description, reference = options.description(), reference_of(options)
    errors_mm = []
    for preview in PREVIEWS:
        controller = KnowingFeedforward(description, static_map, preview)
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
    static_map = static_map_of(base.description(), default_cache())
    paths = PAPER_PATHS
    for rate_hz in arguments.rate:
        runs = [replace(base, path=path, rate_hz=rate_hz) for path in paths]
        floors_mm = [
            floor_on_map_mm(static_map, run.description(), reference_of(run)) for run in runs
        ]
        print(f"\n| {rate_hz:g} Hz | seed |", *(f"{path} | ratio |" for path in paths))
        print("|---" * (2 + 2 * len(paths)) + "|")
        _print_row("floor", "", floors_mm, floors_mm)
        known_mm = [feedforward_mm(run, static_map) for run in runs]
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
