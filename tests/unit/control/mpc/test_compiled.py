"""Machine code against the same text run by Python: same steps in, same plans out."""

from __future__ import annotations

import math
import subprocess
import sys
from itertools import cycle
from pathlib import Path

import numpy as np
import pytest

from ccr_host.control import mpc
from ccr_host.control.base import Observation, Outcome
from ccr_host.control.mpc import compiled, qp, sqp
from ccr_host.control.mpc.controller import ModelPredictive
from ccr_host.control.mpc.plan import tracking
from ccr_host.control.mpc.problem import roll_out
from ccr_host.description import schema
from ccr_host.robot.kinematics import ConstantCurvature
from ccr_host.robot.paths import load_path
from ccr_host.robot.workspace import MotorLimits, Workspace

pytestmark = pytest.mark.long  # Without numba's cache, compiling takes a minute.

SAME_RAD = 1e-6
SAME_COST = 1e-9

PRINTED = ["control.bending=commanded"]
TIGHT_STEPS = ["control.step_bound_rad=0.04"]
TIGHT_LIMITS = ["servo.angle_min_deg=-20", "servo.angle_max_deg=20"]
NO_ROOM = ["servo.angle_min_deg=[-20, -0.5]", "servo.angle_max_deg=[20, 0.5]"]


def both(overrides):
    compiled_too = [*overrides, "control.solver=compiled"]
    return (
        ModelPredictive(schema.load(overrides=overrides)),
        ModelPredictive(schema.load(overrides=compiled_too)),
    )


def path_of(name, overrides=(), rate_hz=1.0):
    description = schema.load(overrides=overrides)
    model = ConstantCurvature(description.robot)
    return load_path(name, rate_hz, Workspace(model, MotorLimits.of(description.servo)))


def observation(step, tip_mm, q_rad):
    return Observation(step, step * 1_000_000, tip_mm, 0, q_rad)


def drifting_plant(seed, lost=0.1):
    """Off the model by a little at each pose and by a lot on the whole; some samples are lost."""
    rng = np.random.default_rng(seed)
    model = ConstantCurvature(schema.load().robot)
    offset_mm = rng.normal(scale=6.0, size=3)

    def tip_mm(q_rad):
        measured = model.tip_mm(q_rad) + offset_mm + rng.normal(scale=1.0, size=3)
        return None if rng.random() < lost else measured

    return tip_mm


class Pricing:
    """Notes what a planner is asked, and prices any plan for it."""

    def __init__(self, planner, monkeypatch):
        self._planner, self._plan = planner, planner.plan
        monkeypatch.setattr(planner, "plan", self._noting)

    def _noting(self, *situation):
        self._situation = situation
        return self._plan(*situation)

    def cost(self, plan_rad):
        problem = tracking(self._planner._settings, self._planner._path, *self._situation)
        return roll_out(problem, np.array(plan_rad)).cost


