"""The paper's problem in a form for any solver, and the steps at which to solve it."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from ccr_host.control.base import Observation
from ccr_host.control.mpc.controller import ModelPredictive, Pose, pose_estimate
from ccr_host.control.mpc.problem import Weights, free_moves_rad
from ccr_host.description.schema import Description
from ccr_host.robot.kinematics import ConstantCurvature
from ccr_host.robot.reference import Reference
from ccr_host.robot.workspace import MotorLimits
from ccr_host.sim.robot.robot import TwinRobot

Array = NDArray[np.float64]

PERIOD_US = 1_000_000
SETTLE_US = 2_000_000


class Way(Protocol):
    """A solver of MPC steps."""

    def step(self, observation: Observation) -> object:
        """All computations that a control period must wait for."""
        ...

    def plan(self) -> Array:
        """All angles planned by the last step, (M, n), rad."""
        ...


@dataclass(frozen=True)
class Recorded(Observation):
    """An observation, and the pose from which the controller plans then."""

    pose: Pose = field(kw_only=True)


@dataclass(frozen=True)
class Problem:
    """(15) for one observation, over the live increments."""

    q_rad: Array
    pose: Pose
    targets_mm: Array
    free_rad: Array

    def numbers(self) -> Array:
        """Everything, flat."""
        targets_mm, free_rad = self.targets_mm.ravel(), self.free_rad.ravel()
        return np.concatenate([self.q_rad, *self.pose, targets_mm, free_rad])


class Formulation:
    """Cost (15) in plain NumPy; ``limits`` are those of the motors."""

    def __init__(self, description: Description, reference: Reference) -> None:
        self.robot, self.control = description.robot, description.control
        self.weights = Weights.of(description)
        self.limits = MotorLimits.of(description.servo)
        self.reference = reference
        self.model = ConstantCurvature(description.robot)
        self.motors = self.model.motors
        self.live_steps = self.control.horizon - 1

    def problem(self, observation: Observation) -> Problem:
        assert isinstance(observation, Recorded)
        i, pose = observation.step, observation.pose
        targets = self.reference.target_mm[i : i + self.live_steps]
        path_rad = self.reference.q_rad[i - 1 : i + self.live_steps] - pose.extra_rad
        free_rad = free_moves_rad(self.weights, path_rad, observation.q_rad)
        return Problem(observation.q_rad, pose, targets, free_rad)

    def cost(self, flat: Array, problem: Problem) -> float:
        """Cost of increments, (M n,)."""
        moves = flat.reshape(-1, self.motors)
        start_rad = problem.q_rad + problem.pose.extra_rad
        poses = start_rad + np.cumsum(moves, axis=0) - moves
        steps = np.einsum("kij,kj->ki", self.model.jacobian_mm_rad(poses), moves)
        errors = problem.pose.tip_mm - problem.targets_mm + np.cumsum(steps, axis=0)
        efforts = moves - problem.free_rad
        squares = self.weights.position * np.sum(errors * errors)
        return float(squares + self.weights.effort * np.sum(efforts * efforts))

    def cost_of_plan(self, observation: Observation, plan_rad: Array) -> float:
        problem = self.problem(observation)
        moves = np.diff(np.vstack([problem.q_rad, plan_rad]), axis=0)
        return self.cost(moves.ravel(), problem)

    def violation_rad(self, observation: Observation, plan_rad: Array) -> float:
        """Largest violation of the bounds on angles and increments by a plan, rad."""
        moves = np.diff(np.vstack([observation.q_rad, plan_rad]), axis=0)
        beyond = (
            np.abs(moves) - self.control.step_bound_rad,
            plan_rad - self.limits.upper_rad,
            self.limits.lower_rad - plan_rad,
        )
        return max(0.0, float(np.max(beyond)))


class ShiftedStart:
    """Warm start of the peers: the last increments, shifted by one step."""

    def __init__(self, formulation: Formulation) -> None:
        self.formulation = formulation
        self.moves: Array = np.zeros((0, formulation.motors))

    def guess(self) -> Array:
        live = self.formulation.live_steps
        kept = self.moves[1 : 1 + live]
        return np.concatenate([kept, np.zeros((live - len(kept), self.formulation.motors))]).ravel()

    def plan(self) -> Array:
        return self.q_rad + np.cumsum(self.moves, axis=0)

    def keep(self, problem: Problem, flat: Array) -> None:
        self.q_rad = problem.q_rad
        self.moves = flat.reshape(-1, self.formulation.motors)

    def forget_nonsense(self) -> None:
        """Start the next step from rest if this one was not solved; call it outside the timing."""
        bound = self.formulation.control.step_bound_rad
        if not np.all(np.abs(self.moves) <= bound + 1e-6):
            self.moves = np.zeros((0, self.formulation.motors))


def record(description: Description, reference: Reference, seed: int) -> list[Recorded]:
    """One lap of the controller ``mpc`` at one step per second, on the twin of the paper's robot.

    Other robots are the model, each motor turning 0.9 of its command, 5 mm lower. Only steps with a
    complete horizon, so that a peer needs only one solver.
    """
    rng = np.random.default_rng(seed)
    controller = ModelPredictive(description)
    q_rad = controller.start(reference).q_rad
    model = ConstantCurvature(description.robot)
    estimate = pose_estimate(description)
    twin = None if description.robot.segments else TwinRobot(description.twin)
    time_us = SETTLE_US
    observations = []
    for step in range(1, len(reference) - description.control.horizon + 2):
        if twin is None:
            tip_mm = model.tip_mm(0.9 * q_rad) - (0.0, 0.0, 5.0)
        else:
            _pulse(twin, description, q_rad)
            twin.advance_to(time_us)
        time_us += PERIOD_US
        if twin is not None:
            twin.advance_to(time_us)
            tip_mm = twin.tip_mm()
        noise_mm = rng.normal(scale=description.tracker.noise_mm / math.sqrt(3.0), size=3)
        observation = Observation(step, time_us, tip_mm + noise_mm, 0, q_rad)
        pose = estimate.pose(observation, q_rad)
        observations.append(Recorded(**vars(observation), pose=pose))
        q_rad = controller.step(observation).q_rad
    return observations


def _pulse(twin: TwinRobot, description: Description, q_rad: Array) -> None:
    servo = description.servo
    per_rad = np.array(servo.pulse_per_90_deg_us) / (math.pi / 2.0)
    half_us = np.rint(2.0 * (np.array(servo.neutral_pulse_us) + per_rad * q_rad)).astype(int)
    twin.set_pulses_half_us(tuple(half_us.tolist()))
