"""A hypothesis on the labels of all points, and its continuations by the next frame.

Scores are log odds of everything that was seen, relative to all points being phantoms.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np

from ccr_host.core.arrays import Array
from ccr_host.tracking.markers.motion_models import Belief, MotionModel

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
FADED = 15.0
"""A hypothesis less likely than the best by this is dropped (3e-7)."""
_MOST_BRANCHES = 32
"""Choices for the first markers that are continued, the likeliest ones; with two moving markers
there are hardly ever as many."""


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
    """A history of all markers, and their points in the newest frame."""

    score: float
    base: Base
    model: MotionModel
    belief: Belief
    points: tuple[int, ...]
    """Indices of M1, M2 and so on in the newest frame, or `MISSING`."""
    harm_mm: tuple[float, ...]
    """Errors of M2 and so on if their points in the newest frame were phantoms."""
    hidden_frames: tuple[int, ...]
    """Number of frames for which M2 and so on have been hidden."""
    complete_frames: int
    """Number of frames so far in which all markers were seen."""

    @cached_property
    def expected_mm(self) -> Array:
        """(S, 3): M2 and so on relative to M1 after the newest frame."""
        return self.model.expect(self.belief)[0]

    def resembles(self, other: Hypothesis) -> bool:
        """Whether both agree on the positions of the markers, and will continue to agree."""
        return bool(
            np.max(np.abs(self.expected_mm - other.expected_mm)) < 4.0 * _NOISE_MM
            and np.max(np.abs(self.base.place_mm - other.base.place_mm)) < 4.0 * _NOISE_MM
            and self.points[2:] == other.points[2:]
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
    """(n,): believed motor angles."""
    motor_motion_rad: Array
    """(n,): their recent motion."""
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


class _Branch(NamedTuple):
    """Possible labels of the first moving markers."""

    points: tuple[int, ...]
    gain: float
    """Increase of the score."""
    harm_mm: tuple[float, ...]
    correction: Array
    """(n,): change of the belief's mean by these labels."""
    covariance: Array
    """(n, n): the belief's, given these labels."""


def continuations(parent: Hypothesis, scene: Scene, duration_s: float) -> Iterator[Hypothesis]:
    """The continuations of a hypothesis by the frame, without those that fade beside the best."""
    index, base, score = _find_base(parent, scene)
    model = parent.model
    before = model.moved(parent.belief, duration_s, scene.motor_motion_rad)
    relative = scene.relative(base)
    trunk = replace(parent, score=score, base=base, belief=before)
    branches = [_Branch((index,), 0.0, (), np.zeros_like(before.mean), before.covariance)]
    for hidden, place_mm, slope in zip(parent.hidden_frames, *model.expect(before), strict=True):
        seen = _probability_seen(hidden)
        misses_mm = relative - place_mm
        branches = [
            longer
            for branch in branches
            for longer in _lengthened(branch, misses_mm, slope, seen, scene.log_phantoms)
        ]
        if len(branches) > _MOST_BRANCHES:
            branches = sorted(branches, key=lambda one: -one.gain)[:_MOST_BRANCHES]
    best = -math.inf
    for branch in sorted(branches, key=lambda one: -one.gain):
        if branch.gain < best - FADED:
            return
        child = _with_labels(trunk, branch)
        if model.holds(child.belief):
            best = max(best, branch.gain)
            yield child


def jumps(parent: Hypothesis, scene: Scene) -> Iterator[Hypothesis]:
    """Continuations in which the robot is suddenly elsewhere, on the same base.

    In a clean view they are believed at once, if they are certain; otherwise they must be confirmed
    like a birth.
    """
    index, base, score = _find_base(parent, scene)
    log_prior = _LOG_JUMP_IN_CLEAN_VIEW if scene.clean else _LOG_JUMP
    trunk = replace(parent, score=score + log_prior, base=base)
    for jumped in _planted([trunk], [index], scene):
        if scene.clean and MISSING not in jumped.points:
            complete_frames = parent.complete_frames + 1
            harm_mm = (0.0,) * len(jumped.harm_mm)
            yield replace(jumped, complete_frames=complete_frames, harm_mm=harm_mm)
        else:
            yield jumped


