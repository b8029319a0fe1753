"""Labelling: finds M1, M2 and so on among the points of a camera.

Single spheres have no identity, but M1 does not move; the others are connected to M1 by the robot,
which has few degrees of freedom; and markers persist while phantoms do not. So markers are not
labelled frame by frame. A few hypotheses about the whole history are maintained
(``hypotheses``). Each frame continues each of them in all possible ways (all labels together, since
every marker constrains the others). A marker is only reported if the hypotheses that disagree about
it are together less likely than `DOUBT`. Every doubtful marker counts as lost.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike

from ccr_host.core.arrays import Array
from ccr_host.description.schema import Robot
from ccr_host.tracking.markers.hypotheses import (
    FADED,
    MISSING,
    NEAR_MM,
    Hypothesis,
    Scene,
    births,
    continuations,
    jumps,
)
from ccr_host.tracking.markers.motion_models import ChainModel, FreeModel, MotionModel

DOUBT = 1e-4
"""Probability of being wrong above which a marker counts as lost."""
HARMLESS_MM = 2.0
"""A marker also counts as lost if a phantom mistaken for it could be further off than this. If the
robot may have moved far since the last frame, the next frame must confirm the point. The limit is
wider in proportion if phantoms are rare."""
BASE_MEMORY_US = 3_000_000
"""Time for which M1 is assumed to be where it was seen last."""

_LOG_DOUBT = math.log(DOUBT)
_TRUST = 35.0
"""Highest score, so that ten frames can refute a hypothesis with any history."""
_MOST = 12
"""Number of hypotheses kept."""
_PROVEN_FRAMES = 4
"""Complete frames before a hypothesis is believed."""
_MOST_POINTS = 50
"""The most strays that a Polaris reports."""
_STIR_S = 0.1
"""Servos follow their commands within about this time."""
_PHANTOMS_AT_START = 1.0
_PHANTOMS_FLOOR = 0.3
"""Minimum expected number near a marker, however clean the camera's view has been."""
_PHANTOM_FRAMES = 100
"""Number of frames over which phantoms are averaged."""
_CLEAN_FRAMES = 40
"""Frames without surplus points after which phantoms count as rare; a single one ends that."""
_PHANTOM_MARGIN = 3.0
"""Safety factor of the number of phantoms, as a mistake is worse than a lost frame."""


