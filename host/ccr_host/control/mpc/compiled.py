"""``plan_step``, compiled to machine code."""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import lru_cache
from types import ModuleType
from typing import Any

import numpy as np
from numba.extending import overload
from numpy.typing import ArrayLike

from ccr_host.control import jit
from ccr_host.control.mpc import plan, problem, qp, sqp
from ccr_host.control.mpc.plan import Settings, StepResult
from ccr_host.control.mpc.problem import Constants, Expansion, Weights
from ccr_host.control.mpc.sqp import Bounds
from ccr_host.core.arrays import Array, IntArray
from ccr_host.robot import chain, kinematics
from ccr_host.robot.chain import NODES, STUMPFF, TERMS
from ccr_host.robot.kinematics import Chain

SOURCES: tuple[ModuleType, ...] = (chain, kinematics, problem, qp, sqp, plan)
_plan_step: Callable[..., StepResult] = plan.plan_step


def _planar_functions(theta_rad: Array) -> Array:
    rows, columns = theta_rad.shape
    waves = np.empty((columns, rows, 2 * len(NODES)))
    for n in range(rows):
        for i in range(columns):
            for k in range(len(NODES)):
                angle = theta_rad[n, i] * NODES[k]
                waves[i, n, k], waves[i, n, len(NODES) + k] = math.cos(angle), math.sin(angle)
    return waves


def _spatial_functions(bend_rad: Array, count: int) -> Array:
    functions, stumpff = np.empty((len(bend_rad), count)), np.empty(STUMPFF.shape[1])
    for n in range(len(bend_rad)):
        x, y = bend_rad[n, 0], bend_rad[n, 1]
        angle = math.sqrt(x * x + y * y)
        stumpff[:] = 0.0
        for node in range(len(NODES)):
            cosine = math.cos(angle * NODES[node])
            for k in range(len(stumpff)):
                stumpff[k] += cosine * STUMPFF[node, k]
        for term in range(count):
            i, j, k = TERMS[0, term], TERMS[1, term], TERMS[2, term]
            functions[n, term] = x**i * y**j * stumpff[k]
    return functions


def _chosen(rows: Array, numbers: IntArray) -> Array:
    some = np.empty((len(rows), len(numbers), rows.shape[2]))
    for n in range(len(rows)):
        for i in range(len(numbers)):
            for k in range(rows.shape[2]):
                some[n, i, k] = rows[n, numbers[i], k]
    return some


def _accumulated(rows: Array) -> Array:
    sums = rows.copy()
    for n in range(1, len(rows)):
        for k in range(rows.shape[1]):
            sums[n, k] += sums[n - 1, k]
    return sums


@jit.compiled
def _add_product(left: Array, right: Array, both: Array) -> None:
    for i in range(left.shape[0]):
        for j in range(left.shape[1]):
            weight = left[i, j]
            for k in range(right.shape[1]):
                both[i, k] += weight * right[j, k]


def _product(left: Array, right: Array) -> Array:
    both = np.zeros((left.shape[0], right.shape[1]))
    _add_product(left, right, both)
    return both


def _products_by_one(left: Array, right: Array) -> Array:
    both = np.zeros((right.shape[0], left.shape[0], right.shape[2]))
    for n in range(len(right)):
        _add_product(left, right[n], both[n])
    return both


def _products_with_one(left: Array, right: Array) -> Array:
    both = np.zeros((left.shape[0], left.shape[1], right.shape[1]))
    for n in range(len(left)):
        _add_product(left[n], right, both[n])
    return both


def _products(left: Array, right: Array) -> Array:
    both = np.zeros((left.shape[0], left.shape[1], right.shape[2]))
    for n in range(len(left)):
        _add_product(left[n], right[n], both[n])
    return both


def _left_to_python(
    expansion: Expansion, blend: float, ridge: float, lower: Array, upper: Array
) -> tuple[int, Array, float]:
    return qp.BOUND, lower[0].copy(), 0.0


_PRODUCTS = {
    (2, 2): _product,
    (2, 3): _products_by_one,
    (3, 2): _products_with_one,
    (3, 3): _products,
}
_IN_PLACE_OF: dict[Callable[..., Any], Callable[..., Callable[..., Any]]] = {
    chain.planar_functions: lambda *_: _planar_functions,
    chain.spatial_functions: lambda *_: _spatial_functions,
    kinematics.chosen: lambda *_: _chosen,
    kinematics.products: lambda left, right: _PRODUCTS[left.ndim, right.ndim],
    problem.accumulated: lambda *_: _accumulated,
    qp.solved: lambda *_: qp.solved_by_loops,
    qp.is_short: lambda *_: lambda _: False,
    qp.minimise_within: lambda *_: _left_to_python,
}
"""What machine code calls in place of functions that make one call of NumPy, LAPACK or DAQP."""

