"""Where the fit to a new robot starts: in which frame, and which motors are reversed or exchanged.

Under a hypothesis on the motors the prior predicts the markers, and a rotation turns those seen
onto them. The nearest hypothesis counts. Of more than two motors, the moves of single ones are
compared: in frames all around the backbone, an assignment tells which motor each acts as.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Iterator
from itertools import combinations, permutations, product
from operator import attrgetter
from typing import Any, Generic, NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment
from scipy.spatial.transform import Rotation

from ccr_host.control.adaptive.identification import Predict
from ccr_host.control.adaptive.misfit import Motors, motors_exchanged
from ccr_host.control.adaptive.model import make_static_model
from ccr_host.control.adaptive.parameter_space import ParameterSpace
from ccr_host.core.errors import CcrError
from ccr_host.description.schema import Description
from ccr_host.robot.rests import Rests

Array = NDArray[np.float64]
P = TypeVar("P")

_MOST_HYPOTHESES = 8
"""On the motors; of more, only likely ones are tried."""
_ROLLS, _TURNS = 12, 10
"""Frames from which likely ones are searched, and how often each is corrected."""
_EXCHANGED = 1.06
"""Factor of the distance for each motor that is exchanged: rarer than a reversed one."""
_ALIKE_TRACE = 1.0 + math.sqrt(2.0)
"""Of the turn between two frames that are the same: 45 deg."""
_ALONG = np.array([0.0, 1.0, 0.0])
"""Along the backbone of the straight robot, in the frame of (10)."""
_DISTINCT = 1.03
"""Least ratio of the distances from the predictions of two hypotheses on the motors; 1.08 and more
on robots with one thing wrong, 1.001 with markers on the backbone of a robot without weight."""


class SurveyError(CcrError):
    """The rests do not determine camera and servos reliably (exit status 3)."""


class Start(NamedTuple):
    """Where a fit starts."""

    off_mm: float
    """Root of the sum of squared distances between the turned markers and the prediction."""
    motors: Motors
    to_frame: Array
    """(3, 3): from the camera's frame to one near the robot's."""
    score: Array


_OFF_MM = attrgetter("off_mm")


def likeliest_motors(rests: Rests, description: Description) -> Motors:
    """The hypothesis on the motors whose prediction is nearest to rests, in any frame.

    Raises:
        SurveyError: another hypothesis, whose frame is not the same, is as near.
        MisfitError: motors are exchanged.
    """
    model, space = make_static_model(description, is_new=True)
    return nearest_motors(rests.ends(), space, model.predicted_mm)


def starts_of(
    motors: Motors, rests: Rests, space: ParameterSpace[Any], predict: Predict[Any]
) -> list[Start]:
    """The nearest start of each row of ``space.starts``, the nearest one first."""
    scores = space.starts()
    seen_mm = rests.vectors_mm.reshape(-1, 3)
    expected_mm = predict(space.each(scores.reshape(-1, space.count)), motors.drive(rests))
    expected_mm = expected_mm.reshape(len(rests.q_rad), *scores.shape[:2], -1, 3)
    rows = np.moveaxis(expected_mm, 0, 2).reshape(*scores.shape[:2], -1, 3)
    found = [
        min((_start(motors, *at, seen_mm) for at in zip(*row, strict=True)), key=_OFF_MM)
        for row in zip(rows, scores, strict=True)
    ]
    return sorted(found, key=_OFF_MM)


def _start(motors: Motors, expected_mm: Array, score: Array, seen_mm: Array) -> Start:
    turn, off_mm = Rotation.align_vectors(expected_mm, seen_mm)
    return Start(float(off_mm), motors, turn.as_matrix(), score)


def _neighbours(motors: Motors) -> Iterator[Motors]:
    """Another motor reversed, or two others exchanged."""
    signs, order = list(motors.signs), list(motors.order)
    for motor in range(len(signs)):
        yield motors._replace(signs=(*signs[:motor], -signs[motor], *signs[motor + 1 :]))
    for one, other in combinations(range(len(order)), 2):
        swapped = order.copy()
        swapped[one], swapped[other] = swapped[other], swapped[one]
        yield motors._replace(order=tuple(swapped))


def nearest_motors(rests: Rests, space: ParameterSpace[Any], predict: Predict[Any]) -> Motors:
    """The hypothesis on the motors that is nearest.

    Raises:
        SurveyError: another hypothesis, whose frame is not the same, is as near.
        MisfitError: motors are exchanged.
    """
    count = len(rests.start_rad)
    judged, judge, supposed, doubt = rests, predict, _all_hypotheses(count), 1.0
    if not supposed:
        judge = moves = _SmallMoves(predict, rests)
        judged, supposed, doubt = moves.rests, moves.hypotheses(space), _EXCHANGED
    trials = {motors: starts_of(motors, judged, space, judge) for motors in supposed}

    def off_mm(motors: Motors) -> float:
        return trials[motors][0].off_mm * doubt ** len(motors.exchanged)

    best, rival, *_ = sorted(trials, key=off_mm)
    if off_mm(rival) < _DISTINCT * off_mm(best):
        first, second = (trials[motors][0].to_frame for motors in (best, rival))
        if np.trace(first.T @ second) > _ALIKE_TRACE:
            raise SurveyError(
                "small moves do not tell which motors are reversed or exchanged",
                "take up the slack of all tendons, or find the signs of "
                "servo.pulse_per_90_deg_us with ccr-host jog",
            )
        raise SurveyError(
            "the markers do not tell up from down: the rests fit markers on either side of the "
            "backbone",
            "mount all markers on the same side, further from the backbone, and correct "
            "robot.marker_offset_mm",
        )
    if best.exchanged:
        raise motors_exchanged(best)
    return best


def _all_hypotheses(count: int) -> Collection[Motors]:
    """All on the motors; none if those are too many."""
    if (1 << count) * math.factorial(count) > _MOST_HYPOTHESES:
        return []
    return [
        Motors(signs, order)
        for order in permutations(range(count))
        for signs in product((1.0, -1.0), repeat=count)
    ]


class _SmallMoves(Generic[P]):
    """What each motor alone does to the markers, seen and predicted by the prior.

    Zeros move all poses of a motor alike, so that their differences are compared, and one mean.
    The prior has hardly a memory of its motion: each pose is predicted once.

    Args:
        predict: predicts rests.
        rests: those of the tour.
    """

    def __init__(self, predict: Predict[P], rests: Rests) -> None:
        self._predict = predict
        self._known: dict[tuple[float, ...], Array] = {}
        moves = rests.chosen(np.count_nonzero(rests.q_rad, axis=1) <= 1)
        motors = np.abs(moves.q_rad).argmax(axis=1)
        alike = np.equal.outer(motors, motors)
        self._differences = np.vstack(
            [np.eye(len(motors)) - alike / alike.sum(axis=1), np.ones(len(motors)) / len(motors)]
        )
        more = moves.then(moves.chosen([0]))
        self.rests = Rests.of_vectors(
            more.start_rad, more.q_rad, self._differed(moves.vectors_mm), more.count
        )

    def __call__(self, p: P, rests: Rests) -> Array:
        poses = [tuple(row) for row in rests.q_rad[:-1].round(6).tolist()]
        new = {pose: row for row, pose in enumerate(poses) if pose not in self._known}
        if new:
            expected_mm = self._predict(p, rests.chosen(list(new.values())))
            self._known |= zip(new, expected_mm, strict=True)
        return self._differed(np.stack([self._known[pose] for pose in poses]))

    def hypotheses(self, space: ParameterSpace[P]) -> set[Motors]:
        """The likeliest ones in frames all around the backbone, and those that differ little."""
        p, seen = space.parameters(np.zeros(space.count)), self.rests
        count = len(seen.start_rad)
        reversed_ = Motors((-1.0,) * count, tuple(range(count))).drive(seen)
        expected = np.stack([self._responses(self(p, rests)) for rests in (seen, reversed_)])
        mean_mm = self(p, seen)[-1]
        upright, _ = Rotation.align_vectors(mean_mm[-1], seen.tip_mm[-1])
        found = set()
        for share in range(_ROLLS):
            roll = Rotation.from_rotvec(_ALONG * 2.0 * math.pi * share / _ROLLS)
            turn = roll * upright
            motors = self._nearest(turn, expected)
            for _ in range(_TURNS):
                (start,) = starts_of(motors, seen, space, self)
                again = self._nearest(Rotation.from_matrix(start.to_frame), expected)
                if again == motors:
                    break
                motors = again
            found.add(motors)
        return found | {near for motors in found for near in _neighbours(motors)}

    def _nearest(self, turn: Rotation, expected: Array) -> Motors:
        """The hypothesis whose responses, (2, n, V, 3) with signs 1 and -1, are nearest."""
        seen = self._responses(self.rests.turned(turn.as_matrix()).vectors_mm)
        off = ((expected[:, None] - seen[None, :, None]) ** 2).sum(axis=(-1, -2))
        motors, acting = linear_sum_assignment(off.min(axis=0))
        order = np.empty(len(motors), dtype=int)
        order[acting] = motors
        signs = np.where(off[0, motors, acting] <= off[1, motors, acting], 1.0, -1.0)
        return Motors(tuple(signs.tolist()), tuple(order.tolist()))

    def _responses(self, differed_mm: Array) -> Array:
        """Motion of the markers by each motor, mm/rad, (n, V, 3)."""
        q_rad = self.rests.q_rad[:-1]
        slopes = np.tensordot(q_rad, differed_mm[:-1], axes=(0, 0))
        responses: Array = slopes / (q_rad**2).sum(axis=0)[:, None, None]
        return responses

    def _differed(self, vectors_mm: Array) -> Array:
        differed: Array = np.tensordot(self._differences, vectors_mm, axes=1)
        return differed
