"""Where the fit to a new robot starts: in which frame, and which motors are reversed or exchanged.

Under a hypothesis on the motors the prior predicts the markers, and a rotation turns those seen
onto them. The nearest hypothesis counts, or of several as near the one whose fit is likeliest. Of
more than two motors, the moves of single ones are compared: in frames all around the backbone, an
assignment tells which motor each acts as.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Iterator
from dataclasses import replace
from itertools import combinations_with_replacement, permutations, product
from operator import attrgetter
from typing import Any, Generic, NamedTuple, TypeVar

import numpy as np
from scipy.optimize import linear_sum_assignment
from scipy.spatial.transform import Rotation

from ccr_host.control.adaptive.identification import Fit, StaticsFit
from ccr_host.control.adaptive.misfit import motors_exchanged
from ccr_host.control.adaptive.model import make_static_model
from ccr_host.control.adaptive.parameter_space import ParameterSpace
from ccr_host.control.adaptive.static_model import StaticModel
from ccr_host.core.arrays import Array
from ccr_host.core.errors import CcrError
from ccr_host.description.schema import Description
from ccr_host.robot.rests import Motors, Rests

P = TypeVar("P")
Predict = Callable[[P, Rests], Array]
"""See ``StaticModel.predicted_mm``."""

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
on robots with one thing wrong, 1.001 with markers on the backbone of a robot without weight. If it
is less, up to `_MOST_FITTED` are fitted."""
_MOST_FITTED = 4
_TOLD = 2.0
"""Least difference of twice the log odds of two fits, with variances inflated as everywhere, where
Kass and Raftery (1995) call evidence positive."""
_SHAFT_FACTOR = 1.5
"""By which an unexplained shaft angle is larger than in `adaptive`: zeros and directions that are
not yet calibrated move the robot further. Chosen on 40 random robots, as ``Scaling.inflation``."""


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
    """The hypothesis on the motors that is likeliest, whatever frame the rests are in.

    Raises:
        SurveyError: another hypothesis is about as likely.
        MisfitError: motors are exchanged.
    """
    model, space = model_of_new(description)
    return nearest_motors(rests, space, model)


def model_of_new(description: Description) -> tuple[StaticModel[Any, Any], ParameterSpace[Any]]:
    """The static model of a robot before setup, and the prior of its parameters."""
    model, space = make_static_model(description, is_new=True)
    space.shaft_rad *= _SHAFT_FACTOR
    return model, space


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
    """Another motor reversed, or two others exchanged, reversed or not."""
    for one, other in combinations_with_replacement(range(len(motors.order)), 2):
        order = list(motors.order)
        order[one], order[other] = order[other], order[one]
        for sign, other_sign in product((1.0, -1.0), repeat=2):
            signs = list(motors.signs)
            signs[order[one]] *= sign
            signs[order[other]] *= other_sign
            yield Motors(tuple(signs), tuple(order))


def nearest_motors(
    rests: Rests, space: ParameterSpace[Any], model: StaticModel[Any, Any]
) -> Motors:
    """The hypothesis on the motors that is nearest; of those as near, the one that fits best.

    Raises:
        SurveyError: neither distances nor fits tell it from another one.
        MisfitError: motors are exchanged.
    """
    count = rests.q_rad.shape[1]
    judge: Predict[Any] = model.predicted_mm
    judged, supposed, doubt = rests, _all_hypotheses(count), 1.0
    if not supposed:
        judge = moves = _SmallMoves(judge, rests)
        judged, supposed, doubt = moves.rests, moves.hypotheses(space), _EXCHANGED
    trials = {motors: starts_of(motors, judged, space, judge)[0] for motors in supposed}
    off_mm = {m: start.off_mm * doubt ** len(m.exchanged) for m, start in trials.items()}
    best, *rivals = sorted(off_mm, key=off_mm.__getitem__)[:_MOST_FITTED]
    rivals = [rival for rival in rivals if off_mm[rival] < _DISTINCT * off_mm[best]]
    if rivals:
        best = _likeliest([trials[motors] for motors in (best, *rivals)], rests, space, model)
    if best.exchanged:
        raise motors_exchanged(best)
    return best


