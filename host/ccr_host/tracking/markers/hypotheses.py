"""A hypothesis on the labels of all points, and its continuations by the next frame.

Scores are log odds of everything that was seen, relative to all points being phantoms.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ccr_host.tracking.markers.motion_models import (
    M2_ROWS,
    M3_ROWS,
    Belief,
    Expectation,
    MotionModel,
    Seed,
    corrected,
)

Array = NDArray[np.float64]

MISSING = -1
"""Index of a marker that is not among the points."""

_NOISE_MM = 0.15
"""Noise per coordinate; a Polaris Vicra has 0.25 mm RMS in all three."""
_SEEN = 0.8
"""Probability that a marker seen before is seen again: low, so that occlusion is always likely."""
_HIDDEN_LONG = 0.02
"""Minimum probability that a marker long hidden is seen."""
NEAR_MM = 30.0
"""Distance from a marker within which phantoms are counted, as they are harmful there."""
_NEAR_MM3 = 4.0 / 3.0 * math.pi * NEAR_MM**3
_ROOM_MM3 = 200.0**3
"""Volume in which the base can be if nothing is known."""
_GATE = 25.0
"""Squared Mahalanobis distance of three coordinates: it rejects 1.5e-5 of the true markers."""
_LOG_JUMP = math.log(1e-3)
"""Probability that the robot is suddenly elsewhere: a push, a knock, wrong motor angles."""
_LOG_JUMP_IN_CLEAN_VIEW = math.log(0.3)
"""Likewise in a clean view: an oscillating robot leaves its gates in every frame; if no phantom has
been seen for long, the shape of the robot alone shows where it is."""

_BASE_GATE_MM = 1.0
_BASE_CREEP_MM = 0.1
"""Creep of base or camera that the memory of M1 follows."""
_BASE_MEMORY = 40
"""Frames over which the place of M1 is averaged."""


@dataclass(frozen=True, eq=False)
class Base:
    """The base marker M1, which does not move."""

    place_mm: Array
    """(3,): mean of the sightings, in the camera's frame."""
    frames: int
    """Number of frames in which it was seen."""
    seen_us: int
    """Time of the newest sighting."""

    @property
    def sigma_mm(self) -> float:
        """Uncertainty per coordinate of the next sighting."""
        share = 1.0 + 1.0 / min(self.frames, _BASE_MEMORY)
        return math.hypot(_NOISE_MM * math.sqrt(share), _BASE_CREEP_MM)

    def seen_at(self, place_mm: Array, time_us: int) -> Base:
        """Include another sighting in the average."""
        weight = 1.0 / min(self.frames + 1, _BASE_MEMORY)
        mean = self.place_mm + weight * (place_mm - self.place_mm)
        return Base(mean, self.frames + 1, time_us)


@dataclass(frozen=True, eq=False)
class Hypothesis:
    """A history of the three markers, and their points in the newest frame."""

    score: float
    base: Base
    belief: Belief
    points: tuple[int, int, int]
    """Indices of M1, M2 and M3 in the newest frame, or `MISSING`."""
    harm_mm: tuple[float, float]
    """Errors of M2 and M3 if their points in the newest frame were phantoms."""
    hidden_frames: tuple[int, int]
    """Number of frames for which M2 and M3 have been hidden."""
    complete_frames: int
    """Number of frames so far in which all three markers were seen."""
    expected_mm: Array
    """(6,): M2 and M3 relative to M1 after the newest frame."""

    def resembles(self, other: Hypothesis) -> bool:
        """Whether both agree on the positions of the markers, and will continue to agree."""
        return bool(
            np.max(np.abs(self.expected_mm - other.expected_mm)) < 4.0 * _NOISE_MM
            and np.max(np.abs(self.base.place_mm - other.base.place_mm)) < 4.0 * _NOISE_MM
            and self.points[2] == other.points[2]
        )


