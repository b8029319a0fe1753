"""Where the fit to a new robot starts: in which frame, and which motors are reversed or exchanged.

Under a hypothesis on the motors the prior predicts the markers, and a rotation turns those seen
onto them. The nearest hypothesis counts, or of several as near the one whose fit is likeliest. Of
more than two motors, small moves are compared, and hypotheses are corrected one motor or one
exchange at a time.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Collection
from functools import cache, partial
from itertools import combinations, permutations, product
from operator import attrgetter
from typing import Any, NamedTuple, TypeVar

import numpy as np
from scipy.spatial.transform import Rotation

from ccr_host.control.adaptive.identification import Fit, StaticsFit
from ccr_host.control.adaptive.misfit import motors_exchanged
from ccr_host.control.adaptive.model import make_static_model
from ccr_host.control.adaptive.parameter_space import ParameterSpace
from ccr_host.control.adaptive.static_model import StaticModel
from ccr_host.core.arrays import Array
from ccr_host.core.errors import CcrError
from ccr_host.description.schema import Description
from ccr_host.robot.kinematics import ConstantCurvature
from ccr_host.robot.rests import Motors, Rests, numbered
from ccr_host.robot.workspace import MotorLimits

P = TypeVar("P")
Predict = Callable[[P, Rests], Array]
"""See ``StaticModel.predicted_mm``."""

_ALIKE_STARTS = 3
"""The search begins where each of so many motors in turn is reversed or not, alike in all."""
_SAME_RAD = 1e-6
_SCALINGS, _SHARES = 4, (0.3, 1.5)
"""How often scales and the turn are found from each other, and the shares of the expected way that
a move may lead: slack takes some, and weight may add to it."""
_MOST_HYPOTHESES = 8
"""Hypotheses on the motors that are all tried; of more, only likely ones are."""
_EXCHANGED = 1.06
"""Factor of the distance for each motor that is exchanged: rarer than a reversed one."""
_ALIKE_TRACE = 1.0 + math.sqrt(2.0)
"""Least trace of the turn between two frames that count as the same: 45 deg."""
_DISTINCT = 1.03
"""Least ratio of the distances from the predictions of two hypotheses on the motors; 1.08 and more
on robots with one thing wrong, 1.001 with markers on the backbone of a robot without weight. If it
is less, up to `_MOST_FITTED` are fitted."""
_LEAST_SHARE, _SHOWS_MM = 0.1, 2.0
"""Share of the expected way below which a motor takes no tendon along, and that way at least: 0.00
of loose tendons, and of those that a zero 10 deg off leaves slack all along."""
_MOST_FITTED = 4
_TOLD = 2.0
"""Least difference of twice the log odds of two fits, with variances inflated as everywhere, where
Kass and Raftery (1995) call evidence positive."""
_SHAFT_FACTOR = 1.5
"""Factor by which an unexplained shaft angle is larger than in `adaptive`: zeros and directions not
yet calibrated move the robot further. Chosen on 40 random robots, as ``Scaling.inflation``."""


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

_SWING_DEG = 50.0
"""Amplitude of motor 1, as far as the tour of controller `adaptive` goes."""
_SIDEWAYS_DEG = 20.0
"""Amplitude of motor 2."""
_SHARE_OF_LIMITS = 0.6
"""Each motor uses at most this fraction of its range."""
_SWINGS: tuple[float, ...] = tuple(
    third / 3 for third in (0, 1, 2, 3, 2, 1, 0, -1, -2, -3, -2, -1, 0)
)
"""Poses of motor 1, all but the extremes approached from both sides, as friction bends the robot
otherwise on each."""
_SIDES: tuple[float, ...] = (1.0, 0.0, -1.0, 0.0)
"""Poses of motor 2."""
_ALONE_DEG = 30.0
_ALONE: tuple[float, ...] = (0.5, 1.0, 0.5, -1.0)
"""Poses of each motor of another robot, none of them slack but the first of all: what has a slack
robot rest is friction, which its model leaves out."""


def safe_poses_rad(description: Description) -> Array:
    """Motor angles to visit, (K, n): small, of one motor after the other, without pretension."""
    limits = MotorLimits.of(description.servo)
    reach_rad = np.maximum(_SHARE_OF_LIMITS * np.minimum(-limits.lower_rad, limits.upper_rad), 0.0)
    count = len(reach_rad)
    if description.robot.segments:
        amplitudes_deg = [_ALONE_DEG] * count
        shares = [(0.0, *_ALONE), *[_ALONE] * (count - 1)]
    else:
        amplitudes_deg, shares = [_SWING_DEG, _SIDEWAYS_DEG], [_SWINGS, _SIDES]
    sides = np.where(_pulls(description) < 0.0, -1.0, 1.0)
    alone_rad = np.diag(sides * np.minimum(np.radians(amplitudes_deg), reach_rad))
    stops = np.vstack([np.outer(own, row) for own, row in zip(shares, alone_rad, strict=True)])
    model = ConstantCurvature(description.robot)
    return limits.without_pretension(model, stops) + 0.0  # No negative zeros in files.


def _pulls(description: Description) -> Array:
    """Direction in which each motor winds tendons, (n,): 1, -1, or 0 if it does in both."""
    robot = description.robot
    windings = [set[float]() for _ in range(robot.motors)]
    for _, tendon in robot.tendons:
        windings[tendon.motor - 1].add(tendon.winding)
    return np.array([sum(own) for own in windings])


def likeliest_motors(rests: Rests, description: Description) -> Motors:
    """The hypothesis on the motors that is likeliest, whatever frame the rests are in.

    Raises:
        SurveyError: another hypothesis is about as likely.
        MisfitError: motors are exchanged.
    """
    near = nearest_starts(rests, description)
    best = near[0].motors if len(near) == 1 else _likeliest(near, rests, description)
    if best.exchanged:
        raise motors_exchanged(best)
    return best


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


def nearest_starts(
    rests: Rests, description: Description, *, in_order: bool = False
) -> list[Start]:
    """The nearest hypothesis on the motors, and those that are about as near.

    ``in_order``: of those by which no motors are exchanged, if there are more than two.
    """
    count = rests.q_rad.shape[1]
    model, space = model_of_new(description)
    supposed = _all_hypotheses(count)
    if supposed:
        start = cache(lambda motors: starts_of(motors, rests, space, model.predicted_mm)[0])
    else:
        moves = _SmallMoves(model, space, rests, safe_poses_rad(description))
        start = cache(moves.start)

    def off_mm(motors: Motors) -> float:
        return start(motors).off_mm * _EXCHANGED ** len(motors.exchanged)

    supposed = supposed or _searched(off_mm, count, in_order=in_order)
    near = sorted(supposed, key=off_mm)[:_MOST_FITTED]
    return [start(motors) for motors in near if off_mm(motors) <= _DISTINCT * off_mm(near[0])]


def _searched(off_mm: Callable[[Motors], float], count: int, *, in_order: bool) -> set[Motors]:
    """Hypotheses on the way to the nearest ones, by one change at a time."""
    described, tried = Motors.as_described(count), set[Motors]()

    def improved(here: Motors, near: Callable[[Motors], list[Motors]]) -> Motors:
        while True:
            tried.update(others := near(here))
            best = min(others, key=off_mm)
            if off_mm(best) >= off_mm(here):
                return here
            here = best

    signs = product((1.0, -1.0), repeat=_ALIKE_STARTS)
    alike = [described._replace(signs=(each * count)[:count]) for each in signs]
    best = min((improved(start, _reversed) for start in alike), key=off_mm)
    if not in_order:
        improved(best, lambda here: _exchanged(here) + _reversed(here))
    return tried | {best}


def _reversed(motors: Motors) -> list[Motors]:
    """One motor reversed."""
    signs = motors.signs
    return [
        motors._replace(signs=(*signs[:at], -sign, *signs[at + 1 :]))
        for at, sign in enumerate(signs)
    ]


def _exchanged(motors: Motors) -> list[Motors]:
    """Two motors exchanged, reversed or not."""
    found = []
    for one, other in combinations(range(len(motors.order)), 2):
        order = list(motors.order)
        order[one], order[other] = order[other], order[one]
        for sign, other_sign in product((1.0, -1.0), repeat=2):
            signs = list(motors.signs)
            signs[order[one]], signs[order[other]] = sign, other_sign
            found.append(Motors(tuple(signs), tuple(order)))
    return found


def require_pull(rests: Rests, description: Description, directions: Array) -> None:
    """Refuse small moves in which a motor, led in its direction, (n,), takes no tendon along.

    Raises:
        SurveyError: it names the motors.
    """
    moves = _SmallMoves(*model_of_new(description), rests, safe_poses_rad(description))
    described = Motors.as_described(len(directions))
    shares = moves.shares(described._replace(signs=tuple(directions)), _pulls(description))
    if len(idle := np.flatnonzero(shares < _LEAST_SHARE)):
        raise SurveyError(
            f"motor {numbered(idle)} hardly move{'s' * (len(idle) == 1)} the robot",
            "check its supply, and that its tendons are on its pulley, and wound in the described "
            "direction; tighten them",
        )


def guessed_directions(rests: Rests, description: Description) -> Array:
    """The likeliest directions of the motors, (n,), if none is exchanged, however unlikely."""
    near = nearest_starts(rests, description, in_order=True)
    best = near[0] if len(near) == 1 else _by_evidence(near, rests, description)[0][0]
    return np.array(best.motors.signs)


def _by_evidence(
    starts: list[Start], rests: Rests, description: Description
) -> list[tuple[Start, Fit]]:
    """The starts and the fits from them, the likeliest first."""
    model, space = model_of_new(description)
    pulling = where_tendons_pull(rests)
    fits = [(start, fitted(start, pulling, space, model)) for start in starts]
    return sorted(fits, key=lambda pair: -pair[1].evidence)


def _likeliest(starts: list[Start], rests: Rests, description: Description) -> Motors:
    """The hypothesis on the motors under which the fitted rests are likeliest.

    Raises:
        SurveyError: another hypothesis is about as likely, or none explains the rests.
    """
    (best, fit), (rival, other), *_ = _by_evidence(starts, rests, description)
    _, space = model_of_new(description)
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
    """The rests in which most of the motors that are led at a time bend the robot.

    Segments whose motors stay where they are rest, if slack, anywhere within their friction.
    """
    moved = np.count_nonzero(rests.q_rad, axis=1)
    return rests.chosen(moved > 0.5 * moved.max())


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


class _SmallMoves:
    """What small moves do to the markers, seen and predicted by the prior.

    Zeros move all poses of a motor's move alike, so that their differences are compared, and one
    mean. How far a move leads depends on slack, which zeros change, but not where to: it is scaled.
    The prior has hardly a memory of its motion: each pose is predicted once.
    """

    def __init__(
        self,
        model: StaticModel[Any, Any],
        space: ParameterSpace[Any],
        rests: Rests,
        poses_rad: Array,
    ) -> None:
        """``poses_rad`` are those of ``safe_poses_rad``, which were visited in any directions."""
        self._score = np.zeros(space.count)
        self._predicted_mm = partial(model.predicted_mm, space.parameters(self._score))
        self._known: dict[tuple[float, ...], Array] = {}
        apart_rad = np.abs(rests.q_rad[:, None]) - np.abs(poses_rad)
        self._moves = rests.chosen(np.abs(apart_rad).max(axis=2).min(axis=1) < _SAME_RAD)
        motors = np.abs(self._moves.q_rad).argmax(axis=1)
        self._rows = [np.flatnonzero(motors == motor) for motor in np.unique(motors)]
        self._seen_mm = self._differed(self._moves.vectors_mm)

    def shares(self, motors: Motors, pulls: Array) -> Array:
        """How far each motor leads the robot while it pulls, over the expected way, (n,).

        1 if that is not known; ``pulls`` as of `_pulls`.
        """
        to_frame, q_rad = self.start(motors).to_frame, motors.drive(self._moves).q_rad
        expected_mm = np.stack([self._known[tuple(row)] for row in q_rad.round(6).tolist()])
        seen_mm = self._moves.vectors_mm @ to_frame.T
        shares = np.ones(len(pulls))
        turned_rad = np.abs(q_rad)
        furthest = turned_rad > turned_rad.max(axis=1, keepdims=True) - _SAME_RAD
        is_pulling = furthest & (pulls * q_rad >= 0.0) & (turned_rad > 0.0)
        for motor in np.flatnonzero(is_pulling.any(axis=0)):
            rows = is_pulling[:, motor]
            own, seen = (mm[rows] - mm[rows].mean(axis=0) for mm in (expected_mm, seen_mm))
            if (most_mm2 := float((own**2).sum())) > _SHOWS_MM**2:
                shares[motor] = (own * seen).sum() / most_mm2
        return shares

    def start(self, motors: Motors) -> Start:
        """Where a fit under this hypothesis starts, and how near it is."""
        led = motors.drive(self._moves)
        poses = [tuple(row) for row in led.q_rad.round(6).tolist()]
        new = {pose: row for row, pose in enumerate(poses) if pose not in self._known}
        if new:
            self._known |= zip(new, self._predicted_mm(led.chosen([*new.values()])), strict=True)
        expected_mm = self._differed(np.stack([self._known[pose] for pose in poses]))
        scaled_mm = expected_mm.copy()
        for _ in range(_SCALINGS):
            turn, off_mm = Rotation.align_vectors(
                scaled_mm.reshape(-1, 3), self._seen_mm.reshape(-1, 3)
            )
            to_frame = turn.as_matrix()
            seen_mm = self._seen_mm @ to_frame.T
            for rows in self._rows:
                own, most = expected_mm[rows], max(float((expected_mm[rows] ** 2).sum()), 1e-9)
                share = np.clip((own * seen_mm[rows]).sum() / most, *_SHARES)
                scaled_mm[rows] = share * own
        return Start(float(off_mm), motors, to_frame, self._score)

    def _differed(self, vectors_mm: Array) -> Array:
        """Each move's poses without their mean, then the mean of all, (K + 1, S, 3)."""
        found = np.concatenate([vectors_mm, vectors_mm.mean(axis=0)[None]])
        for rows in self._rows:
            found[rows] -= vectors_mm[rows].mean(axis=0)
        return found
