"""The MPC of robots with any segments and any number of motors."""

from __future__ import annotations

import numpy as np
import pytest

from bench.any_robot import random_robot
from ccr_host.control.base import Observation, Outcome
from ccr_host.control.mpc import sqp
from ccr_host.control.mpc.controller import ModelPredictive
from ccr_host.control.mpc.problem import Constants, Tracking, Weights, expand, roll_out
from ccr_host.control.mpc.qp import condensed, minimise_freely
from ccr_host.control.mpc.sqp import Bounds, feasible, solve
from ccr_host.description import schema
from ccr_host.robot.kinematics import ConstantCurvature
from ccr_host.robot.paths import load_path
from ccr_host.robot.workspace import MotorLimits, Workspace

SHIPPED = {
    "single": "swing",
    "default": "8shape",
    "two-spatial": "helix",
    "three-spatial": "circle",
}
"""Robots of 1, 2, 4 and 9 motors, with a path of each."""


def random_problem(rng, segments, steps, by_model, free=0.0):
    """A problem near the straight pose, and the model; motors bend by about a radian each."""
    robot = random_robot(rng, segments)
    model = ConstantCurvature(robot)
    scale = 1.0 / np.abs(model.bending_rad(np.eye(model.motors))).max()
    start_rad = 0.3 * scale * rng.normal(size=model.motors)
    offsets_mm = rng.normal(size=(steps, 3)) * rng.choice([0.1, 5.0])
    if by_model:
        offsets_mm = offsets_mm - model.tip_mm(start_rad)
    weights = Weights(1.0, float(rng.choice([0.1, 10.0])))
    constants = Constants.of(robot, weights, by_model=by_model)
    free_rad = free * scale * np.sin(np.arange(steps * model.motors)).reshape(steps, -1)
    extra_rad = 0.2 * scale * rng.normal(size=model.motors)
    return Tracking(constants, start_rad, offsets_mm, free_rad, extra_rad), model, scale


@pytest.mark.parametrize("by_model", [False, True])
@pytest.mark.parametrize("segments", [1, 2, 3, 4])
def test_cost_is_that_of_the_kinematics_and_the_expansion_that_of_the_cost(segments, by_model):
    rng = np.random.default_rng(segments)
    for _ in range(10):
        problem, model, scale = random_problem(rng, segments, 3, by_model, 0.1)
        weights = problem.constants.weights
        angles = problem.start_rad + 0.2 * scale * rng.normal(size=(3, model.motors))
        moves = np.diff(angles, axis=0, prepend=problem.start_rad[None])
        if by_model:
            errors = problem.offsets_mm + model.tip_mm(angles + problem.extra_rad)
        else:
            jacobians = model.jacobian_mm_rad(angles - moves + problem.extra_rad)
            errors = problem.offsets_mm + np.cumsum(np.einsum("kij,kj->ki", jacobians, moves), 0)
        efforts = moves - problem.free_rad
        expected = weights.position * np.sum(errors**2) + weights.effort * np.sum(efforts**2)
        assert roll_out(problem, angles).cost == pytest.approx(expected, rel=1e-11)

        hessian, gradient = condensed(expand(problem, roll_out(problem, angles)), 1.0, 0.0)
        aside, small = scale * rng.normal(size=angles.shape), 1e-4
        flat = aside.ravel()
        slopes = []
        for sign in (1.0, -1.0):
            rollout = roll_out(problem, angles + sign * small * aside)
            slopes.append(condensed(expand(problem, rollout), 1.0, 0.0)[1])
            costs = [roll_out(problem, angles + s * small * aside).cost for s in (1.0, -1.0)]
        size = np.abs(hessian @ flat).max() + np.abs(gradient).max()
        assert gradient @ flat == pytest.approx(
            (costs[0] - costs[1]) / (2 * small), abs=1e-5 * size * np.abs(flat).sum()
        )
        bend = (slopes[0] - slopes[1]) / (2 * small)
        assert hessian @ flat == pytest.approx(bend, abs=1e-5 * size)