@dataclass(frozen=True, eq=False)
class Scene:
    """A frame, and what else is known at that time."""

    points_mm: Array
    """(n, 3): the points, in the camera's frame."""
    time_us: int
    camera_to_robot: Array
    """(3, 3)."""
    q_rad: Array
    """(2,): believed motor angles."""
    motor_motion_rad: Array
    """(2,): their recent motion."""
    phantoms: float
    """Expected number of phantoms within `NEAR_MM` of a marker."""
    clean: bool
    """Whether no surplus point has been seen for a while."""

    @property
    def log_phantoms(self) -> float:
        """Logarithm of the phantoms' density near the markers, per mm^3."""
        return math.log(self.phantoms / _NEAR_MM3)

    def relative(self, base: Base) -> Array:
        """(n, 3): the points relative to M1, in the frame of the motion model."""
        return (self.points_mm - base.place_mm) @ self.camera_to_robot.T


class _Choice(NamedTuple):
    """A possible label of a marker."""

    point: int
    gain: float
    """Increase of the score."""
    harm_mm: float
    after: Expectation
    """The belief given this label."""


def continuations(
    parent: Hypothesis, scene: Scene, duration_s: float, model: MotionModel
) -> Iterator[Hypothesis]:
    """All continuations of a hypothesis by the frame."""
    index, base, score = _find_base(parent, scene)
    before = model.moved(parent.belief, duration_s, scene.motor_motion_rad)
    expected = model.expect(before)
    relative = scene.relative(base)
    trunk = replace(parent, score=score, base=base, belief=before)
    seen_2, seen_3 = (_probability_seen(hidden) for hidden in parent.hidden_frames)
    density = scene.log_phantoms
    for two in _choices(M2_ROWS, expected, relative, seen_2, density, index):
        for three in _choices(M3_ROWS, two.after, relative, seen_3, density, index, two.point):
            child = _with_labels(trunk, index, two, three, expected, relative, model)
            if model.holds(child.belief):
                yield child


def jumps(parent: Hypothesis, scene: Scene, model: MotionModel) -> Iterator[Hypothesis]:
    """Continuations in which the robot is suddenly elsewhere, on the same base.

    In a clean view they are believed at once, if they are certain; otherwise they must be confirmed
    like a birth.
    """
    index, base, score = _find_base(parent, scene)
    relative = scene.relative(base)
    log_prior = _LOG_JUMP_IN_CLEAN_VIEW if scene.clean else _LOG_JUMP
    trunk = replace(parent, score=score + log_prior, base=base)
    for labels, seed in _seeded(relative, index, scene.q_rad, model):
        jumped = _planted(trunk, labels, seed, scene, model)
        if scene.clean and MISSING not in labels:
            complete_frames = parent.complete_frames + 1
            jumped = replace(jumped, complete_frames=complete_frames, harm_mm=(0.0, 0.0))
        yield jumped


def births(scene: Scene, model: MotionModel) -> Iterator[Hypothesis]:
    """Hypotheses on the robot in a frame, without a history."""
    for index, place_mm in enumerate(scene.points_mm):
        base = Base(place_mm, 1, scene.time_us)
        score = math.log(_SEEN) - scene.log_phantoms - math.log(_ROOM_MM3)
        relative = scene.relative(base)
        for labels, seed in _seeded(relative, index, scene.q_rad, model):
            trunk = Hypothesis(score, base, seed.belief, labels, (0.0, 0.0), (0, 0), 0, np.zeros(6))
            yield _planted(trunk, labels, seed, scene, model)


def _find_base(parent: Hypothesis, scene: Scene) -> tuple[int, Base, float]:
    """Index of M1 or `MISSING`, the base after this frame, and the score with it."""
    base = parent.base
    distances = np.linalg.norm(scene.points_mm - base.place_mm, axis=1)
    if distances.size == 0 or np.min(distances) > _BASE_GATE_MM:
        return MISSING, base, parent.score + math.log(1.0 - _SEEN)
    index = int(np.argmin(distances))
    sigma = base.sigma_mm
    exponent = -0.5 * (float(distances[index]) / sigma) ** 2
    density = exponent - 3.0 * math.log(sigma * math.sqrt(2.0 * math.pi))
    score = parent.score + math.log(_SEEN) + density - scene.log_phantoms
    return index, base.seen_at(scene.points_mm[index], scene.time_us), score


def _probability_seen(hidden_frames: int) -> float:
    """Probability that a marker is seen: one that is hidden stays hidden for a while."""
    return max(_SEEN / (1.0 + 0.5 * hidden_frames), _HIDDEN_LONG)


