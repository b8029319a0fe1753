"""The MPC as a controller: alignment, limits, horizon, lost and wild measurements."""

from __future__ import annotations

import math
import sys

import numpy as np
import pytest

from ccr_host.control.base import Observation, Outcome
from ccr_host.control.mpc import sqp
from ccr_host.control.mpc.controller import ModelPredictive
from ccr_host.control.mpc.qp import FAILED
from ccr_host.control.open_loop import OpenLoop
from ccr_host.control.registry import controller_names, make_controller
from ccr_host.core.errors import ConfigError
from ccr_host.description import schema
from ccr_host.robot.kinematics import ConstantCurvature
from ccr_host.robot.paths import load_path
from ccr_host.robot.workspace import MotorLimits, Workspace

DEFAULT = schema.load()
PRINTED = schema.load(overrides=["control.bending=commanded"])
MODEL = ConstantCurvature(DEFAULT.robot)
LIMITS = MotorLimits.of(DEFAULT.servo)


def reference(name="8shape", rate_hz=1.0, description=DEFAULT):
    limits = MotorLimits.of(description.servo)
    return load_path(name, rate_hz, Workspace(ConstantCurvature(description.robot), limits))


@pytest.fixture
def mpc(solver):
    """Controllers for a description, by either solver."""

    def make(description=DEFAULT):
        control = description.control.model_copy(update={"solver": solver})
        return ModelPredictive(description.model_copy(update={"control": control}))

    return make


def observation(step, tip_mm, q_rad):
    tip = None if tip_mm is None else np.asarray(tip_mm, dtype=float)
    return Observation(step, step * 1_000_000, tip, 40_000, np.asarray(q_rad, dtype=float))


def follow(controller, path, plant):
    """Commands and true positions; the plant answers at once."""
    commands = [controller.start(path)]
    tips = [plant(commands[0].q_rad)]
    for step in range(1, len(path)):
        commands.append(controller.step(observation(step, tips[-1], commands[-1].q_rad)))
        tips.append(plant(commands[-1].q_rad))
    return commands, np.array(tips)


def sagging(q_rad):
    """A plant of slightly other lengths that hangs 8 mm low."""
    other = DEFAULT.robot.model_copy(update={"segment_lengths_mm": (57.0, 45.0)})
    return ConstantCurvature(other).tip_mm(q_rad) + np.array([1.0, 2.0, -8.0])


@pytest.mark.parametrize("name", ["ellipse", "8shape", "star"])
def test_feedback_halves_the_error_of_the_open_loop_on_a_plant_unlike_the_model(name, mpc):
    path = reference(name)
    mean_mm = {}
    for controller in (OpenLoop(DEFAULT), mpc()):
        _, tips = follow(controller, path, sagging)
        mean_mm[controller.name] = np.linalg.norm(tips - path.target_mm, axis=1)[1:].mean()
    assert mean_mm["mpc"] < 0.5 * mean_mm["open-loop"]


def test_on_a_perfect_plant_each_command_reaches_the_target_of_its_own_step(mpc):
    """Running one sample ahead or behind would cost 3.6 mm."""
    path = reference("8shape")
    _, tips = follow(mpc(), path, MODEL.tip_mm)
    assert np.linalg.norm(tips - path.target_mm, axis=1).mean() < 1.2


def test_first_command_is_the_nearest_configuration_of_the_first_sample(mpc):
    path = reference("ellipse")
    command = mpc().start(path)
    assert command.q_rad == pytest.approx(path.q_rad[0])
    assert command.outcome is Outcome.SOLVED


def test_horizon_shrinks_at_the_end_of_the_path(mpc):
    path = reference("8shape")
    commands, _ = follow(mpc(), path, sagging)
    live = DEFAULT.control.horizon - 1
    assert [len(c.predicted_mm) for c in commands[1:]] == [
        min(live, len(path) - step) for step in range(1, len(path))
    ]


def test_prediction_starts_with_the_end_of_the_commanded_period(mpc):
    path = reference("8shape")
    controller = mpc(PRINTED)
    start = controller.start(path).q_rad
    tip = MODEL.tip_mm(start) + np.array([0.0, 0.0, -3.0])
    command = controller.step(observation(1, tip, start))
    linear = tip + MODEL.jacobian_mm_rad(start) @ (command.q_rad - start)
    assert command.predicted_mm[0] == pytest.approx(linear, abs=1e-6)


