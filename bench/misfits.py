"""Robots that differ from their description: when it is detected, the cause given, and the motion.

python -m bench.misfits                  # the table of misfits
python -m bench.misfits --matching 100   # random robots that do match, at 1 and 20 Hz
python -m bench.misfits --matching 60 --segments   # those of 1 to 4 planar or spatial segments
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from contextlib import ExitStack
from dataclasses import dataclass, replace
from pathlib import Path
from tempfile import TemporaryDirectory
from unittest.mock import patch

import numpy as np
from numpy.typing import NDArray

from bench.any_robot import built, description_text, path_text
from ccr_host.description import schema
from ccr_host.run.execute import execute
from ccr_host.run.observer import RunObserver
from ccr_host.run.options import RunOptions
from ccr_host.sim.robot.mechanics import Mechanics
from ccr_host.sim.robot.robot import TwinRobot
from ccr_host.tools.sweep.random_twin import as_overrides, draw_twin
from ccr_host.tracking.tracker import Sample

Array = NDArray[np.float64]

_COMPILED = "control.solver=compiled"
REGISTERED = (
    "registration.camera_to_robot_deg=[0,0,0]",
    "registration.uncertainty_deg=[0.28,0.07,0.14]",
)


def _zeros(first_deg: float, second_deg: float) -> str:
    pulses = [round(1500 + deg * 1000 / 90, 1) for deg in (first_deg, second_deg)]
    return f"twin.servo_neutral_us={pulses}"


def _scales(first_us: float, second_us: float) -> str:
    return f"twin.servo_us_per_90_deg=[{first_us},{second_us}]"


def _slack(*millimetres: float) -> str:
    return f"twin.slack_mm={list(millimetres)}"


MISFITS: dict[str, tuple[str, tuple[str, ...]]] = {
    "motor 1 reversed": ("motor 1 reversed", (_scales(-1000, 1000),)),
    "motor 2 reversed": ("motor 2 reversed", (_scales(1000, -1000),)),
    "both motors reversed": ("motor 1 and 2 reversed", (_scales(-1000, -1000),)),
    "motor 1 reversed, zeros 3 deg off": (
        "motor 1 reversed",
        (_scales(-1000, 1000), _zeros(3, -3)),
    ),
    "motors exchanged": ("exchanged", ("exchanged motors",)),
    "tendons 1 and 2 crossed": ("tendon", ("crossed tendons",)),
    "markers M1 and M3 exchanged": ("M1 and M3", ("exchanged markers",)),
    "markers M2 and M3 exchanged": ("M2 and M3", ("other exchanged markers",)),
    "zero 1 by +8 deg": ("zero of motor 1", (_zeros(8, 0),)),
    "zero 1 by -8 deg": ("zero of motor 1", (_zeros(-8, 0),)),
    "zero 2 by +8 deg": ("zero of motor 2", (_zeros(0, 8),)),
    "zero 2 by -8 deg": ("zero of motor 2", (_zeros(0, -8),)),
    "zeros by +8 and -8 deg": ("zero of motor 1", (_zeros(8, -8),)),
    "zero 1 by a tooth": ("zero of motor 1", (_zeros(14.4, 0),)),
    "zero 2 by a tooth": ("zero of motor 2", (_zeros(0, -14.4),)),
    "zero 1 by +8 deg, registered": ("zero of motor 1", (_zeros(8, 0), *REGISTERED)),
    "zero 1 by -8 deg, registered": ("zero of motor 1", (_zeros(-8, 0), *REGISTERED)),
    "scale of motor 1 halved": ("times as far", (_scales(2000, 1000),)),
    "scale of motor 2 halved": ("times as far", (_scales(1000, 2000),)),
    "scale of motor 1 doubled": ("times as far", (_scales(500, 1000),)),
    "scale of motor 2 doubled": ("times as far", (_scales(1000, 500),)),
    "pulley half as big": ("times as far", ("twin.pulley_radius_mm=6",)),
    "camera by 180 deg about x": ("camera", ("tracker.rotation_deg=[180,0,0]",)),
    "camera by 180 deg about y": ("camera", ("tracker.rotation_deg=[0,180,0]",)),
    "camera by 180 deg about z": ("camera", ("tracker.rotation_deg=[0,0,180]",)),
    "camera by 90 deg about z": ("camera", ("tracker.rotation_deg=[0,0,90]",)),
    "camera by 30 deg": ("camera", ("tracker.rotation_deg=30",)),
    "camera by 20 deg about z": ("camera", ("tracker.rotation_deg=[0,0,20]",)),
    "camera by (40, -100, 70) deg": ("camera", ("tracker.rotation_deg=[40,-100,70]",)),
    "camera moved by 5 deg about z since": (
        "camera",
        ("tracker.rotation_deg=[0,0,5]", *REGISTERED),
    ),
    "camera moved by 5 deg about x since": (
        "camera",
        ("tracker.rotation_deg=[5,0,0]", *REGISTERED),
    ),
    "mounted upside down": ("gravity along [0, 0, 1]", ("twin.gravity_m_s2=-9.81",)),
    "segment 1 of 80 mm": ("lengths", ("twin.segment_lengths_mm=[80,43.5]",)),
    "segment 2 of 60 mm": ("lengths", ("twin.segment_lengths_mm=[58.5,60]",)),
    "segments exchanged": ("lengths", ("twin.segment_lengths_mm=[43.5,58.5]",)),
    "half the lengths": ("lengths", ("twin.segment_lengths_mm=[30,22]",)),
    "markers 32 mm beside the backbone": ("marker_offset_mm", ("twin.marker_offset_mm=32",)),
    "tendon 1 loose": ("tendon of motor 1", (_slack(10, 1.2, 1.2, 1.2),)),
    "tendon 2 loose": ("tendon of motor 2", (_slack(1.2, 10, 1.2, 1.2),)),
    "tendon 4 loose": ("tendon of motor 2", (_slack(1.2, 1.2, 1.2, 10),)),
    "both tendons of motor 2 loose": ("tendon of motor 2", (_slack(1.2, 10, 1.2, 10),)),
    "a hand on it from 20 s on": (
        "",
        ("twin.push={force_n = [0.0, 0.0, 0.8], start_s = 20, end_s = 60}",),
    ),
}
"""Expected text of the cause, and the robot, by keys or as a name of `_ALTERED`."""


def _exchanged_motors(robot: TwinRobot, pulses_half_us: tuple[int, int]) -> None:
    _SET_PULSES(robot, (pulses_half_us[1], pulses_half_us[0]))


def _crossed_tendons(mechanics: Mechanics, pulleys_rad: Sequence[float]) -> None:
    """Tendon 1 on the pulley of motor 2, tendon 2 on that of motor 1."""
    _PULL(mechanics, pulleys_rad)
    lengths_m = mechanics._data.ctrl
    wound_m = mechanics._twin.pulley_radius_mm * 1e-3 * (pulleys_rad[0] - pulleys_rad[1])
    lengths_m[0] += wound_m
    lengths_m[1] -= wound_m


def _in_order(*order: int) -> Callable[[TwinRobot], Array]:
    return lambda robot: _MARKERS(robot)[list(order)]


_SET_PULSES, _MARKERS, _PULL = TwinRobot.set_pulses_half_us, TwinRobot.markers_mm, Mechanics.pull
_ALTERED: dict[str, tuple[type, str, Callable[..., object]]] = {
    "exchanged motors": (TwinRobot, "set_pulses_half_us", _exchanged_motors),
    "crossed tendons": (Mechanics, "pull", _crossed_tendons),
    "exchanged markers": (TwinRobot, "markers_mm", _in_order(2, 1, 0)),
    "other exchanged markers": (TwinRobot, "markers_mm", _in_order(0, 2, 1)),
}


@dataclass
class _Witness(RunObserver):
    """Records the phases and the travel of the tip."""

    first_mm: Array | None = None
    travel_mm: float = 0.0

    def tracker_sample(self, time_us: int, sample: Sample) -> None:
        if self.first_mm is None:
            self.first_mm = sample.tip_mm
        self.travel_mm = max(self.travel_mm, float(np.linalg.norm(sample.tip_mm - self.first_mm)))


@dataclass(frozen=True)
class Seen:
    """Result of a run."""

    when: str
    cause: str
    travel_mm: float
    steps: int
    error_mm: float


def run(options: RunOptions) -> Seen:
    """Execute one run and return what was detected."""
    witness = _Witness()
    altered = [_ALTERED[word] for word in options.overrides if word in _ALTERED]
    # Finding a cause takes ten times as long without it.
    plain = (*(word for word in options.overrides if word not in _ALTERED), _COMPILED)
    with ExitStack() as stack:
        for owner, name, instead in altered:
            stack.enter_context(patch.object(owner, name, instead))
        result = execute(replace(options, overrides=plain), witness, lambda *_: None)
    measured = [r.measured_mm - r.target_mm for r in result.records if r.measured_mm is not None]
    error_mm = float(np.linalg.norm(measured, axis=1).mean()) if measured else float("nan")
    when = "not" if result.failure is None else "during" if result.records else "before the path"
    cause = "" if result.failure is None else str(result.failure)
    return Seen(when, cause, witness.travel_mm, len(result.records), error_mm)


def misfits(controller: str, rate_hz: float) -> Iterator[tuple[str, str, RunOptions]]:
    """Name, expected text of the cause, and run of each misfit."""
    for name, (wanted, overrides) in MISFITS.items():
        yield (
            name,
            wanted,
            RunOptions(
                path="8shape",
                controller=controller,
                rate_hz=rate_hz,
                overrides=overrides,
                checks="motion",
            ),
        )


def matching(count: int, controller: str, rate_hz: float) -> Iterator[RunOptions]:
    """Random robots, drawn as in a sweep."""
    for index in range(count):
        drawn = draw_twin(np.random.default_rng([7, index]), schema.load(), 80.0)
        path = ("ellipse", "8shape", "star")[index % 3]
        yield RunOptions(
            path=path,
            controller=controller,
            rate_hz=rate_hz,
            overrides=as_overrides(drawn),
            checks="motion",
        )


def matching_of_segments(
    count: int, controller: str, rate_hz: float, folder: Path
) -> Iterator[RunOptions]:
    """Random robots of 1 to 4 segments with 0 to 2.5 mm of slack, alike or of each tendon."""
    for index in range(1, count + 1):
        rng = np.random.default_rng([31, index])
        robot = built(rng, 1 + index % 4)
        alike_mm, tendons = rng.choice([0.3, 1.2, 2.0]), len(robot.tendons)
        slack_mm = np.full(tendons, alike_mm)
        if index % 2 == 0:
            slack_mm = np.abs(rng.normal(0.0, 1.0, tendons)).clip(0.0, 2.5)
        described, path = folder / f"{index}.toml", folder / f"{index}.csv"
        described.write_text(description_text(robot))
        path.write_text(path_text(robot, rng))
        yield RunOptions(
            path=str(path),
            robot=str(described),
            controller=controller,
            rate_hz=rate_hz,
            overrides=(_slack(*slack_mm.round(2).tolist()),),
            checks="motion",
        )


def main() -> None:
    """Print a table as Markdown."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--controller", default="adaptive")
    parser.add_argument("--matching", type=int, default=0)
    parser.add_argument("--segments", action="store_true")
    parser.add_argument("--rate", type=float, action="append", help="by default 1 and 20 Hz")
    parser.add_argument("--workers", type=int, default=2)
    words = parser.parse_args()
    with ProcessPoolExecutor(words.workers) as pool, TemporaryDirectory() as folder:
        if words.matching:
            for rate_hz in words.rate or (1.0, 20.0):
                asked = words.matching, words.controller, rate_hz
                drawn = matching_of_segments(*asked, Path(folder))
                runs = list(drawn if words.segments else matching(*asked))
                alarms = [seen for seen in pool.map(run, runs) if seen.when != "not"]
                print(f"{rate_hz:g} Hz: {len(runs)} runs, {len(alarms)} alarms", flush=True)
                for seen in alarms:
                    print(f"  {seen.when}, {seen.steps} steps: {seen.cause}", flush=True)
            return
        rows = list(misfits(words.controller, 1.0))
        print("| robot | noticed | cause named | tip travel (mm) | told |\n|---|---|---|---|---|")
        for (name, wanted, _), seen in zip(
            rows, pool.map(run, [row[2] for row in rows]), strict=True
        ):
            right = "-" if seen.when == "not" else "rightly" if wanted in seen.cause else "wrongly"
            told = seen.cause or f"mean error {seen.error_mm:.1f} mm"
            print(f"| {name} | {seen.when} | {right} | {seen.travel_mm:.0f} | {told} |", flush=True)


if __name__ == "__main__":
    main()
