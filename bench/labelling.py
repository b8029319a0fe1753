"""Marker labelling under occlusion and phantoms, on the motion of the twin.

``python bench/labelling.py`` runs the three paths on the twin, once with the commands of a closed
loop at 1 Hz and once at 20 Hz, and labels the points of a hostile camera: markers hidden at random,
phantoms in the volume and near the markers, random order.
"""

from __future__ import annotations

import argparse
import math
from collections.abc import Iterator
from dataclasses import dataclass, field
from time import perf_counter_ns

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from ccr_host.description.schema import Robot
from ccr_host.description.simulation import Twin
from ccr_host.robot.kinematics import ConstantCurvature
from ccr_host.robot.paths import load_path
from ccr_host.robot.workspace import MotorLimits, Workspace
from ccr_host.run.execute import execute_quietly
from ccr_host.run.options import RunOptions
from ccr_host.sim.robot.robot import TwinRobot
from ccr_host.tracking.markers.labelling import Labeller

Array = NDArray[np.float64]

FRAME_US = 50_000
NOISE_MM = 0.25 / math.sqrt(3.0)
"""Noise per coordinate: 0.25 mm RMS for each marker."""
CAMERA_MM = np.array([50.0, -80.0, -900.0])
FRESH_FRAMES = 5
"""control.stale_after_ms at 20 Hz."""
FALSE_MM = 2.0
PATHS = ("ellipse", "8shape", "star")


@dataclass(frozen=True, eq=False)
class Motion:
    """Motion of the robot, one row per frame, 20 Hz."""

    q_rad: Array
    """Commanded motor angles, (N, 2)."""
    markers_mm: Array
    """M1, M2, M3 in the frame of (10), (N, 3, 3)."""


@dataclass(frozen=True)
class Hostility:
    """Disturbances of a frame by the camera."""

    occlusion: float = 0.2
    phantoms: int = 3
    """Maximum number of phantoms, uniformly distributed from 0."""
    kinds: str = "unm"
    """Kinds of phantoms: uniform in the volume, near a marker, mirrored in the markers' plane."""
    first_frame: int = 0
    """Number of frames with a clear view at the start."""


@dataclass
class Score:
    """Counts over one or more motions."""

    frames: int = 0
    visible: int = 0
    """Frames in which M3 was seen."""
    tips: int = 0
    fresh: int = 0
    """Frames no later than `FRESH_FRAMES` after a tip."""
    swaps: int = 0
    """A marker labelled as another one, or a wrong base."""
    phantoms: int = 0
    """A phantom labelled as M2 or M3."""
    false_tips: int = 0
    """Tips off by more than `FALSE_MM`."""
    worst_mm: float = 0.0
    times_us: list[float] = field(default_factory=list)

    def row(self, name: str) -> str:
        """One line of the table."""
        median, late = np.percentile(self.times_us, [50, 99]) / 1000.0
        return (
            f"{name:28} {self.frames:6} {self.tips / self.frames:6.1%} "
            f"{self.tips / max(1, self.visible):8.1%} {self.fresh / self.frames:6.1%} "
            f"{self.swaps:6} {self.phantoms:9} {self.false_tips:6} {self.worst_mm:9.2f} "
            f"{median:8.2f} {late:6.1f}"
        )


def closed_loop(path: str, seed: int = 1) -> Motion:
    """The commands of the paper's controller at 1 Hz."""
    result = execute_quietly(RunOptions(path=path, seed=seed))
    return played_back(np.array([record.q_rad for record in result.records]), 1_000_000)


def at_20_hz(path: str) -> Motion:
    """The nearest configurations of a path at 20 Hz."""
    limits = MotorLimits(np.radians([-85.0, -85.0]), np.radians([85.0, 85.0]))
    reference = load_path(path, 20.0, Workspace(ConstantCurvature(Robot()), limits))
    return played_back(reference.q_rad, FRAME_US)