def births(scene: Scene, model: MotionModel) -> Iterator[Hypothesis]:
    """Hypotheses on the robot in a frame, without a history."""
    score = math.log(_SEEN) - scene.log_phantoms - math.log(_ROOM_MM3)
    nothing = Belief(np.zeros(0), np.zeros((0, 0)), np.zeros(0))
    trunks = [
        Hypothesis(score, Base(place_mm, 1, scene.time_us), model, nothing, (), (), (), 0)
        for place_mm in scene.points_mm
    ]
    yield from _planted(trunks, list(range(len(trunks))), scene)


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


def _lengthened(
    branch: _Branch, misses_mm: Array, slope: Array, seen: float, log_phantoms: float
) -> Iterator[_Branch]:
    """A branch with the possible points of one more marker, and with its being missing.

    ``misses_mm`` are the points relative to where the marker is expected without labels, (N, 3),
    ``slope`` is the derivative of that place by the state, (3, n).
    """
    missing, harmed = (*branch.points, MISSING), (*branch.harm_mm, math.inf)
    yield branch._replace(points=missing, gain=branch.gain + math.log(1.0 - seen), harm_mm=harmed)
    if len(misses_mm) == 0:
        return
    misses_mm = misses_mm - slope @ branch.correction
    by_state = branch.covariance @ slope.T
    own = slope @ by_state + _NOISE_MM**2 * np.eye(3)
    inverse = np.linalg.inv(own)
    squares = np.einsum("ni,ij,nj->n", misses_mm, inverse, misses_mm)
    constant = math.log(seen) - log_phantoms - 0.5 * math.log(np.linalg.det(2.0 * math.pi * own))
    gain = by_state @ inverse
    remaining = branch.covariance - gain @ by_state.T
    widest_mm = math.sqrt(float(np.linalg.eigvalsh(own)[-1]))
    for index in np.flatnonzero(squares < _GATE).tolist():
        if index not in branch.points:
            harm_mm = float(np.linalg.norm(misses_mm[index])) + 2.0 * widest_mm
            yield _Branch(
                (*branch.points, index),
                branch.gain + constant - 0.5 * float(squares[index]),
                (*branch.harm_mm, harm_mm),
                branch.correction + gain @ misses_mm[index],
                remaining,
            )


def _with_labels(trunk: Hypothesis, branch: _Branch) -> Hypothesis:
    before, surprise = trunk.belief, trunk.model.surprise(branch.correction)
    hidden = zip(trunk.hidden_frames, branch.points[1:], strict=True)
    return replace(
        trunk,
        score=trunk.score + branch.gain,
        belief=Belief(
            before.mean + branch.correction,
            0.5 * (branch.covariance + branch.covariance.T),
            np.maximum(before.agitation, surprise),
        ),
        points=branch.points,
        harm_mm=branch.harm_mm,
        hidden_frames=tuple(n + 1 if point == MISSING else 0 for n, point in hidden),
        complete_frames=trunk.complete_frames + (MISSING not in branch.points),
    )


def _planted(trunks: list[Hypothesis], bases: list[int], scene: Scene) -> Iterator[Hypothesis]:
    """Hypotheses with the robot's pose at all points of the frame that its shape allows.

    ``trunks`` have one of ``bases`` each: the point that it is, or `MISSING`.
    """
    if not trunks or len(scene.points_mm) == 0:
        return
    relative = np.stack([scene.relative(trunk.base) for trunk in trunks])
    model = trunks[0].model
    for found in model.shapes.among(relative, bases, scene.q_rad):
        trunk, points = trunks[found.view], (bases[found.view], *found.points)
        moving = len(found.points)
        seen = moving * (math.log(_SEEN) - scene.log_phantoms)
        yield replace(
            trunk,
            score=trunk.score + seen - 0.5 * found.cost - model.log_room,
            belief=model.started(found),
            points=points,
            harm_mm=(math.inf,) * moving,
            hidden_frames=(0,) * moving,
            complete_frames=1 if MISSING not in points else 0,
        )
