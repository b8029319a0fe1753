"""CasADi: exact derivatives, expression graph built once, warm start."""

from __future__ import annotations

import math
import shutil
import subprocess
from pathlib import Path
from typing import Any

import casadi
import numpy as np

from bench.peers.mpc.problem import Formulation, ShiftedStart
from ccr_host.control.base import Observation
from ccr_host.robot.chain import PAPER_FRAME
from ccr_host.robot.kinematics import freedom_of

IPOPT = {
    "ipopt": {"print_level": 0, "sb": "yes", "warm_start_init_point": "yes", "mu_init": 1e-4},
    "print_time": False,
}
SQP = {
    "print_header": False,
    "print_iteration": False,
    "print_status": False,
    "print_time": False,
    "error_on_fail": False,
    "convexify_strategy": "eigen-clip",
    "max_iter": 30,
}
SQP_DAQP = {**SQP, "qpsol": "daqp", "qpsol_options": {"error_on_fail": False}}
SQP_QRQP = {
    **SQP,
    "qpsol": "qrqp",
    "qpsol_options": {
        "error_on_fail": False,
        "print_header": False,
        "print_iter": False,
        "print_info": False,
    },
}


class Nlp(ShiftedStart):
    """Solve with a CasADi solver over u_1..u_M, motor limits as constraints."""

    def __init__(self, formulation: Formulation, solver: Any) -> None:
        super().__init__(formulation)
        self._solver = solver
        live = formulation.live_steps
        self._bound = formulation.control.step_bound_rad
        self._lower = np.tile(formulation.limits.lower_rad, live)
        self._upper = np.tile(formulation.limits.upper_rad, live)

    def step(self, observation: Observation) -> None:
        problem = self.formulation.problem(observation)
        result = self._solver(
            x0=self.guess(),
            p=problem.numbers(),
            lbx=-self._bound,
            ubx=self._bound,
            lbg=self._lower,
            ubg=self._upper,
        )
        self.keep(problem, np.array(result["x"]).ravel())


class GeneratedSolver:
    """CasADi's SQP method with its QP solver as C code, called through buffers.

    Raises:
        ImportError: no C compiler is installed.
    """

    def __init__(self, formulation: Formulation, folder: Path) -> None:
        live, motors = formulation.live_steps, formulation.motors
        # The buffer keeps neither its function nor the arrays alive.
        self._function = _compiled(nlpsol(formulation, "sqpmethod", SQP_QRQP), folder)
        self._buffer, self._run = self._function.buffer()
        bound = formulation.control.step_bound_rad
        self.guess = np.zeros(motors * live)
        self.given = np.zeros(2 * motors + 3 + (3 + motors) * live)
        self.solution = np.zeros(motors * live)
        self._inputs = {
            "x0": self.guess,
            "p": self.given,
            "lbx": np.full(motors * live, -bound),
            "ubx": np.full(motors * live, bound),
            "lbg": np.tile(formulation.limits.lower_rad, live),
            "ubg": np.tile(formulation.limits.upper_rad, live),
        }
        for name, array in self._inputs.items():
            self._buffer.set_arg(self._function.index_in(name), memoryview(array))
        self._buffer.set_res(self._function.index_out("x"), memoryview(self.solution))

    def run(self) -> None:
        """Solver that maps ``guess`` and ``given`` to ``solution``."""
        self._run()


class GeneratedSqp(ShiftedStart):
    """The steps of a generated solver."""

    def __init__(self, formulation: Formulation, solver: GeneratedSolver) -> None:
        super().__init__(formulation)
        self._solver = solver

    def step(self, observation: Observation) -> None:
        problem, solver = self.formulation.problem(observation), self._solver
        solver.guess[:] = self.guess()
        solver.given[:] = problem.numbers()
        solver.run()
        self.keep(problem, solver.solution.copy())


def nlpsol(formulation: Formulation, plugin: str, options: dict[str, Any]) -> Any:
    """A CasADi solver of (15) over a whole horizon."""
    weights, live, n = formulation.weights, formulation.live_steps, formulation.motors
    q = casadi.SX.sym("q", n)
    tip = tip_of(formulation, q)
    jacobian = casadi.Function("J", [q], [casadi.jacobian(tip, q)])
    moves = casadi.SX.sym("u", n, live)
    given = casadi.SX.sym("p", 2 * n + 3 + (3 + n) * live)
    extra, ahead = given[n + 3 : 2 * n + 3], given[2 * n + 3 :]
    free = casadi.reshape(ahead[3 * live :], n, live)
    pose, position, cost, poses = given[:n], given[n : n + 3], 0, []
    for k in range(live):
        position = position + jacobian(pose + extra) @ moves[:, k]
        pose = pose + moves[:, k]
        poses.append(pose)
        error = position - ahead[3 * k : 3 * k + 3]
        cost += weights.position * casadi.sumsqr(error)
        cost += weights.effort * casadi.sumsqr(moves[:, k] - free[:, k])
    problem = {"x": casadi.vec(moves), "p": given, "f": cost, "g": casadi.vertcat(*poses)}
    return casadi.nlpsol("mpc", plugin, problem, options)


def tip_of(formulation: Formulation, q: Any) -> Any:
    """(10) of motor angles (n,), for any chain of segments."""
    robot, model = formulation.robot, formulation.model
    freedom = freedom_of(robot.chain)
    y = casadi.mtimes(casadi.DM(model.bending_rad(np.eye(model.motors)).T), q)
    marker = casadi.DM([0.0, robot.marker_offset_mm, 0.0])
    point = marker
    for number in reversed(range(len(robot.chain))):
        bend = casadi.mtimes(casadi.DM(freedom[:, number].T), y)
        x, size = casadi.sumsqr(bend), robot.chain[number].length_mm
        small = x < 0.01
        angle = casadi.sqrt(casadi.if_else(small, 1, x))
        c_1 = casadi.if_else(small, _series(x, 1), casadi.sin(angle) / angle)
        c_2 = casadi.if_else(small, _series(x, 2), (1 - casadi.cos(angle)) / angle**2)
        across, along = point[:2], point[2]
        turned = across - c_2 * bend * casadi.dot(bend, across) + c_1 * bend * along
        ahead = (1 - c_2 * x) * along - c_1 * casadi.dot(bend, across)
        point = casadi.vertcat(turned + size * c_2 * bend, ahead + size * c_1)
    return casadi.mtimes(casadi.DM(PAPER_FRAME), point - marker)


def _series(x: Any, number: int) -> Any:
    return sum((-x) ** k / math.factorial(2 * k + number) for k in range(6))


def _compiled(solver: Any, folder: Path) -> Any:
    compiler = shutil.which("gcc") or shutil.which("cc")
    if compiler is None:
        raise ImportError("no C compiler")
    folder.mkdir(parents=True, exist_ok=True)
    generator = casadi.CodeGenerator("mpc.c")
    generator.add(solver)
    source = Path(generator.generate(f"{folder}/"))
    library = folder / "mpc.so"
    flags = ["-O2", "-march=native", "-shared", "-fPIC"]
    subprocess.run([compiler, *flags, str(source), "-o", str(library), "-lm"], check=True)
    return casadi.external("mpc", str(library))
