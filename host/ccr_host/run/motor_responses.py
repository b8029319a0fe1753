"""Small moves that show if a robot is the described one, and what each motor does in them.

The robot rests, then each motor makes a small move, which tells motors, their directions and a
turned camera apart. How far the markers follow depends on slack, stretch and weight, but not where
to: constant curvature says that well enough at the pose that the markers show.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Generator, Iterator
from functools import partial
from typing import Any, NamedTuple

import numpy as np
from scipy.optimize import least_squares, linear_sum_assignment

from ccr_host.control.adaptive.identification import RestSurvey, StaticsFit
from ccr_host.control.adaptive.misfit import (
    LEFT_HANDED,
    RIVAL,
    SWAP_CURE,
    is_doubtful,
    is_misfit,
)
from ccr_host.control.adaptive.model import make_static_model
from ccr_host.control.shell import Law, Measurement, PathView, Stage, smooth_moves
from ccr_host.core.arrays import Array, IntArray
from ccr_host.description.schema import Description, Robot
from ccr_host.robot.kinematics import ConstantCurvature
from ccr_host.robot.rests import Motors, Rests, numbered
from ccr_host.robot.setpoint_history import SetpointHistory
from ccr_host.robot.workspace import MotorLimits

_REACHES_RAD = np.radians((20.0, 35.0, 50.0))
"""Travel of each motor: beyond slack and a wrong zero, and half of what paths need; then, of a
robot that may be the described one or not, more, at which slack differs from scale."""
_REST_S = 0.8
_SAG_RAD = 0.35
"""Standard deviation of the bending that load and slack add to the commanded one."""
_MEASURED_SHARE = 0.02
"""Error of a marker's place by constant curvature, over the robot's length."""
_OFF_RAD = math.radians(15.0)
"""Standard deviation of the direction into which a motor moves the markers: on the twins of the
shipped robots it is up to 20 deg off, as tendons bend the segments that they pass."""
_LEAST_SHARE = 0.25
"""Share of its expected motion that a motor must make; of random robots that match
some keep 0.31 of it, as slack of 1.2 mm takes the rest."""
_PRICE = 6.0
"""Minus twice the log odds of each reversed motor, of an exchange, of a turned camera, and of one
whose axes are left-handed besides; and of the description, where something else is likelier."""


_TURNED = (
    "the camera stands otherwise than registered, or was never registered",
    "find out how it stands: ccr-host register",
)


class Responses(NamedTuple):
    """What each motor does to the robot's markers."""

    seen_mm: Array
    """(n, V): displacements of the markers seen by the motor's move."""
    expected_mm: Array
    """(n, V): those of the described robot."""

    def cosines(self) -> Array:
        """Cosines of the angles between seen and expected displacements, (n, n)."""
        seen, expected = (
            one / np.maximum(np.linalg.norm(one, axis=1, keepdims=True), 1e-9) for one in self
        )
        cosines: Array = np.clip(seen @ expected.T, -1.0, 1.0)
        return cosines

    def shares(self) -> Array:
        """How far the markers move, over the expected way, (n,)."""
        seen, expected = (np.linalg.norm(one, axis=1) for one in self)
        shares: Array = seen / np.maximum(expected, 1e-9)
        return shares


class Explanation(NamedTuple):
    """Which motors move the robot, and in which frame, at what cost."""

    motors: Motors
    of_camera: tuple[str, str] | None
    """Cause and cure if the camera stands otherwise than known."""
    cost: float
    """Minus twice the log likelihood, prices included, up to a constant."""

    @property
    def price(self) -> float:
        """Minus twice the log odds of what is not as described."""
        motors = self.motors
        odd = len(motors.idle) + len(motors.reversed) + bool(motors.exchanged)
        return _PRICE * (odd + (self.of_camera is not None))

    def supposed(self, rests: Rests, predicted_mm: Callable[[Rests], Array]) -> Rests:
        """The rests as the described robot would make them, which ``predicted_mm`` knows."""
        led = self.motors.drive(rests)
        if self.of_camera is None:
            return led
        return led.turned_onto(predicted_mm(led), mirrored=self.of_camera is LEFT_HANDED)

    def cause_and_cure(self) -> tuple[str, str] | None:
        """The differences from the description in words, None if there are none."""
        if idle := self.motors.idle:
            return (
                f"motor {numbered(idle)} hardly move{'s' * (len(idle) == 1)} it",
                "check the servo's supply, its zero (ccr-host calibrate) and the tendons: "
                "loose, off the pulley, or wound the other way",
            )
        cures = []
        if self.motors.exchanged:
            cures.append(SWAP_CURE)
        if self.motors.reversed:
            cures.append("negate its servo.pulse_per_90_deg_us, or the winding of its tendons")
        cause, cure = self.of_camera or ("", "")
        causes = ", ".join(filter(None, (self.motors.told(), cause)))
        told = f"most likely {causes}", "; ".join(filter(None, (*cures, cure)))
        return told if causes else None


