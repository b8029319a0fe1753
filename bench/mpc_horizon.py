"""Time of one whole MPC step over horizon and motors, compared with peers that pip installs.

``python -m bench.mpc_horizon`` follows the 8-shape on the twin with Algorithm 1 as printed, or with
``--motors`` a path with ``mpc`` and another robot, which is then the model but for a constant
error. It records the measurements, and gives every recorded step to each solver in turn, in one
process: other load on the machine affects all of them alike, and none has the caches to itself.
Each starts from its previous solution. Times are those of the calling thread, by its CPU clock and
by the wall clock; the ratio is that of the CPU medians. ``excess`` is the cost of a plan above that
of the cheapest plan found by any solver for the same step: its median, and the mean with anything
above twice the cost counted as that; ``beyond`` is the largest violation of the bounds by any plan.

Robots of other than two motors are compared with CasADi's IPOPT only. Solvers whose package or
compiler is missing are skipped with a notice. Needs the extras ``test``
and ``bench``. To time peers that start threads, set OMP_NUM_THREADS=1 and OPENBLAS_NUM_THREADS=1.
"""

from __future__ import annotations

import argparse
import itertools
import platform
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from importlib import resources
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console
from rich.table import Table

import ccr_host.description
from bench.peers.mpc import ours
from bench.peers.mpc.problem import Array, Formulation, Recorded, ShiftedStart, Way, record
from ccr_host.control.base import Observation
from ccr_host.core.errors import ConfigError
from ccr_host.description import schema
from ccr_host.description.schema import Description
from ccr_host.robot.kinematics import ConstantCurvature
from ccr_host.robot.paths import load_path
from ccr_host.robot.workspace import MotorLimits, Workspace

WARM_UP_STEPS = 5
SAME_MINIMUM = 1e-6
IPOPT = "CasADi IPOPT, warm"
ROBOTS = {1: "single", 2: "default", 4: "two-spatial", 6: "two-spatial", 9: "three-spatial"}
PATHS = {1: "swing", 2: "8shape", 4: "helix", 6: "helix", 9: "helix"}
THIRD_SEGMENT = """
[[robot.segments]]
length_mm = 60
tendon_radius_mm = 4.5
tendons = [
  { angle_deg = 90, motor = 5 },
  { angle_deg = 270, motor = 5, winding = -1 },
  { angle_deg = 0, motor = 6 },
  { angle_deg = 180, motor = 6, winding = -1 },
]
"""
"""Makes the robot of four motors one of six."""
LARGEST_GENERATED_HORIZON = 10
"""Longest horizon; beyond, gcc takes many minutes for CasADi's code with the exact Hessian."""


@dataclass
class Score:
    """Scores of one solver over all steps."""

    cpu_us: list[float] = field(default_factory=list)
    wall_us: list[float] = field(default_factory=list)
    plans_rad: list[Array] = field(default_factory=list)
    cost: list[float] = field(default_factory=list)
    violation_rad: list[float] = field(default_factory=list)