def _likeliest(
    starts: list[Start], rests: Rests, space: ParameterSpace[Any], model: StaticModel[Any, Any]
) -> Motors:
    """The hypothesis on the motors under which the fitted rests are likeliest.

    Raises:
        SurveyError: another hypothesis is about as likely, or none explains the rests.
    """
    pulling = where_tendons_pull(rests)
    fits = [(start, fitted(start, pulling, space, model)) for start in starts]
    (best, fit), (rival, other), *_ = sorted(fits, key=lambda pair: -pair[1].evidence)
    least = _TOLD * space.inflation * max(1.0, fit.surprise**2)
    if fit.explains and fit.evidence - other.evidence >= least:
        return best.motors
    if np.trace(best.to_frame.T @ rival.to_frame) > _ALIKE_TRACE:
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


def where_tendons_pull(rests: Rests) -> Rests:
    """The rests in which several motors bend the robot, all if there are none.

    Where one motor moves, slack segments rest anywhere within their friction.
    """
    several = np.count_nonzero(rests.q_rad, axis=1) > 1
    return rests.chosen(several) if several.any() else rests


def fitted(
    start: Start, rests: Rests, space: ParameterSpace[Any], model: StaticModel[Any, Any]
) -> Fit:
    """The fit from a start."""
    supposed = start.motors.drive(rests).turned(start.to_frame)
    return StaticsFit(space, supposed, model, start.score).finish()


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
    """

    def __init__(self, predict: Predict[P], rests: Rests) -> None:
        self._predict = predict
        self._known: dict[tuple[float, ...], Array] = {}
        moves = rests.chosen(np.count_nonzero(rests.q_rad, axis=1) <= 1)
        motors = np.abs(moves.q_rad).argmax(axis=1)
        self._is_of = np.equal.outer(motors, np.arange(moves.q_rad.shape[1])) * 1.0
        alike = self._is_of @ self._is_of.T
        self._differences = np.vstack(
            [np.eye(len(motors)) - alike / alike.sum(axis=1), np.ones(len(motors)) / len(motors)]
        )
        more = moves.then(moves.chosen([0]))
        self.rests = Rests.of_vectors(
            more.from_rad, more.q_rad, self._differed(moves.vectors_mm), more.count
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
        expected_mm = self._each_alone(p)
        mean_mm = self(p, seen)[-1]
        upright, _ = Rotation.align_vectors(mean_mm[-1], seen.tip_mm[-1])
        found = set()
        for share in range(_ROLLS):
            roll = Rotation.from_rotvec(_ALONG * 2.0 * math.pi * share / _ROLLS)
            motors = self._nearest((roll * upright).as_matrix(), expected_mm, 0.0)
            for _ in range(_TURNS):
                (start,) = starts_of(motors, seen, space, self)
                again = self._nearest(start.to_frame, expected_mm, start.off_mm)
                if again == motors:
                    break
                motors = again
            found.add(motors)
        return found | {near for motors in found for near in _neighbours(motors)}

    def _nearest(self, to_frame: Array, expected_mm: Array, off_mm: float) -> Motors:
        """The hypothesis that is nearest in a frame, where exchanged motors cost as elsewhere.

        ``to_frame`` is from that of the camera, (3, 3); ``expected_mm`` is of ``_each_alone``. The
        cost is relative to ``off_mm``, the distance so far.
        """
        seen_mm = self.rests.turned(to_frame).vectors_mm[:-1]
        off = ((expected_mm - seen_mm) ** 2).sum(axis=(-1, -2)) @ self._is_of
        count = off.shape[1]
        doubt = (_EXCHANGED**2 - 1.0) * off_mm**2 * (1.0 - np.eye(count))
        motors, acting = linear_sum_assignment(off.min(axis=0) + doubt)
        signs = np.ones(count)
        signs[acting] = np.where(off[0, motors, acting] <= off[1, motors, acting], 1.0, -1.0)
        return Motors(tuple(signs.tolist()), tuple(acting.tolist()))

    def _each_alone(self, p: P) -> Array:
        """Differences by each described motor if it makes all moves, (2, n, K, V, 3), and reversed.

        ``_is_of`` tells which motor made a move, (K, n).
        """
        rests, count = self.rests, self._is_of.shape[1]
        moved_rad = rests.q_rad.sum(axis=1)
        return np.stack(
            [
                [
                    self(p, replace(rests, q_rad=sign * np.outer(moved_rad, motor)))[:-1]
                    for motor in np.eye(count)
                ]
                for sign in (1.0, -1.0)
            ]
        )

    def _differed(self, vectors_mm: Array) -> Array:
        return np.tensordot(self._differences, vectors_mm, axes=1)
