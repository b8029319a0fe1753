"""One whole MPC step, measurement in and command out, beside other ways to solve it.

``python bench/mpc_step.py`` follows the 8-shape on the twin with the paper's controller, records
what it measured, and replays that to each way in turn, all in one process on one core:

- ccr-host: the controller "mpc" of this package;
- SciPy SLSQP with gradients by finite differences, which stands for MATLAB's fmincon;
- CasADi with IPOPT: exact derivatives, expression graph built once, warm start.

The peers solve the paper's own formulation, over increments within +-u_max. Each starts from its
own previous solution, shifted by a step. ``cost`` is the mean relative excess over the cheapest
solution found for the same measurement by any of them (local minima differ now and then).
Needs the extra ``test``.
"""

from __future__ import annotations

import argparse
import math
import platform
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol

import casadi
import numpy as np
from numpy.typing import NDArray
from rich.console import Console
from rich.table import Table
from scipy.optimize import minimize

from ccr_host import config
from ccr_host.config import Description
from ccr_host.control.base import Observation
from ccr_host.control.mpc import ModelPredictive
from ccr_host.robot.kinematics import ConstantCurvature
from ccr_host.robot.paths import load_path
from ccr_host.robot.reference import Reference
from ccr_host.robot.workspace import MotorLimits
from ccr_host.twin.robot import TwinRobot

Array = NDArray[np.float64]

PERIOD_US = 1_000_000
SETTLE_US = 2_000_000
WARM_UP_STEPS = 20


class Way(Protocol):
    """One way to make an MPC step."""

    def step(self, observation: Observation) -> Array:
        """The motor angles to command, (2,), rad."""
        ...

    def plan(self) -> Array:
        """All angles planned by the last step, (M, 2), rad."""
        ...


@dataclass(frozen=True)
class Problem:
    """(15) for one observation, over the live increments."""

    q_rad: Array
    measured_mm: Array
    targets_mm: Array


class Formulation:
    """Cost (15) in plain NumPy, as one would hand it to a general solver."""

    def __init__(self, description: Description, reference: Reference) -> None:
        self.robot, self.control = description.robot, description.control
        self.reference = reference
        self.gain = self.robot.pulley_radius_mm / self.robot.tendon_radius_mm

    def problem(self, observation: Observation) -> Problem:
        assert observation.tip_mm is not None
        i = observation.step
        targets = self.reference.target_mm[i : i + self.control.horizon - 1]
        return Problem(observation.q_rad, observation.tip_mm, targets)

    def cost(self, flat: Array, problem: Problem) -> float:
        moves = flat.reshape(-1, 2)
        poses = problem.q_rad + np.cumsum(moves, axis=0) - moves
        steps = np.einsum("kij,kj->ki", self._jacobian(poses), moves)
        errors = problem.measured_mm - problem.targets_mm + np.cumsum(steps, axis=0)
        squares = self.control.position_weight * np.sum(errors * errors)
        return float(squares + self.control.effort_weight * np.sum(moves * moves))

    def cost_of_plan(self, observation: Observation, plan_rad: Array) -> float:
        problem = self.problem(observation)
        moves = np.diff(np.vstack([problem.q_rad, plan_rad]), axis=0)
        return self.cost(moves.ravel(), problem)

    def _jacobian(self, q_rad: Array) -> Array:
        length_1, length_2 = self.robot.segment_lengths_mm
        theta = self.gain * q_rad
        near_zero = np.abs(theta) < 1e-4
        divisor = np.where(near_zero, 1.0, theta)
        sine, cosine = np.sin(theta), np.cos(theta)
        s = np.where(near_zero, 1.0, sine / divisor)
        v = np.where(near_zero, 0.5 * theta, (1.0 - cosine) / divisor)
        ds = np.where(near_zero, -theta / 3.0, (cosine - s) / divisor)
        dv = np.where(near_zero, 0.5, (sine - v) / divisor)
        lever, offset = length_2 * s[:, 1], self.robot.marker_offset_mm
        sine_1, cosine_1 = sine[:, 0], cosine[:, 0]
        jacobian = np.zeros((len(q_rad), 3, 2))
        jacobian[:, 1, 0] = -length_1 * ds[:, 0] + offset * cosine_1 + lever * sine_1
        jacobian[:, 2, 0] = length_1 * dv[:, 0] - offset * sine_1 + lever * cosine_1
        jacobian[:, 0, 1] = length_2 * dv[:, 1]
        jacobian[:, 1, 1] = -length_2 * ds[:, 1] * cosine_1
        jacobian[:, 2, 1] = length_2 * ds[:, 1] * sine_1
        return self.gain * jacobian