@pytest.mark.long
@pytest.mark.parametrize("limit_deg", [3.0, 10.0, 40.0])
def test_commands_stay_within_motor_limits_that_the_path_exceeds(limit_deg, mpc):
    tight = schema.load(
        overrides=[f"servo.angle_min_deg={-limit_deg}", f"servo.angle_max_deg={limit_deg}"]
    )
    largest_deg = 0.0
    for name in ("ellipse", "8shape", "star"):
        path = reference(name, description=tight)
        commands, _ = follow(mpc(tight), path, sagging)
        assert {c.outcome for c in commands} == {Outcome.SOLVED}
        angles_deg = np.degrees([c.q_rad for c in commands])
        largest_deg = max(largest_deg, np.abs(angles_deg).max())
    assert limit_deg - 0.1 < largest_deg <= limit_deg + 1e-12


def test_increments_stay_within_the_step_bound(mpc):
    slow = schema.load(overrides=["control.step_bound_rad=0.05"])
    commands, _ = follow(mpc(slow), reference("star"), sagging)
    steps = np.abs(np.diff([c.q_rad for c in commands], axis=0))
    assert steps.max() <= 0.05 + 1e-12
    assert steps.max() >= 0.05 - 1e-5


@pytest.mark.long
@pytest.mark.parametrize("rate_hz", [5.0, 20.0])
@pytest.mark.parametrize("horizon", [2, 10])
def test_other_rates_and_horizons_follow_too(rate_hz, horizon, mpc):
    other = schema.load(overrides=[f"control.horizon={horizon}"])
    path = reference("star", rate_hz)

    def low(q_rad):
        return MODEL.tip_mm(q_rad) + np.array([0.0, 0.0, -4.0])

    commands, tips = follow(mpc(other), path, low)
    assert {c.outcome for c in commands} == {Outcome.SOLVED}
    assert np.linalg.norm(tips - path.target_mm, axis=1)[1:].mean() < 2.0


def test_without_measurements_it_coasts_on_the_model_and_the_error_seen_last(mpc):
    path = reference("8shape")
    seeing, blind = mpc(PRINTED), mpc(PRINTED)
    q_rad = seeing.start(path).q_rad
    blind.start(path)
    constant_mm = np.array([0.5, -1.0, -6.0])
    for step in range(1, 30):
        tip = MODEL.tip_mm(q_rad) + constant_mm
        seen = seeing.step(observation(step, tip, q_rad))
        coasted = blind.step(observation(step, tip if step == 1 else None, q_rad))
        assert coasted.q_rad == pytest.approx(seen.q_rad, abs=1e-5)
        assert coasted.outcome is (Outcome.SOLVED if step == 1 else Outcome.COASTED)
        q_rad = seen.q_rad


def test_blind_from_the_start_it_follows_the_model(mpc):
    path = reference("8shape")
    controller = mpc()
    q_rad = controller.start(path).q_rad
    for step in range(1, len(path)):
        q_rad = controller.step(observation(step, None, q_rad)).q_rad
        assert np.linalg.norm(MODEL.tip_mm(q_rad) - path.target_mm[step]) < 4.0


BAD_TIPS = [
    ([math.nan, 0, 0], DEFAULT),
    ([0, math.inf, 0], DEFAULT),
    ([0, math.inf, 0], PRINTED),
    ([1e200, 0, 0], PRINTED),
]


@pytest.mark.parametrize(("tip", "description"), BAD_TIPS)
def test_unusable_measurement_holds_the_last_command_and_recovers(tip, description, mpc):
    path = reference("8shape")
    controller = mpc(description)
    q_rad = controller.start(path).q_rad
    for step in range(1, 20):
        measured = tip if step in (7, 8) else sagging(q_rad)
        command = controller.step(observation(step, measured, q_rad))
        if step in (7, 8):
            assert command.outcome is Outcome.HELD
            assert command.detail
            assert command.q_rad == pytest.approx(q_rad, abs=0)
        else:
            assert command.outcome is Outcome.SOLVED
        q_rad = command.q_rad


