"""Newton's methods to the configurations of least effort: nearest to points, or along a line.

The effort is half the energy of bending, half the motor angles in shares of their ranges, which
keep away from the limits. (These alone favour some directions of a segment with three motors:
neighbours may then have distant configurations.)
"""

from __future__ import annotations

import numpy as np
from scipy import sparse
from scipy.sparse.linalg import splu

from ccr_host.core.arrays import Array, BoolArray
from ccr_host.robot.kinematics import ConstantCurvature

_LONGEST_STEP_RAD = 0.3
_HALVINGS = 30
EFFORTS = (1e-4, 1e-7, 1e-10, 1e-14)
"""Weights of the effort over the square of the robot's length. The last one decides between
configurations that are equally near, and moves none by as much as rounding does. Alone it would
have Newton's steps crawl along them, for they lie on a curve; the first ones take long steps."""
_SHARE_OF_MOTORS = 0.5
"""Share of the motor angles in the effort; the rest is energy. On a helix of `three-spatial` at
2 Hz no motor then moves by more than 0.06 rad a sample; by 0.68 with the motor angles alone."""
_LEAST_CURVATURE = 1e-3
"""Least curvature of the cost over the effort's weight; keeps Newton's steps finite."""
_ROUNDING = 1e-15
_EVENED_LENGTHS = 0.5
"""Way of the tip, in lengths of the robot, over which a change costs as much as where it leads."""
_EVENED_EFFORTS, _EVENED_STEPS, _EVENED_RAD = EFFORTS[:2], 40, 1e-3
"""Weights of the effort, used in turn; most steps with each; a step below which it is done."""
_DAMPING_FALL, _DAMPING_RISE = 0.3, 5.0


