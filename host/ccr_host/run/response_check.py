"""Checks any robot's motion by what each of its motors does to the markers.

The robot rests, then each motor makes a small move. How far the markers follow depends on slack,
stretch and weight, but not where to: constant curvature says that well enough at the pose that the
markers show, to tell motors, their directions and a turned camera apart. The static model of
`adaptive` says more, about two planar segments.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares, linear_sum_assignment
from scipy.spatial.transform import Rotation

from ccr_host.control.adaptive.identification import RestSurvey
from ccr_host.control.adaptive.misfit import MisfitError
from ccr_host.control.shell import Law, Measurement, PathView, Shell, Stage, smooth_moves
from ccr_host.description.schema import Description
from ccr_host.robot.kinematics import ConstantCurvature
from ccr_host.robot.reference import Reference
from ccr_host.robot.rests import Rests
from ccr_host.robot.setpoint_history import SetpointHistory
from ccr_host.robot.workspace import MotorLimits

Array = NDArray[np.float64]
IntArray = NDArray[np.intp]

_REACH_RAD = math.radians(25.0)
_REST_S = 0.8
_SAG_RAD = 0.35
"""Standard deviation of the bending that load and slack add to the commanded one."""
_MEASURED_SHARE = 0.02
"""Error of a marker's place by constant curvature, over the robot's length."""
_OFF_RAD = math.radians(15.0)
"""Standard deviation of the direction into which a motor moves the markers: on the twins of the
shipped robots it is up to 20 deg off, as tendons bend the segments that they pass."""
_MOST_OFF_RAD = math.radians(60.0)
"""Direction beyond which a motor certainly moves something else."""
_LEAST_SHARE = 0.35
"""Share of its expected motion that a motor must make; slack of 1.2 mm takes up to 0.4 of it."""
_PRICE = 6.0
"""Minus twice the log odds of each reversed motor, of an exchange, and of a turned camera; and of
the description, where something else is likelier."""
_UNEXPLAINED_SHARE = 0.5
"""Distance of the tip from the model along the path over the robot's length: twice what loads and
friction make in open loop."""
_FOR_US = 3_000_000
_ALONG_PATH = (
    f"for {_FOR_US // 1_000_000} s its tip was half its length or more from the model",
    "check that nothing holds it, and [[robot.segments]] with its tendons; a controller that winds "
    "tendons against each other leads there, too",
)


class ResponseLaw(Law):
    """One small move of each motor."""

    name = "checking that the motors move the robot as described"
    feedback_s = 0.0

    def __init__(self, description: Description) -> None:
        self._limits = MotorLimits.of(description.servo)

    def start(self, path: PathView, history: SetpointHistory) -> None:
        super().start(path, history)
        self.survey = RestSurvey(np.zeros_like(self._limits.lower_rad))

    def stages(self) -> Iterator[Stage]:
        """Each motor pulls, or goes where there is room, and back with the next one's move."""
        here_rad = self.survey.start_rad = self.history.at(math.inf)
        up_rad, down_rad = self._limits.upper_rad - here_rad, here_rad - self._limits.lower_rad
        side = np.where((up_rad >= _REACH_RAD) | (up_rad >= down_rad), 1.0, -1.0)
        moved_rad = here_rad + _REACH_RAD * np.diag(side)
        stops_rad = self._limits.clip(np.vstack([here_rad, moved_rad]))
        yield Stage(self.name, smooth_moves(here_rad, stops_rad, _REST_S))

    def observe(self, measurement: Measurement) -> None:
        self.survey.add(self.history, measurement)


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

    motors: IntArray
    """(m,): the motors that were moved, numbers from 0."""
    acting: IntArray
    """(m,): the described motor that each one acts as."""
    signs: Array
    """(m,): 1, or -1 if it turns the other way."""
    is_turned: bool
    """Whether the camera stands otherwise than known."""
    cost: float
    """Minus twice the log likelihood, prices included, up to a constant."""

    def cause_and_cure(self) -> tuple[str, str] | None:
        """The differences from the description in words, None if there are none."""
        causes, cures = [], []
        exchanged = self.motors[self.motors != self.acting]
        reversed_ = self.motors[self.signs < 0.0]
        if len(exchanged):
            causes.append(f"motors {_numbers(exchanged)} are exchanged")
            cures.append("exchange the leads of the servos, or the tendons between the pulleys")
        if len(reversed_):
            causes.append(f"motor {_numbers(reversed_)} reversed")
            cures.append("negate its servo.pulse_per_90_deg_us, or the winding of its tendons")
        if self.is_turned:
            causes.append("the camera stands otherwise than registered, or was never registered")
            cures.append("set [registration]")
        return (", ".join(causes), "; ".join(cures)) if causes else None