class Ours:
    """The product."""

    def __init__(self, description: Description, reference: Reference) -> None:
        self._controller = ModelPredictive(description)
        self._controller.start(reference)

    def step(self, observation: Observation) -> Array:
        return self._controller.step(observation).q_rad

    def plan(self) -> Array:
        return np.array(self._controller.plan_rad)


class ShiftedStart:
    """Warm start of the peers: the last increments, one step on."""

    def __init__(self, formulation: Formulation) -> None:
        self.formulation = formulation
        self.moves: Array = np.zeros((0, 2))

    def guess(self, live: int) -> Array:
        kept = self.moves[1 : 1 + live]
        return np.concatenate([kept, np.zeros((live - len(kept), 2))]).ravel()

    def plan(self) -> Array:
        return self.q_rad + np.cumsum(self.moves, axis=0)

    def keep(self, problem: Problem, flat: Array) -> Array:
        self.q_rad = problem.q_rad
        self.moves = flat.reshape(-1, 2)
        return problem.q_rad + self.moves[0]


class Slsqp(ShiftedStart):
    """SciPy, finite differences, its own tolerances."""

    def step(self, observation: Observation) -> Array:
        problem = self.formulation.problem(observation)
        guess = self.guess(len(problem.targets_mm))
        bound = self.formulation.control.step_bound_rad
        result = minimize(
            self.formulation.cost,
            guess,
            args=(problem,),
            method="SLSQP",
            bounds=[(-bound, bound)] * len(guess),
        )
        return self.keep(problem, result.x)


class Ipopt(ShiftedStart):
    """CasADi's interface to IPOPT, one solver per horizon length, built beforehand."""

    def __init__(self, formulation: Formulation) -> None:
        super().__init__(formulation)
        horizon = formulation.control.horizon
        self._solvers = {live: _ipopt(formulation, live) for live in range(1, horizon)}

    def step(self, observation: Observation) -> Array:
        problem = self.formulation.problem(observation)
        live = len(problem.targets_mm)
        parameters = np.concatenate(
            [problem.q_rad, problem.measured_mm, problem.targets_mm.ravel()]
        )
        bound = self.formulation.control.step_bound_rad
        result = self._solvers[live](x0=self.guess(live), p=parameters, lbx=-bound, ubx=bound)
        return self.keep(problem, np.array(result["x"]).ravel())


def _ipopt(formulation: Formulation, live: int) -> Any:  # noqa: ANN401 - casadi is untyped
    robot, control = formulation.robot, formulation.control
    length_1, length_2 = robot.segment_lengths_mm
    q = casadi.SX.sym("q", 2)
    theta_1, theta_2 = q[0] * formulation.gain, q[1] * formulation.gain
    lever = length_2 * _sinc(theta_2)
    offset = robot.marker_offset_mm
    tip = casadi.vertcat(
        length_2 * theta_2 / 2 * _sinc(theta_2 / 2) ** 2,
        -length_1 * _sinc(theta_1) + offset * casadi.sin(theta_1) - lever * casadi.cos(theta_1),
        length_1 * theta_1 / 2 * _sinc(theta_1 / 2) ** 2
        - offset * (1 - casadi.cos(theta_1))
        + lever * casadi.sin(theta_1),
    )
    jacobian = casadi.Function("J", [q], [casadi.jacobian(tip, q)])
    moves = casadi.SX.sym("u", 2, live)
    parameters = casadi.SX.sym("p", 2 + 3 + 3 * live)
    pose, position = parameters[:2], parameters[2:5]
    cost = 0
    for k in range(live):
        position = position + jacobian(pose) @ moves[:, k]
        pose = pose + moves[:, k]
        error = position - parameters[5 + 3 * k : 8 + 3 * k]
        cost += control.position_weight * casadi.sumsqr(error)
        cost += control.effort_weight * casadi.sumsqr(moves[:, k])
    quiet = {"print_level": 0, "sb": "yes", "warm_start_init_point": "yes", "mu_init": 1e-4}
    return casadi.nlpsol(
        "mpc",
        "ipopt",
        {"x": casadi.vec(moves), "p": parameters, "f": cost},
        {"ipopt": quiet, "print_time": False},
    )


def _sinc(x: Any) -> Any:  # noqa: ANN401
    series = 1 - x**2 / 6 + x**4 / 120 - x**6 / 5040
    small = casadi.fabs(x) < 0.02
    return casadi.if_else(small, series, casadi.sin(x) / casadi.if_else(small, 1, x))