@pytest.mark.long
@pytest.mark.parametrize("scale_mm", [1e3, 1e6, 1e12])
def test_wild_but_finite_measurements_never_leave_the_limits(scale_mm, mpc):
    rng = np.random.default_rng(1)
    path = reference("star")
    controller = mpc()
    q_rad = controller.start(path).q_rad
    for step in range(1, len(path)):
        command = controller.step(observation(step, rng.normal(scale=scale_mm, size=3), q_rad))
        q_rad = command.q_rad
        assert np.all((q_rad >= LIMITS.lower_rad) & (q_rad <= LIMITS.upper_rad))


def test_failing_solver_holds_the_last_command(monkeypatch):
    path = reference("8shape")
    controller = ModelPredictive(DEFAULT)
    q_rad = controller.start(path).q_rad
    q_rad = controller.step(observation(1, sagging(q_rad), q_rad)).q_rad

    with monkeypatch.context() as patch:
        patch.setattr(sqp, "minimise", lambda *_: (FAILED, np.zeros((3, 2)), 0.0))
        held = controller.step(observation(2, sagging(q_rad), q_rad))
    assert held.outcome is Outcome.HELD
    assert "QP" in held.detail
    assert held.q_rad == pytest.approx(q_rad, abs=0)
    again = controller.step(observation(3, sagging(q_rad), q_rad))
    assert again.outcome is Outcome.SOLVED


def test_angles_that_are_not_finite_or_beyond_the_limits_are_survived(mpc):
    path = reference("8shape")
    controller = mpc()
    q_rad = controller.start(path).q_rad
    held = controller.step(observation(1, sagging(q_rad), [math.nan, 0.0]))
    assert held.outcome is Outcome.HELD
    assert held.q_rad == pytest.approx(q_rad, abs=0)
    beyond = controller.step(observation(2, sagging(q_rad), [3.0, -3.0]))
    assert np.all(np.abs(beyond.q_rad) <= np.radians(85.0))


def test_step_after_the_end_of_the_path_holds(mpc):
    path = reference("8shape")
    controller = mpc()
    q_rad = controller.start(path).q_rad
    held = controller.step(observation(len(path), sagging(q_rad), q_rad))
    assert held.outcome is Outcome.HELD


def test_across_the_fold_commands_move_without_jumps(mpc):
    """Both sides of the ellipse rest on the fold, where the lateral map is singular."""
    commands, _ = follow(mpc(), reference("ellipse", 10.0), MODEL.tip_mm)
    assert {c.outcome for c in commands} == {Outcome.SOLVED}
    steps = np.abs(np.diff([c.q_rad for c in commands], axis=0))
    assert np.degrees(steps.max()) < 5.0


def test_without_effort_weight_it_still_solves(mpc):
    free = schema.load(overrides=["control.effort_weight=0"])
    path = reference("ellipse")
    commands, tips = follow(mpc(free), path, sagging)
    assert {c.outcome for c in commands} == {Outcome.SOLVED}
    assert np.linalg.norm(tips - path.target_mm, axis=1)[1:].mean() < 8.0


def test_same_run_twice_gives_the_same_commands_to_the_last_bit(mpc):
    path = reference("star")
    first, _ = follow(mpc(), path, sagging)
    second, _ = follow(mpc(), path, sagging)
    assert all(np.array_equal(a.q_rad, b.q_rad) for a, b in zip(first, second, strict=True))


def test_registry_makes_controllers_by_name_and_lists_them():
    assert {"open-loop", "mpc"} <= set(controller_names())
    for name in controller_names():
        assert make_controller(name, DEFAULT).name == name
    with pytest.raises(ConfigError) as caught:
        make_controller("pid", DEFAULT)
    assert "mpc" in caught.value.cure


def test_compiled_solver_without_its_extra_says_how_to_install_it(monkeypatch):
    monkeypatch.setitem(sys.modules, "numba", None)
    with pytest.raises(ConfigError) as caught:
        make_controller("mpc", schema.load(overrides=["control.solver=compiled"]))
    assert "control.solver = compiled" in caught.value.cause
    assert caught.value.cure == 'pip install "ccr-host[fast]"'