def _numbers(motors: IntArray) -> str:
    return " and ".join(str(motor + 1) for motor in motors)


class MotorResponses:
    """Compares what motors did with what the description says.

    Args:
        description: of the robot.
        rests: the first is where the robot was; in each other one, one motor is elsewhere.
    """

    def __init__(self, description: Description, rests: Rests) -> None:
        robot = description.robot
        self._model = ConstantCurvature(robot)
        self._length_mm = sum(self._model.lengths_mm)
        self._noise_mm = description.tracker.noise_mm
        self._rests = rests
        led_rad = rests.q_rad - rests.q_rad[0]
        self.motors = np.abs(led_rad[1:]).argmax(axis=1)
        """The motors that were seen to be moved, by their numbers from 0."""
        self._led_rad = led_rad[1:]
        self.responses, self._bending_rad, self._pose_cost = self._responses(rests)

    def as_described(self) -> Explanation:
        """The description itself."""
        count = len(self.motors)
        off_rad = np.arccos(np.diag(self.responses.cosines()))
        cost = float(((off_rad / _OFF_RAD) ** 2).sum()) + self._pose_cost
        return Explanation(self.motors, self.motors, np.ones(count), False, cost)

    def likeliest(self) -> Explanation:
        """What explains the responses best."""
        turned, _, pose_cost = self._responses(self._rests.turned(self._turn()))
        found = [
            self._explained(self.responses, is_turned=False, cost=self._pose_cost),
            self._explained(turned, is_turned=True, cost=pose_cost + _PRICE),
        ]
        return min(found, key=lambda one: one.cost)

    def expected_mm(self, q_rad: Array) -> Array:
        """Where the tip is at other motor angles, (n,) -> (3,), from the pose of the first rest."""
        led_rad = self._model.bending_rad(q_rad - self._rests.q_rad[0])
        expected: Array = self._ends_mm((self._bending_rad + led_rad)[None])[0, 1]
        return expected

    def is_odd(self) -> bool:
        """Whether the description does not explain the responses."""
        gain = self.as_described().cost - self.likeliest().cost
        return gain > _PRICE or self.worst_off_rad() > _MOST_OFF_RAD or len(self.idle()) > 0

    def worst_off_rad(self) -> float:
        """The largest angle between seen and expected motion of a motor."""
        return float(np.arccos(np.diag(self.responses.cosines()).min()))

    def idle(self) -> IntArray:
        """Motors, from 0, that hardly move the robot."""
        moved_mm = np.linalg.norm(self.responses.seen_mm, axis=1)
        is_idle = (self.responses.shares() < _LEAST_SHARE) | (moved_mm < self._noise_mm)
        idle: IntArray = self.motors[is_idle]
        return idle

    def _explained(self, responses: Responses, *, is_turned: bool, cost: float) -> Explanation:
        cosines = responses.cosines()
        forward = (np.arccos(cosines) / _OFF_RAD) ** 2
        backward = (np.arccos(-cosines) / _OFF_RAD) ** 2 + _PRICE
        costs = np.minimum(forward, backward) + 0.5 * _PRICE * (1.0 - np.eye(len(cosines)))
        motors, acting = linear_sum_assignment(costs)
        signs = np.where(forward[motors, acting] <= backward[motors, acting], 1.0, -1.0)
        total = cost + float(costs[motors, acting].sum())
        return Explanation(self.motors[motors], self.motors[acting], signs, is_turned, total)

    def _responses(self, rests: Rests) -> tuple[Responses, Array, float]:
        """Responses, the robot's pose at the first rest, (D,), and how unlikely it is."""
        seen_mm = rests.vectors_mm[:, [0, -1]]
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
        return responses, y, 2.0 * float(fit.cost)

    def _ends_mm(self, bending_rad: Array) -> Array:
        """M2 and the tip, (N, 2, 3)."""
        ends: Array = self._model.markers_mm(bending_rad)[0][:, [0, -1]]
        return ends

    def _turn(self) -> Array:
        """The turn, (3, 3), after which the markers are where the description has them."""
        expected = self._ends_mm(self._model.bending_rad(self._rests.q_rad))
        seen = self._rests.vectors_mm[:, [0, -1]]
        both = np.isfinite(seen).all(axis=2)
        turn, _ = Rotation.align_vectors(expected[both], seen[both])
        matrix: Array = turn.as_matrix()
        return matrix


