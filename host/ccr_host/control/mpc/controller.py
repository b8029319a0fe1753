"""Algorithm 1 of the paper: model predictive control with optical feedback.

A plan starts from the pose that a `PoseEstimate` finds: where the tip is, and how the robot is
bent beyond its commands.
"""

from __future__ import annotations

import math
from typing import NamedTuple, Protocol

import numpy as np

from ccr_host.control.base import Command, Observation, Outcome
from ccr_host.control.mpc import sqp
from ccr_host.control.mpc.plan import Planner, Settings
from ccr_host.control.mpc.problem import Constants, Weights
from ccr_host.control.mpc.sqp import Bounds
from ccr_host.control.shell import COMMAND_DELAY_S, all_ends_mm, believable
from ccr_host.core.arrays import Array
from ccr_host.description.schema import Description
from ccr_host.robot.kinematics import ConstantCurvature
from ccr_host.robot.reference import Reference
from ccr_host.robot.setpoint_history import SetpointHistory
from ccr_host.robot.workspace import MotorLimits

_FAILURES = {
    sqp.COST_NOT_FINITE: "the cost is not finite",
    sqp.HESSIAN_NOT_CONVEX: "the Hessian is not positive definite",
    sqp.QP_FAILED: "the QP has no finite solution",
}
_US_PER_S = 1e6
_LONG_AGO_S = 1e6


class ModelPredictive:
    """The paper's MPC: the horizon shrinks at the end of the path, the first increment is applied.

    As printed with ``control.bending = "commanded"``; otherwise J is that of the robot as it is
    bent, and moves along the path are no effort.

    In addition to (15)'s bound on each increment, every planned angle respects the motor limits.
    Without a measurement it predicts from the model and the last error between model and
    measurement. Without a solution it repeats the last command.

    Raises:
        ConfigError: the solver needs an extra that is not installed.
    """

    name = "mpc"
    shortest_printed_s = 0.2
    """Shortest period with Algorithm 1 as printed: at shorter ones the delays of camera and servos,
    which (14) leaves out, let the robot swing or run away, see docs/control-baselines.md."""

    def __init__(self, description: Description) -> None:
        control, model = description.control, ConstantCurvature(description.robot)
        self._model, self._limits = model, MotorLimits.of(description.servo)
        bounds = Bounds.of(self._limits, control.step_bound_rad)
        self._live_steps = control.horizon - 1
        constants = Constants.of(description.robot, Weights.of(description))
        settings = Settings(constants, bounds)
        self._planner = Planner(settings, control.solver)
        self._description = description

    def start(self, reference: Reference) -> Command:
        """Return the nearest reachable configuration of the first sample."""
        self._steps = len(reference)
        reachable_rad = self._limits.clip(reference.q_rad)
        self._planner.begin(np.hstack([reference.target_mm, reachable_rad]))
        self._last_rad = reachable_rad[0].copy()
        self._planner.interrupt(self._last_rad)
        self.plan_rad = self._last_rad[None, :]
        """The angles planned by the last step, (M, n)."""
        self._estimate = pose_estimate(self._description)
        predicted_mm = self._model.tip_mm(self._last_rad)[None, :]
        return Command(self._last_rad.copy(), predicted_mm, Outcome.SOLVED)

    def step(self, observation: Observation) -> Command:
        """Return the command for a measurement; never raises on bad measurements."""
        tip_mm = observation.tip_mm
        if not np.isfinite(observation.q_rad).all():
            return self._hold("the angles commanded last are not finite")
        if tip_mm is not None and not np.isfinite(tip_mm).all():
            return self._hold("the measured position is not finite")
        if not observation.step < self._steps:
            return self._hold("the path is over")
        commanded_rad = self._limits.clip(observation.q_rad)
        outcome = Outcome.COASTED if tip_mm is None else Outcome.SOLVED
        steps = min(self._live_steps, self._steps - observation.step)
        # A wild measurement costs infinitely much, which is no solution.
        with np.errstate(over="ignore", invalid="ignore"):
            pose = self._estimate.pose(observation, commanded_rad)
            status, iterations, plan = self._planner.plan(
                observation.step, steps, commanded_rad, *pose
            )
        if status in _FAILURES:
            return self._hold(_FAILURES[status])
        self.plan_rad = plan[:, :-3]
        self._last_rad = plan[0, :-3]
        detail = "" if status == sqp.CONVERGED else f"stopped after {iterations} iterations"
        return Command(self._last_rad.copy(), plan[:, -3:], outcome, detail, iterations=iterations)

    def _hold(self, why: str) -> Command:
        self._planner.interrupt(self._last_rad)
        self.plan_rad = self._last_rad[None, :]
        return Command(self._last_rad.copy(), np.empty((0, 3)), Outcome.HELD, why)