def _choices(
    rows: slice,
    expected: Expectation,
    points_mm: Array,
    seen: float,
    log_phantoms: float,
    *taken: int,
) -> Iterator[_Choice]:
    """The possible points of a marker, and that it is missing."""
    yield _Choice(MISSING, math.log(1.0 - seen), math.inf, expected)
    if len(points_mm) == 0:
        return
    own = expected.covariance_mm2[rows, rows] + _NOISE_MM**2 * np.eye(3)
    inverse = np.linalg.inv(own)
    misses = points_mm - expected.mean_mm[rows]
    squares = np.einsum("ni,ij,nj->n", misses, inverse, misses)
    constant = math.log(seen) - log_phantoms - 0.5 * math.log(np.linalg.det(2.0 * math.pi * own))
    gain = expected.covariance_mm2[:, rows] @ inverse
    remaining = expected.covariance_mm2 - gain @ expected.covariance_mm2[rows, :]
    widest_mm = math.sqrt(float(np.linalg.eigvalsh(own)[-1]))
    for index in np.flatnonzero(squares < _GATE):
        if int(index) not in taken:
            mean = expected.mean_mm + gain @ misses[index]
            after = Expectation(mean, remaining, expected.jacobian)
            harm_mm = float(np.linalg.norm(misses[index])) + 2.0 * widest_mm
            yield _Choice(int(index), constant - 0.5 * float(squares[index]), harm_mm, after)


def _with_labels(
    trunk: Hypothesis,
    base_index: int,
    two: _Choice,
    three: _Choice,
    expected: Expectation,
    relative: Array,
    model: MotionModel,
) -> Hypothesis:
    labels = (base_index, two.point, three.point)
    seen = [
        (np.arange(rows.start, rows.stop), relative[point])
        for rows, point in ((M2_ROWS, two.point), (M3_ROWS, three.point))
        if point != MISSING
    ]
    belief = trunk.belief
    if seen:
        rows = np.concatenate([row for row, _ in seen])
        places = np.concatenate([place for _, place in seen])
        mean, covariance = corrected(belief, expected, rows, places, _NOISE_MM)
        belief = model.settled(belief, mean, covariance)
        expected = model.expect(belief)
    return replace(
        trunk,
        score=trunk.score + two.gain + three.gain,
        belief=belief,
        points=labels,
        harm_mm=(two.harm_mm, three.harm_mm),
        hidden_frames=(
            _hidden(trunk.hidden_frames[0], labels[1]),
            _hidden(trunk.hidden_frames[1], labels[2]),
        ),
        complete_frames=trunk.complete_frames + (MISSING not in labels),
        expected_mm=expected.mean_mm,
    )


def _hidden(frames_before: int, point: int) -> int:
    return frames_before + 1 if point == MISSING else 0


def _seeded(
    relative: Array, base_index: int, q_rad: Array, model: MotionModel
) -> Iterator[tuple[tuple[int, int, int], Seed]]:
    from_1 = np.linalg.norm(relative, axis=1)
    between = np.linalg.norm(relative[:, None] - relative[None], axis=2)
    near_1 = _within(from_1, model.bounds.between_1_and_2)
    fits = near_1[:, None] & _within(between, model.bounds.between_2_and_3)
    if base_index != MISSING:
        fits[:, base_index] = False
    for point_2, point_3 in np.argwhere(fits).tolist():
        for seed in model.seeds(relative[point_2], relative[point_3], q_rad):
            yield (base_index, point_2, point_3), seed


def _within(distances: Array, interval: tuple[float, float]) -> NDArray[np.bool_]:
    return np.asarray((distances >= interval[0]) & (distances <= interval[1]))


def _planted(
    trunk: Hypothesis,
    labels: tuple[int, int, int],
    seed: Seed,
    scene: Scene,
    model: MotionModel,
) -> Hypothesis:
    return replace(
        trunk,
        score=trunk.score + 2.0 * (math.log(_SEEN) - scene.log_phantoms) + seed.log_density,
        belief=seed.belief,
        points=labels,
        harm_mm=(math.inf, math.inf),
        hidden_frames=(0, 0),
        complete_frames=1 if MISSING not in labels else 0,
        expected_mm=model.expect(seed.belief).mean_mm,
    )