class Projection:
    """Configurations of one robot of constant curvature between limits, (n,) each, rad."""

    def __init__(self, model: ConstantCurvature, lower_rad: Array, upper_rad: Array) -> None:
        self._model = model
        self._lower_rad, self._upper_rad = lower_rad, upper_rad
        self.length_mm: float = sum(model.lengths_mm) + model.marker_offset_mm
        """Length of the segments and of the offset of the marker at the tip."""
        self.middle_rad: Array = 0.5 * (lower_rad + upper_rad)
        """Motor angles midway between the limits, (n,), from which the effort counts."""
        shares = np.diag((0.5 * np.maximum(upper_rad - lower_rad, 1e-12)) ** -2.0)
        energy = model.energy * (np.trace(shares) / np.trace(model.energy))
        self.effort: Array = (1.0 - _SHARE_OF_MOTORS) * energy + _SHARE_OF_MOTORS * shares
        """Twice the effort over the squares of the motor angles from the middle, (n, n)."""
        self._least = _LEAST_CURVATURE * float(np.linalg.eigvalsh(self.effort)[0])

    def descended(
        self,
        q_rad: Array,
        target_mm: Array,
        axes: list[int],
        weight: float,
        steps: int,
        until_rad: float,
        middle_rad: Array | None = None,
    ) -> Array:
        """Newton's steps within the limits, from each row to the minimum in whose valley it is.

        Efforts count from the middle of the limits, or from ``middle_rad``, (N, n).
        """
        weight *= self.length_mm**2
        effort = weight * self.effort
        middles = (
            np.broadcast_to(self.middle_rad, q_rad.shape) if middle_rad is None else middle_rad
        )
        q = q_rad.copy()
        moving = np.arange(len(q))
        for _ in range(steps):
            if not len(moving):
                break
            here, target, middle = q[moving], target_mm[moving], middles[moving]
            tip, by_motors, by_two = self._model.second_order(here)
            miss, jacobian = (tip[:, axes] - target)[:, :, None], by_motors[:, axes]
            gradient = (np.swapaxes(jacobian, 1, 2) @ miss)[:, :, 0]
            gradient += (here - middle) @ effort
            curvature = np.swapaxes(jacobian, 1, 2) @ jacobian + effort
            curvature += np.einsum("nk,nkij->nij", miss[:, :, 0], by_two[:, axes])
            free = ~self._held(here, gradient)
            curvature *= free[:, :, None] & free[:, None, :]
            step = _newton(curvature, gradient * free, weight * self._least)
            before = _cost(here - middle, miss[:, :, 0], effort)
            there = self._downhill(here, before, step, target, axes, effort, middle)
            q[moving] = there
            moving = moving[np.abs(there - here).max(axis=1) > until_rad]
        return q

    def _downhill(
        self,
        here: Array,
        before: Array,
        step: Array,
        target_mm: Array,
        axes: list[int],
        effort: Array,
        middle: Array,
    ) -> Array:
        """Poses along the steps, within the limits, that cost no more; else the same poses."""
        there = np.clip(here + step, self._lower_rad, self._upper_rad)
        miss_mm = self._model.tip_mm(there)[:, axes] - target_mm
        higher = _cost(there - middle, miss_mm, effort) > before * (1.0 + _ROUNDING)
        share = np.ones(len(here))
        for _ in range(_HALVINGS):
            rows = np.flatnonzero(higher)
            if not len(rows):
                break
            share[rows] *= 0.5
            shorter = here[rows] + share[rows, None] * step[rows]
            there[rows] = np.clip(shorter, self._lower_rad, self._upper_rad)
            miss_mm = self._model.tip_mm(there[rows])[:, axes] - target_mm[rows]
            cost = _cost(there[rows] - middle[rows], miss_mm, effort)
            higher[rows] = cost > before[rows] * (1.0 + _ROUNDING)
        return np.where(higher[:, None], here, there)

    def evened(self, q_rad: Array, line_mm: Array, axes: list[int], *, is_closed: bool) -> Array:
        """The configurations along a line, (N, n), of least effort with that of their change.

        By Levenberg and Marquardt's method. The tip stays within hundredths of a millimetre of the
        points of the line, which are equally far apart; the last one is the first if it is closed.
        """
        q, line = (rows[: len(rows) - is_closed] for rows in (q_rad, line_mm))
        count, motors = q.shape
        apart_mm = np.linalg.norm(np.diff(line_mm, axis=0), axis=1).mean()
        eye = sparse.eye_array(count, format="csr")
        changes = (eye[np.roll(np.arange(count), -1)] - eye)[: len(line_mm) - 1]
        changes *= _EVENED_LENGTHS * self.length_mm / apart_mm
        efforts = sparse.kron(eye + changes.T @ changes, self.effort, format="csr")
        middle, every = np.tile(self.middle_rad, count), sparse.eye_array(count * motors)

        def judged(q: Array, weight: float) -> tuple[float, Array, Array]:
            """Twice the cost, its slope, (N n,), and the tip's slopes, (N, axes, n)."""
            miss, jacobian = self._model.tip_mm(q)[:, axes] - line, self._model.jacobian_mm_rad(q)
            from_middle, jacobian = q.ravel() - middle, jacobian[:, axes]
            slope = weight * (efforts @ from_middle)
            cost = float((miss**2).sum() + slope @ from_middle)
            return cost, slope + (np.swapaxes(jacobian, 1, 2) @ miss[:, :, None]).ravel(), jacobian

        for weight in np.array(_EVENED_EFFORTS) * self.length_mm**2:
            cost, slope, jacobian = judged(q, weight)
            damping = 1.0
            for _ in range(_EVENED_STEPS):
                blocks = np.swapaxes(jacobian, 1, 2) @ jacobian
                curvature = sparse.bsr_array((blocks, np.arange(count), np.arange(count + 1)))
                curvature = curvature + weight * (1.0 + damping) * efforts
                free = sparse.diags_array(1.0 - self._held(q, slope.reshape(q.shape)).ravel())
                system = (free @ curvature @ free + every - free).tocsc()
                solver = splu(system, "MMD_AT_PLUS_A", 0.0, options={"SymmetricMode": True})
                step = -solver.solve(free @ slope).reshape(q.shape)
                step = np.clip(step, -_LONGEST_STEP_RAD, _LONGEST_STEP_RAD)
                there = np.clip(q + step, self._lower_rad, self._upper_rad)
                trial = judged(there, weight)
                if trial[0] >= cost:
                    damping *= _DAMPING_RISE
                    continue
                moved_rad, damping = np.abs(there - q).max(), _DAMPING_FALL * damping
                q, (cost, slope, jacobian) = there, trial
                if moved_rad < _EVENED_RAD:
                    break
        return np.concatenate([q, q[:is_closed]])

    def _held(self, q_rad: Array, gradient: Array) -> BoolArray:
        """Which motor angles are at a limit beyond which the cost would fall, (N, n)."""
        lower, upper = self._lower_rad, self._upper_rad
        held: BoolArray = ((q_rad <= lower) & (gradient > 0.0)) | (
            (q_rad >= upper) & (gradient < 0.0)
        )
        return held


def _cost(from_middle: Array, miss_mm: Array, effort: Array) -> Array:
    twice = (miss_mm**2).sum(axis=1) + ((from_middle @ effort) * from_middle).sum(axis=1)
    cost: Array = 0.5 * twice
    return cost


def _newton(curvature: Array, gradient: Array, least: float) -> Array:
    """Steps downhill, (N, n), with curvature, (N, n, n), taken to be ``least`` or more."""
    values, vectors = np.linalg.eigh(curvature)
    along = np.swapaxes(vectors, 1, 2) @ gradient[:, :, None]
    step = -(vectors @ (along / np.maximum(np.abs(values), least)[:, :, None]))[:, :, 0]
    longest = np.abs(step).max(axis=1, keepdims=True)
    shortened: Array = step * np.minimum(1.0, _LONGEST_STEP_RAD / np.maximum(longest, 1e-300))
    return shortened
