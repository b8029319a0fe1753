"""An independent statement of the paper's problem, and random steps to solve."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import casadi
import numpy as np
import pytest

from ccr_host.control.mpc.plan import Planner, Settings
from ccr_host.control.mpc.problem import Constants, Tracking, Weights
from ccr_host.control.mpc.sqp import Bounds
from ccr_host.description.schema import Description
from ccr_host.robot.kinematics import ConstantCurvature
from ccr_host.robot.paths import load_path
from ccr_host.robot.workspace import MotorLimits, Workspace

DESCRIPTION = Description()
MODEL = ConstantCurvature(DESCRIPTION.robot)
LIMITS = MotorLimits.of(DESCRIPTION.servo)


def constants(position_weight=1.0, effort_weight=0.5) -> Constants:
    """The constants of the paper's robot with some weights."""
    return Constants.of(DESCRIPTION.robot, Weights(position_weight, effort_weight))


@dataclass(frozen=True)
class Step:
    """One measurement along a path."""

    q_rad: np.ndarray
    measured_mm: np.ndarray
    targets_mm: np.ndarray

    def tracking(self, position_weight=1.0, effort_weight=0.5) -> Tracking:
        offsets_mm = self.measured_mm - self.targets_mm
        weighted = constants(position_weight, effort_weight)
        return Tracking(
            weighted, self.q_rad, offsets_mm, np.zeros((len(offsets_mm), 2)), np.zeros(2)
        )

    def planned(self, planner: Planner):
        """Status, iterations and angles (M, 2), from standing still."""
        live = len(self.targets_mm)
        standing = np.tile(self.q_rad, (live + 1, 1))
        planner.begin(np.hstack([np.vstack([self.measured_mm, self.targets_mm]), standing]))
        planner.interrupt(self.q_rad)
        status, iterations, plan = planner.plan(1, live, self.q_rad, self.measured_mm, np.zeros(2))
        return status, iterations, plan[:, :2]

    def moves(self, angles) -> np.ndarray:
        """Flat increments that lead from here along the angles."""
        return np.diff(np.vstack([self.q_rad, angles]), axis=0).ravel()

    def standing_still(self) -> np.ndarray:
        return np.tile(self.q_rad, (len(self.targets_mm), 1))


class Witness:
    """(15) over u_1..u_M from (10) by automatic differentiation; nothing of ours in it."""

    def __init__(self, live: int, position_weight=1.0, effort_weight=0.5) -> None:
        self.live = live
        length_1, length_2, offset, gain = 58.5, 43.5, 15.0, 12.5 / 4.5
        q = casadi.SX.sym("q", 2)
        theta_1, theta_2 = gain * q[0], gain * q[1]
        tip = casadi.vertcat(
            length_2 * theta_2 / 2 * _sinc(theta_2 / 2) ** 2,
            -(length_1 * _sinc(theta_1) - offset * casadi.sin(theta_1))
            - length_2 * _sinc(theta_2) * casadi.cos(theta_1),
            length_1 * theta_1 / 2 * _sinc(theta_1 / 2) ** 2
            - offset * (1 - casadi.cos(theta_1))
            + length_2 * _sinc(theta_2) * casadi.sin(theta_1),
        )
        jacobian = casadi.Function("J", [q], [casadi.jacobian(tip, q)])
        moves = casadi.SX.sym("u", 2, live)
        given = casadi.SX.sym("p", 5 + 3 * live)
        pose, position, cost, poses = given[:2], given[2:5], 0, []
        for k in range(live):
            position = position + jacobian(pose) @ moves[:, k]
            pose = pose + moves[:, k]
            poses.append(pose)
            error = position - given[5 + 3 * k : 8 + 3 * k]
            cost += position_weight * casadi.sumsqr(error)
            cost += effort_weight * casadi.sumsqr(moves[:, k])
        flat = casadi.vec(moves)
        self._cost = casadi.Function("C", [flat, given], [cost])
        self._gradient = casadi.Function("g", [flat, given], [casadi.gradient(cost, flat)])
        self._hessian = casadi.Function("H", [flat, given], [casadi.hessian(cost, flat)[0]])
        self._ipopt = casadi.nlpsol(
            "witness",
            "ipopt",
            {"x": flat, "p": given, "f": cost, "g": casadi.vertcat(*poses)},
            {"ipopt": {"print_level": 0, "sb": "yes", "tol": 1e-10}, "print_time": False},
        )

    def cost(self, moves: np.ndarray, step: Step) -> float:
        return float(self._cost(moves, _given(step)))

    def gradient(self, moves: np.ndarray, step: Step) -> np.ndarray:
        return np.array(self._gradient(moves, _given(step))).ravel()

    def hessian(self, moves: np.ndarray, step: Step) -> np.ndarray:
        return np.array(self._hessian(moves, _given(step)))

    def minimum_by_ipopt(self, moves: np.ndarray, step: Step) -> float:
        bound = DESCRIPTION.control.step_bound_rad
        result = self._ipopt(
            x0=moves,
            p=_given(step),
            lbx=-bound,
            ubx=bound,
            lbg=np.tile(LIMITS.lower_rad, self.live),
            ubg=np.tile(LIMITS.upper_rad, self.live),
        )
        return float(result["f"])


def _given(step: Step) -> np.ndarray:
    return np.concatenate([step.q_rad, step.measured_mm, step.targets_mm.ravel()])


def _sinc(x):
    series = 1 - x**2 / 6 + x**4 / 120 - x**6 / 5040 + x**8 / 362880
    small = casadi.fabs(x) < 0.05
    return casadi.if_else(small, series, casadi.sin(x) / casadi.if_else(small, 1, x))


@pytest.fixture(scope="session")
def witness():
    return lru_cache(Witness)


@pytest.fixture(scope="session")
def bounds():
    return Bounds.of(LIMITS, DESCRIPTION.control.step_bound_rad)


@pytest.fixture(scope="session", params=["daqp", "compiled"])
def solver(request):
    """What ``control.solver`` may be: the same text plain and compiled."""
    return request.param


@pytest.fixture(scope="session")
def planner_within(solver):
    """Planners of the paper's robot between bounds."""
    return lambda bounds: Planner(Settings(constants(), bounds), solver)


@pytest.fixture(scope="session")
def random_steps():
    """Steps along all three paths: the robot is off its reference, the measurement off both."""
    references = [
        load_path(name, 1.0, Workspace(MODEL, LIMITS)) for name in ("ellipse", "8shape", "star")
    ]

    def draw(live: int, count: int, seed: int) -> list[Step]:
        rng = np.random.default_rng(seed)
        steps = []
        for _ in range(count):
            reference = references[rng.integers(3)]
            first = int(rng.integers(1, len(reference) - live))
            q_rad = LIMITS.clip(reference.q_rad[first - 1] + rng.normal(scale=0.1, size=2))
            offset_mm = rng.normal(scale=8.0, size=3)
            targets = reference.target_mm[first : first + live]
            steps.append(Step(q_rad, MODEL.tip_mm(q_rad) + offset_mm, targets))
        return steps

    return draw