class Pose(NamedTuple):
    """The robot at the end of the period, were its motors to stay at their last command."""

    tip_mm: Array
    """(3,)."""
    extra_rad: Array
    """Motor angles that would bend the model as the robot is bent beyond its commands, (n,)."""


class PoseEstimate(Protocol):
    """Estimates the pose at each control step of a path."""

    def pose(self, observation: Observation, commanded_rad: Array) -> Pose:
        """The pose by the last command, (n,); the measured tip is finite or None."""
        ...


class AsMeasured:
    """Algorithm 1: the tip is where it was seen last, the bending that of constant curvature."""

    def __init__(self, model: ConstantCurvature) -> None:
        self._model = model
        self._last_seen: tuple[Array, Array] | None = None

    def pose(self, observation: Observation, commanded_rad: Array) -> Pose:
        """The measured tip; without one, the model's with the last error between both."""
        nothing_rad = np.zeros_like(commanded_rad)
        if observation.tip_mm is not None:
            self._last_seen = np.array(observation.tip_mm, dtype=np.float64), commanded_rad
            return Pose(self._last_seen[0], nothing_rad)
        position_mm = self._model.tip_mm(commanded_rad)
        if self._last_seen is not None:
            seen_mm, then = self._last_seen
            position_mm = position_mm + seen_mm - self._model.tip_mm(then)
        return Pose(position_mm, nothing_rad)


