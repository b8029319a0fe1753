"""CasADi: exact derivatives, expression graph built once, warm start."""

from __future__ import annotations

import shutil
import subprocess
from pathlib import Path
from typing import Any

import casadi
import numpy as np

from bench.peers.mpc.problem import Formulation, ShiftedStart
from ccr_host.control.base import Observation

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
        given = np.concatenate([problem.q_rad, problem.measured_mm, problem.targets_mm.ravel()])
        result = self._solver(
            x0=self.guess(),
            p=given,
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
        live = formulation.live_steps
        # The buffer keeps neither its function nor the arrays alive.
        self._function = _compiled(nlpsol(formulation, "sqpmethod", SQP_QRQP), folder)
        self._buffer, self._run = self._function.buffer()
        bound = formulation.control.step_bound_rad
        self.guess, self.given = np.zeros(2 * live), np.zeros(5 + 3 * live)
        self.solution = np.zeros(2 * live)
        self._inputs = {
            "x0": self.guess,
            "p": self.given,
            "lbx": np.full(2 * live, -bound),
            "ubx": np.full(2 * live, bound),
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
        solver.given[:2] = problem.q_rad
        solver.given[2:5] = problem.measured_mm
        solver.given[5:] = problem.targets_mm.ravel()
        solver.run()
        self.keep(problem, solver.solution.copy())


def nlpsol(formulation: Formulation, plugin: str, options: dict[str, Any]) -> Any:
    """A CasADi solver of (15) over a whole horizon."""
    control, live = formulation.control, formulation.live_steps
    q = casadi.SX.sym("q", 2)
    tip = tip_of(formulation, q)
    jacobian = casadi.Function("J", [q], [casadi.jacobian(tip, q)])
    moves = casadi.SX.sym("u", 2, live)
    given = casadi.SX.sym("p", 5 + 3 * live)
    pose, position, cost, poses = given[:2], given[2:5], 0, []
    for k in range(live):
        position = position + jacobian(pose) @ moves[:, k]
        pose = pose + moves[:, k]
        poses.append(pose)
        error = position - given[5 + 3 * k : 8 + 3 * k]
        cost += control.position_weight * casadi.sumsqr(error)
        cost += control.effort_weight * casadi.sumsqr(moves[:, k])
    problem = {"x": casadi.vec(moves), "p": given, "f": cost, "g": casadi.vertcat(*poses)}
    return casadi.nlpsol("mpc", plugin, problem, options)


def tip_of(formulation: Formulation, q: Any) -> Any:
    """(10) of motor angles (2,)."""
    robot = formulation.robot
    length_1, length_2 = robot.segment_lengths_mm
    theta_1, theta_2 = q[0] * formulation.gain, q[1] * formulation.gain
    lever = length_2 * _sinc(theta_2)
    offset = robot.marker_offset_mm
    return casadi.vertcat(
        length_2 * theta_2 / 2 * _sinc(theta_2 / 2) ** 2,
        -length_1 * _sinc(theta_1) + offset * casadi.sin(theta_1) - lever * casadi.cos(theta_1),
        length_1 * theta_1 / 2 * _sinc(theta_1 / 2) ** 2
        - offset * (1 - casadi.cos(theta_1))
        + lever * casadi.sin(theta_1),
    )


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


def _sinc(x: Any) -> Any:
    series = 1 - x**2 / 6 + x**4 / 120 - x**6 / 5040
    small = casadi.fabs(x) < 0.02
    return casadi.if_else(small, series, casadi.sin(x) / casadi.if_else(small, 1, x))
