"""The static model of the paper's robot, and the choice of a model for any robot."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from ccr_host.control.adaptive import motion, path_plan, tip
from ccr_host.control.adaptive.chain_space import ChainSpace
from ccr_host.control.adaptive.chain_statics import ChainStatics
from ccr_host.control.adaptive.motion import Moves, Pose
from ccr_host.control.adaptive.parameter_space import ParameterSpace
from ccr_host.control.adaptive.parameters import Parameters, Scaling
from ccr_host.control.adaptive.static_model import PROBE, Hold, PathPlan, Sensitivity, StaticModel
from ccr_host.control.adaptive.statics import hold_of, unhindered_setpoints_for
from ccr_host.core.arrays import Array
from ccr_host.core.plugins import import_optional
from ccr_host.description.schema import Control, Description
from ccr_host.robot.reference import Reference
from ccr_host.robot.rests import Rests
from ccr_host.robot.workspace import MotorLimits

_REFINEMENTS = 4
_ROWS_RAD = np.radians((0.0, 50.0, 100.0, -100.0, -50.0))
_COLUMNS_RAD = np.radians((-110.0, -40.0, 40.0, 110.0))


def tour_bending_rad() -> Array:
    """Bending angles at which all parameters are observable, (N, 2), in an order of short moves.

    They cover the workspace: only large bends distinguish the camera's rotation from the robot's
    sag.
    """
    stops: list[tuple[float, float]] = []
    for number, row in enumerate(_ROWS_RAD):
        columns = _COLUMNS_RAD if number % 2 == 0 else _COLUMNS_RAD[::-1]
        stops.extend((row, column) for column in columns)
    return np.array(stops)


class PlainModel(StaticModel[Parameters, Pose]):
    """The computations in plain Python; several parameter sets at once are arrays."""

    passed_rad = math.radians(10.0)
    """The only angle that was tried from both sides (bench/results.md)."""

    def first_pose(self, p: Parameters, setpoint_rad: Array) -> Pose:
        return motion.first_pose(p, *setpoint_rad.tolist())

    def moved(self, p: Parameters, pose: Pose, duration_s: float, *setpoints_rad: Array) -> Pose:
        each_s = duration_s / len(setpoints_rad)
        for setpoint_rad in setpoints_rad:
            q_1, q_2 = setpoint_rad.tolist()
            pose = motion.moved(p, pose, q_1, q_2, each_s)
        return pose

    def turned(self, p: Parameters, pose: Pose, setpoint_rad: Array) -> Pose:
        if p.friction_1 > 0.0:
            return self.moved(p, pose, 0.0, setpoint_rad)
        return motion.turned(p, pose, *setpoint_rad.tolist())

    def shifted(self, before: Parameters, after: Parameters, pose: Pose, theta_rad: Array) -> Pose:
        return motion.shifted(before, after, pose, theta_rad)

    def tip_mm(self, p: Parameters, theta_rad: Array) -> Array:
        return tip.tip_mm(p, *theta_rad.tolist())

    def markers_mm(self, p: Parameters, theta_rad: Array) -> Array:
        return motion.markers_along(p, *theta_rad.T)

    def turned_back_mm(self, p: Parameters, seen_mm: Array) -> Array:
        return tip.turned_back_mm(p, seen_mm)

    def predicted_mm(self, p: Parameters, rests: Rests) -> Array:
        return motion.predicted_mm(p, rests)

    def predicted_and_slopes(
        self, space: ParameterSpace[Parameters], score: Array, rests: Rests
    ) -> tuple[Array, Array]:
        moves = motion.moves_of(rests)
        trail, near = self._trail(space.parameters(score), moves), motion.probing(score)
        return motion.slopes_along(space.each(near), trail, moves)

    def _trail(self, p: Parameters, moves: Moves) -> Array:
        """The robot's first pose and those after all motions, packed, (T + 1, 12)."""
        return np.array([motion.packed(pose) for pose in motion.trail_of(p, moves)])

    def sensitivity(
        self,
        space: ParameterSpace[Parameters],
        score: Array,
        numbers: Sequence[int],
        p: Parameters,
        pose: Pose,
        rate_rad_s: Array,
    ) -> Sensitivity:
        here = motion.slopes_of(p, pose)
        travel_1, travel_2 = np.zeros((2, len(numbers) + 1))
        travel_1[-1], travel_2[-1] = PROBE * rate_rad_s
        near = self._near(space, score, numbers)
        columns = np.array(motion.change_of(here, near, pose, travel_1, travel_2)) / PROBE
        return Sensitivity(columns[:3], columns[3:])

    @staticmethod
    def _near(
        space: ParameterSpace[Parameters], score: Array, numbers: Sequence[int]
    ) -> Parameters:
        """Robots with each of K scores increased a little in turn, then the robot itself."""
        return space.each(score + PROBE * np.eye(space.count + 1, space.count)[[*numbers, -1]])

    def hold(
        self,
        p: Parameters,
        pose: Pose,
        theta_rad: Array,
        sides: tuple[float, ...],
        change_over: tuple[float, ...],
    ) -> Hold:
        (side_1, side_2), (most_1, most_2) = sides, change_over
        theta_1, theta_2 = theta_rad.tolist()
        held = hold_of(p, theta_1, theta_2, pose.anchors, (side_1, side_2), (most_1, most_2))
        return Hold(motion.setpoint_for(p, pose, held.shafts), held.sides)

    def unhindered_rad(self, p: Parameters, theta_rad: Array) -> Array:
        return unhindered_setpoints_for(p, theta_rad)

    def nearest(
        self,
        p: Parameters,
        planned_rad: Array,
        shift_rad: Array,
        aim_mm: Array,
    ) -> Array:
        return self.polished(p, planned_rad + shift_rad, aim_mm, _REFINEMENTS)

    def polished(self, p: Parameters, theta_rad: Array, target_mm: Array, iterations: int) -> Array:
        return path_plan.polished(p, theta_rad, target_mm, iterations)

    def plan(
        self, p: Parameters, limits: MotorLimits, reference: Reference, knots: Array
    ) -> PathPlan:
        targets_mm = reference.target_mm[knots.astype(int)]
        return path_plan.plan_path(p, limits, targets_mm, knots, np.zeros(2), self.polished)

    def tour_rad(self, p: Parameters, limits: MotorLimits) -> Array:
        return limits.clip(unhindered_setpoints_for(p, tour_bending_rad()))


PLAIN = PlainModel()


def make_model(control: Control) -> PlainModel:
    """Make the model that ``control.solver`` names.

    Raises:
        ConfigError: it needs an extra that is not installed.
    """
    if control.solver == "compiled":
        import_optional("numba", "fast", "control.solver = compiled")
        from ccr_host.control.adaptive.compiled import CompiledModel  # noqa: PLC0415 - optional

        return CompiledModel()
    return PLAIN


def make_static_model(
    description: Description, *, is_new: bool = False
) -> tuple[StaticModel[Any, Any], ParameterSpace[Any]]:
    """The static model of a robot and its parameters.

    Of a new robot (``is_new``) neither the camera nor the zeros of the servos are known.

    Raises:
        ConfigError: it needs an extra that is not installed.
    """
    if not description.robot.segments:
        scaling = Scaling.before_setup(description) if is_new else Scaling.of(description)
        return make_model(description.control), scaling
    space = ChainSpace(description, is_new=is_new)
    return ChainStatics(description, space), space