class BendingFilter:
    """Extended Kalman filter of the bending that the motors do not explain, from all markers.

    Slack, load and friction bend a segment by up to a radian more or less than its motors say.
    There, J of the commanded angles leads a feedback law away from its target. Each degree of
    freedom is bent by a Gauss-Markov process of second order, with its rate as a state: the
    stationary one with the covariance s^2 (1 + l t) exp(-l t) at an interval t (Matern 3/2). So
    what lost markers do not tell stays within s. A measurement is compared with the setpoint in
    effect when it was taken, so that delays of camera and servos are not mistaken for bending. The
    tip's error that the filter leaves is added to the predicted tip.

    The constants were chosen on ``three-spatial`` and four random robots at 1 and 20 Hz, when the
    filter saw M2 and the tip alone: l from 0.15 to 0.3 and half or twice s or the noise, of which
    only the ratio counts, changed the error by up to a sixth, ``_SWING_S``, which stood for
    ``_ALIKE_S`` too, by a third (robot 7 at 20 Hz).
    """

    _DEVIATION_RAD = 0.3
    """s."""
    _PER_S = 0.2
    """l."""
    _NOISE = 0.01
    """Deviation of a measured coordinate, over the length from the base: what a rigid chain of
    constant curvature leaves, more than a camera's noise."""
    _ALIKE_S = 0.5
    """Time for which those errors stay alike: of measurements T apart, each has 1 + this / T times
    the variance. At 20 Hz 0.1 instead lets ``hard`` swing, see docs/control.md."""
    _SWING_S = 0.1
    """Time for which the structure swings: the tip's error seen T after the previous measurement
    counts by T / (T + this)."""

    def __init__(self, model: ConstantCurvature) -> None:
        self._model = model
        self._noise_mm = self._NOISE * np.cumsum(model.lengths_mm)
        self._motors_of = np.linalg.pinv(model.bending_rad(np.eye(model.motors)))
        self._freedoms = len(model.segment_of_freedom)
        self._each = np.eye(self._freedoms)
        deviations = self._DEVIATION_RAD * np.array([1.0, self._PER_S])
        self._prior = np.diag(np.repeat(deviations**2, self._freedoms))
        self._covariance = self._prior
        self._state = np.zeros(2 * self._freedoms)
        self._residual_mm = np.zeros(3)
        self._seen_s = -_LONG_AGO_S
        self._given_s = 0.0
        self._history: SetpointHistory | None = None

    def pose(self, observation: Observation, commanded_rad: Array) -> Pose:
        """Update the filter, if there is a measurement, and predict the tip."""
        now_s = observation.time_us / _US_PER_S
        if self._history is None:
            self._history = SetpointHistory(commanded_rad)
            period_s = 0.0
        else:
            self._history.command(self._given_s, commanded_rad, 0.0)
            period_s = now_s - self._given_s
        self._given_s = now_s
        exposed_s = now_s - observation.tip_age_us / _US_PER_S
        if observation.tip_mm is not None and exposed_s > self._seen_s:
            setpoint_rad = self._history.at(exposed_s - COMMAND_DELAY_S)
            seen_mm = all_ends_mm(len(self._noise_mm), observation.ends_mm, observation.tip_mm)
            self._update(setpoint_rad, seen_mm, exposed_s - self._seen_s)
            self._seen_s = exposed_s
        expected = self._transition(now_s + period_s - self._seen_s) @ self._state
        bending_rad = expected[: self._freedoms]
        tip_mm = self._ends(commanded_rad, bending_rad)[0][-1] + self._residual_mm
        return Pose(tip_mm, bending_rad @ self._motors_of)

    def _update(self, setpoint_rad: Array, seen_mm: Array, elapsed_s: float) -> None:
        transition = self._transition(elapsed_s)
        state = transition @ self._state
        covariance = self._prior + transition @ (self._covariance - self._prior) @ transition.T
        is_seen = np.isfinite(seen_mm).all(axis=1)
        ends_mm, slopes = self._ends(setpoint_rad, state[: self._freedoms])
        slope = slopes[is_seen].reshape(-1, self._freedoms)
        slope = np.hstack([slope, np.zeros_like(slope)])
        innovation_mm = np.ravel([believable(off) for off in (seen_mm - ends_mm)[is_seen]])
        spread_mm2 = slope @ covariance @ slope.T
        noise_mm2 = self._noise_mm[is_seen] ** 2 * (1.0 + self._ALIKE_S / elapsed_s)
        spread_mm2 += np.diag(np.repeat(noise_mm2, 3))
        gain = np.linalg.solve(spread_mm2, slope @ covariance).T
        self._state = state + gain @ innovation_mm
        self._covariance = covariance - gain @ slope @ covariance
        tip_mm = self._ends(setpoint_rad, self._state[: self._freedoms])[0][-1]
        residual_mm = seen_mm[-1] - tip_mm
        share = elapsed_s / (elapsed_s + self._SWING_S)
        self._residual_mm += share * believable(residual_mm - self._residual_mm)

    def _transition(self, elapsed_s: float) -> Array:
        """What an interval makes of the bending and its rate, (2 D, 2 D)."""
        share = self._PER_S * elapsed_s
        change = np.array([[1.0 + share, elapsed_s], [-self._PER_S * share, 1.0 - share]])
        both = math.exp(-share) * change[:, None, :, None] * self._each[:, None, :]
        return both.reshape(2 * self._freedoms, -1)

    def _ends(self, q_rad: Array, beyond_rad: Array) -> tuple[Array, Array]:
        """Ends of the segments, mm, (S, 3), and their slopes by the bending, mm/rad, (S, 3, D)."""
        bending_rad = self._model.bending_rad(q_rad) + beyond_rad
        places_mm, slopes = self._model.markers_mm(bending_rad[None])
        return places_mm[0], slopes[0]


def pose_estimate(description: Description) -> PoseEstimate:
    """The estimate that ``control.bending`` selects."""
    model = ConstantCurvature(description.robot)
    is_printed = description.control.bending == "commanded"
    return AsMeasured(model) if is_printed else BendingFilter(model)