@pytest.mark.parametrize(
    ("horizon", "more"),
    [
        (2, []),
        (4, []),
        (4, PRINTED),
        (4, ["control.effort_weight=0"]),
        (4, [*PRINTED, "control.effort_weight=0"]),
        (4, TIGHT_STEPS),
        (4, TIGHT_LIMITS),
        (4, NO_ROOM),
        (10, []),
        (10, TIGHT_STEPS + TIGHT_LIMITS),
        (10, PRINTED + TIGHT_STEPS + TIGHT_LIMITS),
        (20, []),
        (40, []),
        (40, PRINTED),
        (40, TIGHT_STEPS),
    ],
)
def test_plans_are_those_of_the_default_solver(horizon, more, monkeypatch):
    overrides = [f"control.horizon={horizon}", *more]
    steps_seen = 0
    for number, name in enumerate(("ellipse", "8shape", "star")):
        plant = drifting_plant(number)
        path = path_of(name, overrides)
        default, fast = both(overrides)
        pricing = Pricing(default._planner, monkeypatch)
        q_rad = default.start(path).q_rad
        assert np.array_equal(fast.start(path).q_rad, q_rad)
        for step in range(1, len(path), 1 if horizon < 20 else horizon // 3):
            seen = observation(step, plant(q_rad), q_rad)
            expected, command = default.step(seen), fast.step(seen)
            assert command.outcome is expected.outcome
            assert command.detail == expected.detail
            assert len(command.predicted_mm) == len(expected.predicted_mm)
            if np.abs(fast.plan_rad - default.plan_rad).max() > SAME_RAD:
                costs = [pricing.cost(c.plan_rad) for c in (fast, default)]
                assert costs[0] == pytest.approx(costs[1], rel=SAME_COST)
            else:
                assert command.predicted_mm == pytest.approx(expected.predicted_mm, abs=1e-3)
            q_rad = expected.q_rad
            # Where the iterations were stopped a last digit would grow from step to step.
            fast._planner._last_plan = np.array(default._planner._last_plan)
            steps_seen += 1
    assert steps_seen >= 20


BAD_TIPS = [[math.nan, 0, 0], [0, math.inf, 0], [1e200, 0, 0], [1e12, -1e12, 1e12]]


@pytest.mark.parametrize("bending", [[], PRINTED])
@pytest.mark.parametrize("tip", BAD_TIPS)
def test_unusable_measurement_is_survived_as_by_the_default(tip, bending):
    path, plant = path_of("8shape"), drifting_plant(5)
    default, fast = both(bending)
    q_rad = default.start(path).q_rad
    fast.start(path)
    for step in range(1, 20):
        measured = np.array(tip) if step in (7, 8) else plant(q_rad)
        seen = observation(step, measured, q_rad)
        expected, command = default.step(seen), fast.step(seen)
        assert command.outcome is expected.outcome
        assert command.detail == expected.detail
        assert command.q_rad == pytest.approx(expected.q_rad, abs=SAME_RAD)
        q_rad = expected.q_rad


def test_random_measurements_never_lead_out_of_the_limits():
    rng = np.random.default_rng(1)
    path = path_of("star")
    _, fast = both([*TIGHT_LIMITS, *TIGHT_STEPS])
    for _ in range(20):
        q_rad = fast.start(path).q_rad
        for step in range(1, len(path)):
            tip_mm = rng.normal(scale=10.0 ** rng.uniform(0, 6), size=3)
            command = fast.step(observation(step, tip_mm, q_rad))
            assert np.abs(command.q_rad).max() <= np.radians(20.0)
            assert np.abs(command.q_rad - q_rad).max() <= 0.04 + 1e-12
            q_rad = command.q_rad


def test_where_daqp_fails_machine_code_keeps_the_progress_made_or_holds(monkeypatch):
    overrides = [*TIGHT_LIMITS, *TIGHT_STEPS]
    path, plant = path_of("star", overrides), drifting_plant(2, lost=0.0)
    _, fast = both(overrides)
    q_rad = fast.start(path).q_rad
    fails = cycle([False, True])

    def fails_every_second_time(*program):
        failed = qp.FAILED, np.zeros_like(program[-1][0]), 0.0
        return failed if next(fails) else qp.minimise(*program)

    monkeypatch.setattr(sqp, "minimise", fails_every_second_time)
    seen = set()
    for step in range(1, len(path)):
        command = fast.step(observation(step, plant(q_rad), q_rad))
        seen.add((command.outcome, command.detail.partition(" after")[0]))
        assert np.abs(command.q_rad).max() <= np.radians(20.0)
        assert np.abs(command.q_rad - q_rad).max() <= 0.04 + 1e-12
        q_rad = command.q_rad
    assert (Outcome.HELD, "the QP has no finite solution") in seen
    assert (Outcome.SOLVED, "stopped") in seen


def test_a_step_never_compiles_whatever_arrays_it_is_given():
    path = path_of("8shape")
    _, fast = both([])
    q_rad = fast.start(path).q_rad
    step_of_planner = compiled._entry()
    compiled_for = list(step_of_planner.signatures)
    assert len(compiled_for) == 1
    tip_mm = np.array([3.0, -95.0, 5.0])
    frozen = tip_mm.copy()
    frozen.setflags(write=False)
    commands = [
        fast.step(observation(1, tip, angles))
        for tip in (tip_mm, tip_mm.astype(np.float32), np.repeat(tip_mm, 2)[::2], frozen)
        for angles in (q_rad, q_rad.astype(np.float32), np.repeat(q_rad, 2)[::2])
    ]
    assert {c.outcome for c in commands} == {Outcome.SOLVED}
    assert list(step_of_planner.signatures) == compiled_for


def test_cache_on_disk_knows_of_every_source_file():
    """A file that is left out would leave stale machine code in place after an upgrade."""
    folder = Path(mpc.__file__).parent
    ours = {file.stem for file in folder.glob("*.py")} - {
        "__init__",
        "bending",
        "compiled",
        "controller",
    }
    watched = {module.__name__ for module in compiled.SOURCES}
    assert watched >= {f"{mpc.__name__}.{name}" for name in ours}
    imported = {
        getattr(value, "__module__", "")
        for module in compiled.SOURCES
        for value in vars(module).values()
        if callable(value)
    }
    used = {name for name in imported if name.startswith("ccr_host")}
    # A type's annotations are no code, and extras are looked for in Python.
    assert used - watched <= {
        "ccr_host.description.robot",
        "ccr_host.description.schema",
        "ccr_host.robot.workspace",
        "ccr_host.core.plugins",
    }


def test_numba_is_imported_only_when_a_description_asks_for_it():
    code = (
        "import sys; from ccr_host.control.registry import make_controller as make;"
        "from ccr_host.description import schema;"
        "make('mpc', schema.load()); make('mpc-offset', schema.load());"
        "assert 'numba' not in sys.modules;"
        "make('mpc', schema.load(overrides=['control.solver=compiled']));"
        "assert 'numba' in sys.modules"
    )
    subprocess.run([sys.executable, "-c", code], check=True)