for _replaced, _choose in _IN_PLACE_OF.items():
    overload(_replaced, jit_options={"error_model": "numpy"}, strict=False)(_choose)
_texts: list[Callable[..., Any]] = [kinematics.jets, kinematics._functions]
for _text in _texts + jit.functions_of(problem, qp, sqp, plan):
    if _IN_PLACE_OF.get(_text) is None:
        jit.callable_when_compiled(_text)


def compiled_plan_step(settings: Settings) -> Callable[..., StepResult]:
    """``plan_step`` of a run, compiled or loaded by a first call.

    It ignores its settings, and rejects arguments of other types than ``Planner`` passes.
    """
    numbers, counts = _packed(settings)
    entry, motors = _entry(), len(settings.bounds.lower_rad)
    nowhere, still = np.zeros((2, 3 + motors)), np.zeros(motors)
    with jit.lightly_optimised():
        entry(numbers, counts, nowhere, nowhere, 1, 1, still, np.zeros(3), still)
    entry.disable_compile()
    return lambda _, *arguments: entry(numbers, counts, *arguments)


@lru_cache(maxsize=1)
def _entry() -> jit.Entry[StepResult]:
    """The function that Python calls. Arguments are few and flat, as each costs time in numba."""
    fingerprint = jit.fingerprint(*SOURCES, jit)

    def plan_step_compiled(numbers: Array, counts: IntArray, *arguments: object) -> StepResult:
        _ = fingerprint
        return _plan_step(_unpacked(numbers, counts), *arguments)

    return jit.compiled_on_disk(plan_step_compiled)


def _packed(settings: Settings) -> tuple[Array, IntArray]:
    """All numbers of the settings, and all sizes and indices, for ``_unpacked``."""
    constants, bounds = settings
    robot = constants.chain
    numbers: list[ArrayLike] = [[bounds.step_rad, *constants.weights]]
    numbers += bounds.lower_rad, bounds.upper_rad
    numbers += robot.bending, constants.effect, constants.bend
    numbers += constants.sizes, constants.square, constants.transition, constants.linear
    numbers += robot.shapes
    counts = [*robot.bending.shape, len(robot.first), constants.by_model]
    sizes: list[ArrayLike] = [counts]
    for is_planar, first, shape, kept in zip(
        robot.is_planar, robot.first, robot.shapes, robot.kept, strict=True
    ):
        sizes.append([is_planar, first, *shape.shape, len(kept)])
    sizes += ([len(constants.further)], constants.further, *robot.kept)
    flat = [np.ravel(array) for array in numbers]
    return np.concatenate(flat), np.concatenate(sizes).astype(np.int64)


@jit.callable_when_compiled
def _unpacked(numbers: Array, sizes: IntArray) -> Settings:
    n, freedoms, segments = sizes[0], sizes[1], sizes[2]
    table = sizes[4 : 4 + 5 * segments].reshape(segments, 5)
    index = 4 + 5 * segments
    derivatives, index = sizes[index], index + 1
    further, index = sizes[index : index + derivatives], index + derivatives
    lower, upper = numbers[4 : 4 + n], numbers[4 + n : 4 + 2 * n]
    bending, place = _matrix(numbers, 4 + 2 * n, n, freedoms)
    effect, place = _matrix(numbers, place, 2, 2)
    bend, place = _matrix(numbers, place, 4, 2)
    weighed, place = numbers[place : place + 3 + n], place + 3 + n
    square, place = _matrix(numbers, place, derivatives // freedoms, n * n)
    transition, place = _matrix(numbers, place, n + 4, 2 * n + 4)
    linear, place = _matrix(numbers, place, 2 * n + 4, 3 + n)
    shapes, kept = [], []
    for _, _, rows, columns, length in table:
        shape, place = _matrix(numbers, place, rows, columns)
        shapes.append(shape)
        kept.append(sizes[index : index + length])
        index += length
    is_planar = table[:, 0] != 0
    robot = Chain(bending, is_planar, is_planar.any(), table[:, 1].copy(), shapes, kept)
    weights = Weights(numbers[1], numbers[2], numbers[3])
    by_model = sizes[3] != 0
    constants = Constants(
        weights, weighed, by_model, robot, further, effect, bend, square, transition, linear
    )
    return Settings(constants, Bounds(lower, upper, numbers[0]))


@jit.callable_when_compiled
def _matrix(numbers: Array, place: int, rows: int, columns: int) -> tuple[Array, int]:
    end = place + rows * columns
    return numbers[place:end].reshape(rows, columns), end