class Labeller:
    """Labels the points of successive frames.

    ``camera_to_robot`` is the registered rotation, (3, 3); None before registration, when only
    distances are used and fewer frames come out certain.
    """

    def __init__(self, geometry: Robot, camera_to_robot: Array | None = None) -> None:
        self._model: MotionModel = (
            FreeModel(geometry) if camera_to_robot is None else ChainModel(geometry)
        )
        self._camera_to_robot = np.eye(3) if camera_to_robot is None else camera_to_robot
        self._hypotheses: list[Hypothesis] = []
        self._time_us: int | None = None
        self._q_rad: Array | None = None
        self._markers = len(geometry.markers)
        self._stir_rad: Array = np.zeros(geometry.motors)
        self._phantoms = _PHANTOMS_AT_START
        self._clean_frames = 0

    def label(self, exposed_us: int, points_mm: ArrayLike, q_rad: ArrayLike) -> Array:
        """Label the next frame.

        Args:
            exposed_us: time of exposure, later than that of the previous frame.
            points_mm: (n, 3), in the camera's frame, in any order.
            q_rad: (n,), believed motor angles at the exposure.

        Returns:
            The certain markers in the camera's frame, M1, M2 and so on, (S + 1, 3); NaN if lost. M1
            is the mean of its latest sightings.

        Raises:
            ValueError: the time is not later.
        """
        if self._time_us is not None and exposed_us <= self._time_us:
            raise ValueError(f"frame exposed at {exposed_us} us after one at {self._time_us} us")
        duration_s = 0.0 if self._time_us is None else (exposed_us - self._time_us) * 1e-6
        self._time_us = exposed_us
        points = np.asarray(points_mm, dtype=np.float64).reshape(-1, 3)[:_MOST_POINTS]
        scene = self._scene(points, exposed_us, np.asarray(q_rad, dtype=np.float64), duration_s)
        self._hypotheses = _pruned(self._grown(scene, duration_s))
        self._count_phantoms(scene)
        return self._verdict(scene)

    def _scene(self, points: Array, exposed_us: int, q_rad: Array, duration_s: float) -> Scene:
        moved = np.zeros_like(q_rad) if self._q_rad is None else np.abs(q_rad - self._q_rad)
        self._q_rad = q_rad
        self._stir_rad = self._stir_rad * math.exp(-duration_s / _STIR_S) + moved
        self._clean_frames = self._clean_frames + 1 if len(points) <= self._markers else 0
        clean = self._clean_frames >= _CLEAN_FRAMES
        expected = 0.0 if clean else _PHANTOM_MARGIN * self._phantoms
        return Scene(
            points_mm=points,
            time_us=exposed_us,
            camera_to_robot=self._camera_to_robot,
            q_rad=q_rad,
            motor_motion_rad=self._stir_rad,
            phantoms=max(expected, _PHANTOMS_FLOOR),
            clean=clean,
        )

    def _count_phantoms(self, scene: Scene) -> None:
        """Count the points near a moving marker that the best hypothesis does not use, or all."""
        found = float(len(scene.points_mm))
        if self._hypotheses:
            best = self._hypotheses[0]
            left_over = np.delete(
                scene.relative(best.base), [p for p in best.points if p != MISSING], axis=0
            )
            distances = np.linalg.norm(left_over[:, None] - best.expected_mm, axis=2)
            found = float(np.max(np.sum(distances < NEAR_MM, axis=0)))
        self._phantoms += (found - self._phantoms) / _PHANTOM_FRAMES

    def _grown(self, scene: Scene, duration_s: float) -> Iterable[Hypothesis]:
        grown = [
            child
            for parent in self._hypotheses
            if scene.time_us - parent.base.seen_us <= BASE_MEMORY_US
            for child in continuations(parent, scene, duration_s)
        ]
        best = max(grown, key=lambda one: one.score, default=None)
        if best is None or best.complete_frames < _PROVEN_FRAMES:
            grown.extend(births(scene, self._model))
        if best is not None and MISSING in best.points[1:]:
            parent = max(self._hypotheses, key=lambda one: one.score)
            grown.extend(jumps(parent, scene))
        return grown

    def _verdict(self, scene: Scene) -> Array:
        markers: Array = np.full((self._markers, 3), np.nan)
        if not self._hypotheses:
            return markers
        best = self._hypotheses[0]
        if best.complete_frames >= _PROVEN_FRAMES and self._is_certain(
            _same_base(best, self._hypotheses)
        ):
            markers[0] = best.base.place_mm
            for marker in range(1, self._markers):
                point = best.points[marker]
                agreeing = [one.points[marker] == point for one in self._hypotheses]
                harmless = best.harm_mm[marker - 1] <= HARMLESS_MM / min(1.0, scene.phantoms)
                if point != MISSING and harmless and self._is_certain(agreeing):
                    markers[marker] = scene.points_mm[point]
        return markers

    def _is_certain(self, agreeing: list[bool]) -> bool:
        """Whether hypotheses that disagree are negligible, and also that none is true."""
        scores = np.array([one.score for one in self._hypotheses])
        favour = np.logaddexp.reduce(scores[np.array(agreeing)])
        against = np.logaddexp.reduce([0.0, *scores[~np.array(agreeing)]])
        return bool(against - favour < _LOG_DOUBT)


def _same_base(best: Hypothesis, hypotheses: list[Hypothesis]) -> list[bool]:
    return [
        bool(np.linalg.norm(one.base.place_mm - best.base.place_mm) < 1.0) for one in hypotheses
    ]


def _pruned(grown: Iterable[Hypothesis]) -> list[Hypothesis]:
    """Sort by score; merge equal hypotheses, drop unlikely ones, limit scores to `_TRUST`."""
    kept: list[Hypothesis] = []
    for one in sorted(grown, key=lambda one: -one.score):
        if kept and (one.score < kept[0].score - FADED or len(kept) == _MOST):
            break
        for index, better in enumerate(kept):
            if better.resembles(one):
                score = float(np.logaddexp(better.score, one.score))
                kept[index] = replace(better, score=score)
                break
        else:
            kept.append(one)
    excess = max(0.0, kept[0].score - _TRUST) if kept else 0.0
    return [replace(one, score=one.score - excess) for one in kept]