def _best_rests(rests: Rests) -> list[int]:
    """The rest furthest from the first one, for each motor that was moved."""
    moved = np.abs(rests.q_rad - rests.q_rad[0]).argmax(axis=1)[1:]
    seen_mm = rests.vectors_mm - rests.vectors_mm[0]
    far_mm = np.linalg.norm(np.nan_to_num(seen_mm), axis=(1, 2))[1:]
    return [
        1 + int(max(np.flatnonzero(moved == motor), key=lambda number: far_mm[number]))
        for motor in np.unique(moved)
    ]


class MotorResponses:
    """Compares what motors did with what the description says.

    The first of ``rests`` is where the robot was; in each other one, one motor is elsewhere. Of
    several of a motor the one that moved the robot most counts.
    """

    def __init__(self, description: Description, rests: Rests) -> None:
        robot = description.robot
        self._model = ConstantCurvature(robot)
        self._length_mm = sum(self._model.lengths_mm)
        self._noise_mm = description.tracker.noise_mm
        self._rests = rests = rests.chosen([0, *_best_rests(rests)])
        led_rad = rests.q_rad - rests.q_rad[0]
        self.motors = np.abs(led_rad[1:]).argmax(axis=1)
        """The motors that were seen to be moved, by their numbers from 0."""
        self._led_rad = led_rad[1:]
        self.responses, self._pose_cost = self._responses(rests)

    def as_described(self) -> Explanation:
        """The description itself."""
        off_rad = np.arccos(np.diag(self.responses.cosines()))
        cost = float(((off_rad / _OFF_RAD) ** 2).sum()) + self._pose_cost
        return Explanation(Motors.as_described(self._model.motors), None, cost)

    def likeliest(self) -> Explanation:
        """What explains the responses best."""
        expected_mm = self._ends_mm(self._model.bending_rad(self._rests.q_rad))
        found = [self._explained(self.responses, None, self._pose_cost)]
        for mirrored, of_camera in enumerate((_TURNED, LEFT_HANDED)):
            turned = self._rests.turned_onto(expected_mm, mirrored=bool(mirrored))
            responses, cost = self._responses(turned)
            found.append(self._explained(responses, of_camera, cost + _PRICE * (1 + mirrored)))
        return min(found, key=lambda one: one.cost)

    def idle(self) -> IntArray:
        """Motors, from 0, that hardly move the robot."""
        moved_mm = np.linalg.norm(self.responses.seen_mm, axis=1)
        is_idle = (self.responses.shares() < _LEAST_SHARE) | (moved_mm < self._noise_mm)
        idle: IntArray = self.motors[is_idle]
        return idle

    def explanation(self) -> Explanation | None:
        """What is likely wrong with the motors or the camera, None if they act as described."""
        if len(idle := self.idle()):
            signs = np.ones(self._model.motors)
            signs[idle] = 0.0
            described = self.as_described()
            return described._replace(motors=described.motors._replace(signs=tuple(signs.tolist())))
        likeliest = self.likeliest()
        return likeliest if self.as_described().cost - likeliest.cost > _PRICE else None

    def _explained(
        self, responses: Responses, of_camera: tuple[str, str] | None, cost: float
    ) -> Explanation:
        cosines = responses.cosines()
        forward = (np.arccos(cosines) / _OFF_RAD) ** 2
        backward = (np.arccos(-cosines) / _OFF_RAD) ** 2 + _PRICE
        costs = np.minimum(forward, backward) + 0.5 * _PRICE * (1.0 - np.eye(len(cosines)))
        motors, acting = linear_sum_assignment(costs)
        is_reversed = forward[motors, acting] > backward[motors, acting]
        order, signs = np.arange(self._model.motors), np.ones(self._model.motors)
        order[self.motors[acting]] = self.motors[motors]
        signs[self.motors[motors[is_reversed]]] = -1.0
        total = cost + float(costs[motors, acting].sum())
        found = Motors(tuple(signs.tolist()), tuple(order.tolist()))
        return Explanation(found, of_camera, total)

    def _responses(self, rests: Rests) -> tuple[Responses, float]:
        """Responses, and how unlikely the robot's pose at the first rest is."""
        seen_mm = rests.vectors_mm
        start_rad = self._model.bending_rad(rests.q_rad[0])
        is_seen = np.isfinite(seen_mm[0]).all(axis=1)
        sigma_mm = _MEASURED_SHARE * self._length_mm

        def residuals(y: Array) -> Array:
            off_mm = (self._ends_mm(y[None])[0] - seen_mm[0])[is_seen]
            return np.concatenate([off_mm.ravel() / sigma_mm, (y - start_rad) / _SAG_RAD])

        fit = least_squares(residuals, start_rad)
        y: Array = fit.x
        bendings = y + self._led_rad @ self._model.bending_rad(np.eye(self._model.motors))
        expected_mm = self._ends_mm(bendings) - self._ends_mm(y[None])
        displaced_mm = seen_mm[1:] - seen_mm[0]
        both = np.isfinite(displaced_mm)
        count = len(displaced_mm)
        responses = Responses(
            np.where(both, displaced_mm, 0.0).reshape(count, -1),
            np.where(both, expected_mm, 0.0).reshape(count, -1),
        )
        return responses, 2.0 * float(fit.cost)

    def _ends_mm(self, bending_rad: Array) -> Array:
        """Ends of the segments, (N, S, 3)."""
        return self._model.markers_mm(bending_rad)[0]