@pytest.mark.parametrize("by_model", [False, True])
@pytest.mark.parametrize("segments", [1, 2, 3, 4])
def test_solution_is_feasible_stationary_and_no_worse_than_the_guess(segments, by_model):
    rng = np.random.default_rng(10 + segments)
    for _ in range(8):
        problem, _, scale = random_problem(rng, segments, 5, by_model)
        start = problem.start_rad
        reach = scale * rng.choice([0.05, 10.0])
        bounds = Bounds(start - 2.0 * scale, start + 2.0 * scale, reach)
        guess = np.tile(start, (5, 1))
        solution = solve(problem, bounds, guess)
        assert solution.status in (sqp.CONVERGED, sqp.STOPPED)
        assert solution.rollout.cost <= roll_out(problem, guess).cost
        angles = feasible(bounds, start, solution.rollout.angles)
        assert angles == pytest.approx(solution.rollout.angles, abs=3e-6)
        moves = np.diff(angles, axis=0, prepend=start[None])
        assert np.all(np.abs(angles - start) <= 2.0 * scale * (1 + 1e-12))
        assert np.abs(moves).max() <= reach * (1 + 1e-12)
        is_inside = np.abs(moves).max() < 0.9 * reach and np.abs(angles - start).max() < 1.9 * scale
        if solution.status == sqp.CONVERGED and is_inside:
            further = minimise_freely(expand(problem, solution.rollout), 1.0, 0.0)
            assert further[2] >= -1e-5 * solution.rollout.cost


def controller(robot, *overrides):
    description = schema.load(robot, overrides)
    model = ConstantCurvature(description.robot)
    path = load_path(SHIPPED[robot], 1.0, Workspace(model, MotorLimits.of(description.servo)))
    return ModelPredictive(description), model, path


@pytest.mark.parametrize("robot", SHIPPED)
def test_on_a_plant_that_is_the_model_and_a_constant_error_the_tip_follows(robot):
    mpc, model, path = controller(robot)
    offset_mm = np.array([2.0, -3.0, 4.0])
    q_rad = mpc.start(path).q_rad
    avoidable_mm, unavoidable_mm = [], []
    for step in range(1, 40):
        seen = Observation(step, step * 1_000_000, model.tip_mm(q_rad) + offset_mm, 0, q_rad)
        command = mpc.step(seen)
        assert command.outcome is Outcome.SOLVED
        assert not command.detail
        q_rad = command.q_rad
        avoidable_mm.append(np.linalg.norm(model.tip_mm(q_rad) + offset_mm - path.target_mm[step]))
        unavoidable_mm.append(np.linalg.norm(offset_mm))
    # What 1 or 2 motors cannot reach stays; with more, all of it goes but for the effort's share.
    assert np.mean(avoidable_mm[-20:]) < (1.0 if model.motors > 2 else np.mean(unavoidable_mm))


@pytest.mark.parametrize("robot", ["two-spatial", "three-spatial"])
def test_motors_return_to_the_paths_configuration_where_the_tip_does_not_need_them(robot):
    mpc, model, path = controller(robot)
    q_rad = mpc.start(path).q_rad
    aside = np.linalg.svd(model.jacobian_mm_rad(q_rad))[2][-1]
    q_rad = q_rad + 0.2 * aside
    first = np.abs(model.bending_rad(q_rad - path.q_rad[0])).max()
    for step in range(1, 16):
        seen = Observation(step, step * 1_000_000, model.tip_mm(q_rad), 0, q_rad)
        q_rad = mpc.step(seen).q_rad
    last = np.abs(model.bending_rad(q_rad - path.q_rad[15])).max()
    assert last < 0.1 * first
    assert model.tip_mm(q_rad) == pytest.approx(path.target_mm[15], abs=1.0)


@pytest.mark.long
@pytest.mark.parametrize("robot", SHIPPED)
@pytest.mark.parametrize("more", [[], ["control.step_bound_rad=0.02"], ["control.horizon=12"]])
def test_plans_of_machine_code_are_those_of_python(robot, more):
    plain, model, path = controller(robot, *more)
    fast, _, _ = controller(robot, "control.solver=compiled", *more)
    rng = np.random.default_rng(1)
    q_rad = plain.start(path).q_rad
    assert np.array_equal(fast.start(path).q_rad, q_rad)
    for step in range(1, 30):
        tip_mm = model.tip_mm(q_rad) + rng.normal(scale=2.0, size=3)
        seen = Observation(step, step * 1_000_000, tip_mm, 0, q_rad)
        command = plain.step(seen)
        assert fast.step(seen).q_rad == pytest.approx(command.q_rad, abs=1e-6)
        assert fast.plan_rad == pytest.approx(plain.plan_rad, abs=1e-5)
        q_rad = command.q_rad