def main() -> None:
    """Print a table for each horizon."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("--horizons", type=int, nargs="+", default=[4, 10, 20, 40])
    parser.add_argument("--motors", type=int, nargs="+", default=[2], choices=list(ROBOTS))
    parser.add_argument(
        "--steps", type=int, default=150, help="number of timed steps for each horizon"
    )
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--alone", action="store_true", help="alternate per lap: warm caches")
    chosen = parser.parse_args()
    console = Console(width=130)
    for motors, horizon in itertools.product(chosen.motors, chosen.horizons):
        with tempfile.TemporaryDirectory() as folder:
            robot = robot_of(motors, Path(folder))
            words = [f"control.horizon={horizon}"]
            if motors == 2:  # The paper's robot.
                words.append("control.bending=commanded")
            description = schema.load(robot, words)
            scores = compare(
                description, chosen.steps, chosen.seed, Path(folder), console, alone=chosen.alone
            )
        title = f"{motors} motors, N = {horizon}, path {PATHS[motors]}"
        console.print(table(title, scores))
    console.print(f"{_processor()}, Python {platform.python_version()}, NumPy {np.__version__}")


def robot_of(motors: int, folder: Path) -> str:
    """A description with a number of motors, by name or file."""
    if motors != 6:
        return ROBOTS[motors]
    shipped = resources.files(ccr_host.description) / "shipped" / "two-spatial.toml"
    file = folder / "three-segments.toml"
    file.write_text(shipped.read_text() + THIRD_SEGMENT)
    return str(file)


def compare(
    description: Description, steps: int, seed: int, folder: Path, console: Console, *, alone: bool
) -> dict[str, Score]:
    """All ways on the same steps, taking turns at each step or, ``alone``, at each lap."""
    model, limits = ConstantCurvature(description.robot), MotorLimits.of(description.servo)
    reference = load_path(PATHS[model.motors], 1.0, Workspace(model, limits))
    formulation = Formulation(description, reference)
    makers = ways(description, formulation, folder)
    usable = {}
    for name, make in makers.items():
        try:
            make()
        except (ImportError, ConfigError) as missing:
            console.print(f"left out: {name} ({missing})")
        else:
            usable[name] = make
    scores = {name: Score() for name in usable}
    while len(next(iter(scores.values())).cost) < steps:
        lap = record(description, reference, seed)
        seed += 1
        for make in usable.values():
            warm = make()
            for observation in lap[:WARM_UP_STEPS]:
                warm.step(observation)
        fresh = {name: make() for name, make in usable.items()}
        turns = [(name, observation) for observation in lap for name in fresh]
        if alone:
            turns = [(name, observation) for name in fresh for observation in lap]
        for name, observation in turns:
            time_step(fresh[name], observation, scores[name])
        for kept in scores.values():
            judge(formulation, lap, kept)
    return scores


def time_step(way: Way, observation: Observation, kept: Score) -> None:
    """Solve one step."""
    wall_ns, cpu_ns = time.perf_counter_ns(), time.thread_time_ns()
    way.step(observation)
    cpu_ns = time.thread_time_ns() - cpu_ns
    wall_ns = time.perf_counter_ns() - wall_ns
    kept.cpu_us.append(cpu_ns / 1e3)
    kept.wall_us.append(wall_ns / 1e3)
    kept.plans_rad.append(way.plan())
    if isinstance(way, ShiftedStart):
        way.forget_nonsense()


def judge(formulation: Formulation, lap: list[Recorded], kept: Score) -> None:
    """Evaluate the cost of the plans of the last lap."""
    for observation, plan_rad in zip(lap, kept.plans_rad[-len(lap) :], strict=True):
        kept.cost.append(formulation.cost_of_plan(observation, plan_rad))
        kept.violation_rad.append(formulation.violation_rad(observation, plan_rad))


def ways(
    description: Description, formulation: Formulation, folder: Path
) -> dict[str, Callable[[], Way]]:
    """Constructors by name; they raise ImportError if their package is missing."""
    control, reference = formulation.control, formulation.reference

    def product(solver: str) -> Way:
        update = {"control": control.model_copy(update={"solver": solver})}
        return ours.Ours(description.model_copy(update=update), reference)

    def backend(solver: Callable[[], ours.QpSolver]) -> Callable[[], Way]:
        return lambda: ours.OtherQp(description, reference, solver())

    products: dict[str, Callable[[], Way]] = {
        "ccr-host": lambda: product("daqp"),
        "ccr-host, compiled": lambda: product("compiled"),
    }
    casadi = casadi_ways(formulation, folder)
    if formulation.motors != 2:
        return {**products, IPOPT: casadi[IPOPT]}
    return {
        **products,
        "ccr-host with PIQP": backend(ours.piqp),
        "ccr-host with OSQP": backend(ours.osqp),
        "ccr-host with Clarabel": backend(ours.clarabel),
        "ccr-host with ProxQP": backend(ours.proxqp),
        **casadi,
        "do-mpc (IPOPT)": lambda: do_mpc(formulation),
        "SciPy SLSQP, fin. diff.": lambda: slsqp(formulation),
    }


def casadi_ways(formulation: Formulation, folder: Path) -> dict[str, Callable[[], Way]]:
    """CasADi with a general, a QP-based and a generated solver; each is built once."""
    built: dict[str, Any] = {}

    def nlp(plugin: str) -> Way:
        from bench.peers.mpc import casadi_nlp

        options = {"ipopt": casadi_nlp.IPOPT, "sqpmethod": casadi_nlp.SQP_DAQP}[plugin]
        if plugin not in built:
            built[plugin] = casadi_nlp.nlpsol(formulation, plugin, options)
        return casadi_nlp.Nlp(formulation, built[plugin])

    def generated() -> Way:
        from bench.peers.mpc import casadi_nlp

        if formulation.control.horizon > LARGEST_GENERATED_HORIZON:
            raise ImportError("the code takes too long to compile")
        if "generated" not in built:
            built["generated"] = casadi_nlp.GeneratedSolver(formulation, folder)
        return casadi_nlp.GeneratedSqp(formulation, built["generated"])

    return {
        "CasADi, generated C, SQP": generated,
        "CasADi sqpmethod with DAQP": lambda: nlp("sqpmethod"),
        IPOPT: lambda: nlp("ipopt"),
    }


def do_mpc(formulation: Formulation) -> Way:
    """The do-mpc package."""
    from bench.peers.mpc.do_mpc_controller import DoMpc

    return DoMpc(formulation)


def slsqp(formulation: Formulation) -> Way:
    """SciPy."""
    from bench.peers.mpc.scipy_slsqp import Slsqp

    return Slsqp(formulation)


def table(title: str, scores: dict[str, Score]) -> Table:
    """Times and quality of each solver; the ratio is to our fastest one."""
    best = np.min([kept.cost for kept in scores.values()], axis=0)
    quickest = scores.get("ccr-host, compiled", scores["ccr-host"])
    ours_us = float(np.median(quickest.cpu_us))
    shown = Table(title=f"{title}, {len(best)} steps")
    for column in ("", "CPU us", "p99", "wall us", "p99 ", "ratio", "same minimum"):
        shown.add_column(column, justify="left" if not column else "right")
    for column in ("excess, median", "mean", "beyond, rad"):
        shown.add_column(column, justify="right")
    for name, kept in scores.items():
        excess = np.array(kept.cost) / best - 1.0
        shown.add_row(
            name,
            f"{np.median(kept.cpu_us):.1f}",
            f"{np.percentile(kept.cpu_us, 99):.0f}",
            f"{np.median(kept.wall_us):.1f}",
            f"{np.percentile(kept.wall_us, 99):.0f}",
            f"{np.median(kept.cpu_us) / ours_us:.1f}",
            f"{np.mean(excess < SAME_MINIMUM):.0%}",
            f"{np.median(excess):.0e}",
            f"{np.mean(np.minimum(excess, 1.0)):.0e}",
            f"{max(kept.violation_rad):.0e}",
        )
    return shown


def _processor() -> str:
    information = Path("/proc/cpuinfo")
    if information.exists():
        for line in information.read_text().splitlines():
            if line.startswith("model name"):
                return line.partition(":")[2].strip()
    return platform.processor() or platform.machine()


if __name__ == "__main__":
    main()