def probe_stops(robot: Robot) -> Array:
    """Moves in units of the reach, (N, n): rest, then each motor to where it pulls a tendon.

    The first motor is last, as falling through its slack sets the robot swinging.
    """
    stops = [np.zeros(robot.motors)]
    for motor in reversed(range(robot.motors)):
        windings = {t.winding for _, t in robot.tendons if t.motor == motor + 1}
        stops.extend(side * np.eye(robot.motors)[motor] for side in sorted(windings, reverse=True))
    return np.array(stops)


class ProbeLaw(Law):
    """A few small moves that show whether the robot is the described one."""

    name = "checking that the robot moves as described"
    feedback_s = 0.0

    def __init__(self, description: Description) -> None:
        self._model, space = make_static_model(description)
        self._space = space.of_few_rests()
        self._description = description
        self._limits = MotorLimits.of(description.servo)
        self._stops = probe_stops(description.robot)

    def start(self, path: PathView, history: SetpointHistory) -> None:
        super().start(path, history)
        self._survey = RestSurvey(np.zeros_like(self._limits.lower_rad))
        self.fits: list[StaticsFit[Any]] = []
        """Fits that explain the rests so far, the likeliest first; before that none."""
        self.explanation: Explanation | None = None
        """Which motors or camera explain the rests better than the description, if others do."""
        self._is_undecided = False
        """Whether it is as likely as not that others do."""

    @property
    def rests(self) -> Rests:
        """The rests at which the robot was seen."""
        return self._survey.rests()

    def stages(self) -> Iterator[Stage]:
        """Moves, then a fit, during which the robot stays where it is; more moves if in doubt."""
        here_rad = self.history.at(math.inf)
        self._survey = RestSurvey(here_rad)
        for reach_rad in _REACHES_RAD:
            stops_rad = self._limits.clip(here_rad + reach_rad * self._stops)
            self._survey.visit(stops_rad)
            yield Stage(self.name, smooth_moves(self.history.at(math.inf), stops_rad, _REST_S))
            if not len(self.rests.count):
                return
            waiting = Stage(self.name, stops_rad[-1:], is_motion=False)
            for _ in self._judging(self.rests):
                yield waiting
            if not self._is_doubtful():
                return

    def _judging(self, rests: Rests) -> Iterator[None]:
        """Fit the rests, then as other motors or another camera would have made them, if likely."""
        self.fits = yield from self._fitting(rests)
        self.explanation, self._is_undecided = None, False
        was_led = len(rests.q_rad) > 1 and np.array_equal(rests.q_rad[0], rests.from_rad[0])
        if not (self._description.robot.segments and was_led):
            return
        likely = MotorResponses(self._description, rests).explanation()
        if likely is not None:
            described = self._space.parameters(np.zeros(self._space.count))
            supposed = likely.supposed(rests, partial(self._model.predicted_mm, described))
            others = yield from self._fitting(supposed)
            gain = self.fits[0].result().cost - others[0].result().cost
            self.explanation = likely if gain > likely.price else None
            self._is_undecided = abs(gain) <= likely.price

    def _fitting(self, rests: Rests) -> Generator[None, None, list[StaticsFit[Any]]]:
        """Fit rests, one step at a time; start again elsewhere if that may be better."""
        fits: list[StaticsFit[Any]] = []
        for start in self._space.few_starts():
            fit = StaticsFit(self._space, rests, self._model, start)
            yield
            while fit.improve():
                yield
            fits.append(fit)
            fits.sort(key=lambda one: one.result().cost)
            if not (self._space.has_modes or is_doubtful(fits[0].result(), self._space)):
                break
        best = fits[0].result().cost
        return [fit for fit in fits if fit.result().cost < best + RIVAL]

    def _is_doubtful(self) -> bool:
        """Whether farther moves, which take up more slack, should decide."""
        found = self.fits[0].result()
        if self.explanation is not None or is_misfit(found, self.fits[0].rests, self._space):
            return False
        return self._is_undecided or is_doubtful(found, self._space)

    def observe(self, measurement: Measurement) -> None:
        self._survey.add(self.history, measurement)