def played_back(commands_rad: Array, period_us: int) -> Motion:
    """Run the twin with commands, after two seconds at the first one."""
    robot = TwinRobot(Twin())
    frames_each = period_us // FRAME_US
    held = np.repeat(commands_rad[:1], 2_000_000 // period_us, axis=0)
    q_rad = np.repeat(np.concatenate([held, commands_rad]), frames_each, axis=0)
    markers = []
    for frame, angles in enumerate(np.degrees(q_rad)):
        robot.set_pulses_half_us((_half_us(angles[0]), _half_us(angles[1])))
        robot.advance_to((frame + 1) * FRAME_US)
        markers.append(robot.markers_mm())
    return Motion(q_rad, np.array(markers))


def _half_us(angle_deg: float) -> int:
    return round(3000 + angle_deg * 2000 / 90)


def hostile_frames(
    markers_mm: Array, hostility: Hostility, rng: np.random.Generator
) -> Iterator[tuple[Array, NDArray[np.intp]]]:
    """Points of each frame, (n, 3), and their identity: 0 to 2 for markers, -1 for phantoms."""
    for frame, true in enumerate(markers_mm):
        clear = frame < hostility.first_frame
        seen = (rng.random(3) >= hostility.occlusion) | clear
        points = [true + rng.normal(0.0, NOISE_MM, (3, 3))]
        count = 0 if clear else rng.integers(0, hostility.phantoms + 1)
        points.append(np.array([_phantom(true, hostility, rng) for _ in range(count)]))
        everything = np.concatenate([points[0][seen], points[1].reshape(-1, 3)])
        identity = np.concatenate([np.flatnonzero(seen), np.full(count, -1)])
        order = rng.permutation(len(everything))
        yield everything[order], identity[order]


def _phantom(true: Array, hostility: Hostility, rng: np.random.Generator) -> Array:
    kind = hostility.kinds[rng.integers(len(hostility.kinds))]
    if kind == "u":
        return np.asarray(true.mean(axis=0) + rng.uniform(-150.0, 150.0, 3))
    if kind == "n":
        direction = rng.normal(size=3)
        away = rng.uniform(3.0, 30.0) * direction / np.linalg.norm(direction)
        return np.asarray(true[rng.integers(3)] + away)
    first, second, third = true[rng.permutation(3)]
    # The fourth corner, coplanar with the three markers like the phantoms of a stereo camera.
    return np.asarray(first + second - third + rng.normal(0.0, 0.5, 3))


def judge(
    motion: Motion, hostility: Hostility, seed: int, score: Score, *, registered: bool = True
) -> None:
    """Label a motion seen by a camera at a random angle, registered to about 0.5 deg."""
    rng = np.random.default_rng(seed)
    to_robot = Rotation.from_rotvec(rng.normal(size=3) * 1.5).as_matrix()
    off = Rotation.from_rotvec(rng.normal(0.0, 0.3, 3), degrees=True)
    believed = off.as_matrix() @ to_robot
    labeller = Labeller(Robot(), believed if registered else None)
    in_camera = motion.markers_mm @ to_robot + CAMERA_MM
    since_tip = FRESH_FRAMES
    frames = hostile_frames(in_camera, hostility, rng)
    for number, (points, identity) in enumerate(frames):
        start_ns = perf_counter_ns()
        found = labeller.label(number * FRAME_US, points, motion.q_rad[number])
        score.times_us.append((perf_counter_ns() - start_ns) / 1000.0)
        _count_labels(found, in_camera[number], points, identity, score)
        score.frames += 1
        score.visible += int(2 in identity)
        since_tip += 1
        tip_mm = found[2] - found[0]
        if np.isfinite(tip_mm).all():
            since_tip = 0
            score.tips += 1
            true_mm = in_camera[number, 2] - in_camera[number, 0]
            error_mm = float(np.linalg.norm(tip_mm - true_mm))
            score.false_tips += error_mm > FALSE_MM
            score.worst_mm = max(score.worst_mm, error_mm)
        score.fresh += since_tip < FRESH_FRAMES


def _count_labels(
    labelled: Array, true: Array, points: Array, identity: NDArray[np.intp], score: Score
) -> None:
    if not np.isnan(labelled[0, 0]) and np.linalg.norm(labelled[0] - true[0]) > 1.0:
        score.swaps += 1
    for marker in (1, 2):
        if not np.isnan(labelled[marker, 0]):
            nearest = np.argmin(np.linalg.norm(points - labelled[marker], axis=1))
            score.phantoms += int(identity[nearest] == -1)
            score.swaps += int(identity[nearest] not in (-1, marker))


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seed", type=int, default=1)
    seed = parser.parse_args().seed
    views = {
        "hostile": Hostility(),
        "occlusion only": Hostility(phantoms=0),
        "clear view": Hostility(phantoms=0, occlusion=0.0),
    }
    print(
        f"{'':28} {'frames':>6} {'tips':>6} {'of seen':>8} {'fresh':>6} {'swaps':>6} "
        f"{'phantoms':>9} {'false':>6} {'worst mm':>9} {'ms p50':>8} {'p99':>6}"
    )
    motions = {
        "closed loop, 1 Hz": [closed_loop(path) for path in PATHS],
        "20 Hz": [at_20_hz(path) for path in PATHS],
    }
    for view, hostility in views.items():
        for name, paths in motions.items():
            score = Score()
            for number, motion in enumerate(paths):
                judge(motion, hostility, 100 * seed + number, score)
            print(score.row(f"{view}, {name}"), flush=True)


if __name__ == "__main__":
    main()