class ResponseCheck:
    """Judges the motors' responses before the path, and the robot's motion along it.

    Args:
        description: of the robot.
        reference: the path.
    """

    def __init__(self, description: Description, reference: Reference) -> None:
        self._description = description
        self._law = ResponseLaw(description)
        self.probe = Shell(description, self._law)
        """Makes the moves in its approach."""
        self.probe.start(reference)
        self._found: MotorResponses | None = None
        self._length_mm = sum(segment.length_mm for segment in description.robot.chain)
        self._odd_since_us: int | None = None
        self.told = "the markers were seen at too few rests: the robot's motion is not checked"
        """The result of the moves before the path, for the log."""

    def judge_probe(self) -> Rests | None:
        """The rests of the probe if the description does not explain them, else None."""
        rests = self._law.survey.rests()
        was_seen = len(rests.q_rad) > 1 and np.array_equal(rests.q_rad[0], rests.start_rad)
        if not was_seen:
            return None
        self._found = found = MotorResponses(self._description, rests)
        worst_deg = math.degrees(found.worst_off_rad())
        self.told = (
            f"{len(found.motors)} motors moved the markers, at most {worst_deg:.0f} deg off the "
            "described direction"
        )
        return rests if found.is_odd() else None

    def judge_approach(self) -> Rests | None:
        """None: approaches of these controllers tell no more."""
        return None

    def judge_step(
        self, time_us: int, q_rad: Array, middle_mm: Array, seen_mm: Array
    ) -> Rests | None:
        """The pose along the path, once it has been unexplained for some seconds, else None."""
        if self._found is None:
            return None
        off_mm = np.linalg.norm(seen_mm - self._found.expected_mm(q_rad))
        if off_mm < _UNEXPLAINED_SHARE * self._length_mm:
            self._odd_since_us = None
            return None
        if self._odd_since_us is None:
            self._odd_since_us = time_us
        if time_us - self._odd_since_us < _FOR_US:
            return None
        markers = np.stack([middle_mm, seen_mm])[None]
        return Rests.of_vectors(q_rad, q_rad[None], markers, np.ones(1))

    def cause_of(self, odd: Rests) -> MisfitError:
        """What is most likely wrong."""
        was_on_path = len(odd.q_rad) == 1
        cause, cure = _ALONG_PATH if was_on_path else self._cause_and_cure()
        return MisfitError(
            f"the robot does not move as described; {cause}",
            f"{cure}; --unchecked goes on all the same",
        )

    def _cause_and_cure(self) -> tuple[str, str]:
        if self._found is not None:
            if len(idle := self._found.idle()):
                return (
                    f"motor {_numbers(idle)} hardly moves it",
                    "check the servo's supply and the tendons: loose, off the pulley, or wound the "
                    "other way",
                )
            if found := self._found.likeliest().cause_and_cure():
                return f"most likely {found[0]}", found[1]
        return (
            "no usual cause explains it",
            "check that nothing holds it, [[robot.segments]] with its tendons, and which marker is "
            "which with ccr-host monitor",
        )