def record(description: Description, reference: Reference, seed: int) -> list[Observation]:
    """One lap of the product on the twin at one step a second."""
    rng = np.random.default_rng(seed)
    twin = TwinRobot(description.twin)
    controller = ModelPredictive(description)
    q_rad = controller.start(reference).q_rad
    _pulse(twin, description, q_rad)
    time_us = SETTLE_US
    twin.advance_to(time_us)
    observations = []
    for step in range(1, len(reference)):
        time_us += PERIOD_US
        twin.advance_to(time_us)
        noise_mm = rng.normal(scale=description.tracker.noise_mm / math.sqrt(3.0), size=3)
        observation = Observation(step, time_us, twin.tip_mm() + noise_mm, 0, q_rad)
        observations.append(observation)
        q_rad = controller.step(observation).q_rad
        _pulse(twin, description, q_rad)
    return observations


def _pulse(twin: TwinRobot, description: Description, q_rad: Array) -> None:
    servo = description.servo
    per_rad = np.array(servo.pulse_per_90_deg_us) / (math.pi / 2.0)
    half_us = np.rint(2.0 * (np.array(servo.neutral_pulse_us) + per_rad * q_rad)).astype(int)
    twin.set_pulses_half_us((int(half_us[0]), int(half_us[1])))


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("--steps", type=int, default=237, help="steps to time (79 a lap)")
    parser.add_argument("--horizon", type=int, default=4)
    parser.add_argument("--seed", type=int, default=1)
    chosen = parser.parse_args()
    description = config.load(overrides=[f"control.horizon={chosen.horizon}"])
    model, limits = ConstantCurvature(description.robot), MotorLimits.of(description.servo)
    reference = load_path("8shape", 1.0, model, limits)
    formulation = Formulation(description, reference)
    laps = math.ceil(chosen.steps / (len(reference) - 1))
    recorded = [record(description, reference, chosen.seed + lap) for lap in range(laps)]
    ways: dict[str, Callable[[], Way]] = {
        "ccr-host": lambda: Ours(description, reference),
        "CasADi IPOPT, warm": lambda: Ipopt(formulation),
        "SciPy SLSQP, fin. diff.": lambda: Slsqp(formulation),
    }
    times_us: dict[str, list[float]] = {name: [] for name in ways}
    costs: dict[str, list[float]] = {name: [] for name in ways}
    for lap in recorded:
        for name, make in ways.items():
            _replay(make(), lap[:WARM_UP_STEPS])
            taken_us, plans = _replay(make(), lap)
            times_us[name] += taken_us
            costs[name] += [
                formulation.cost_of_plan(*pair) for pair in zip(lap, plans, strict=True)
            ]
    shown = slice(chosen.steps)
    _print(
        chosen.horizon,
        {name: np.array(taken[shown]) for name, taken in times_us.items()},
        {name: np.array(paid[shown]) for name, paid in costs.items()},
    )


def _replay(way: Way, observations: list[Observation]) -> tuple[list[float], list[Array]]:
    """Microseconds and plan of each step."""
    times_us, plans = [], []
    for observation in observations:
        began = time.perf_counter_ns()
        way.step(observation)
        times_us.append((time.perf_counter_ns() - began) / 1e3)
        plans.append(way.plan())
    return times_us, plans


def _print(horizon: int, times_us: dict[str, Array], costs: dict[str, Array]) -> None:
    best = np.min(list(costs.values()), axis=0)
    ours_us = float(np.median(next(iter(times_us.values()))))
    steps = len(best)
    table = Table(title=f"One MPC step, N = {horizon}, {steps} steps along the 8-shape on the twin")
    for column in ("", "median us", "p99 us", "x ours", "same minimum", "cost"):
        table.add_column(column, justify="left" if not column else "right")
    for name, taken in times_us.items():
        excess = costs[name] / best - 1.0
        same = excess < 1e-6
        table.add_row(
            name,
            f"{np.median(taken):.0f}",
            f"{np.percentile(taken, 99):.0f}",
            f"{np.median(taken) / ours_us:.1f}",
            f"{np.mean(same):.0%}",
            f"{np.mean(excess):.1e}",
        )
    console = Console()
    console.print(table)
    console.print(f"{_processor()}, Python {platform.python_version()}, NumPy {np.__version__}")


def _processor() -> str:
    information = Path("/proc/cpuinfo")
    if information.exists():
        for line in information.read_text().splitlines():
            if line.startswith("model name"):
                return line.partition(":")[2].strip()
    return platform.processor() or platform.machine()


if __name__ == "__main__":
    main()
