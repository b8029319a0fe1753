"""Rest poses of the twin, and those whose tips are nearest to targets.

A rest pose is a root of MuJoCo's generalised forces at zero velocity, without dry friction: with
friction it would depend on the previous motion.
"""

from __future__ import annotations

import math
from contextlib import suppress

import mujoco
import numpy as np
from numpy.typing import ArrayLike
from scipy.optimize import least_squares

from ccr_host.core.arrays import Array
from ccr_host.core.errors import CcrError
from ccr_host.description.robot import tendons_of
from ccr_host.description.simulation import Twin
from ccr_host.sim.robot.mechanics import tendon_jacobian
from ccr_host.sim.robot.mjcf import MARKERS, TIP, robot_model

_MM_PER_M = 1e3
_KG_PER_G = 1e-3
_PROBE = 1e-6
"""Share of half a turn, or of the way by which a joint shortens the backbone."""
_REST_NM = 1e-8
"""About 1e-5 of the moment that bends a segment by 1 deg: moves the tip by less than 0.1 um."""
LONGEST_LEG_RAD = math.radians(5.0)
"""Largest change of motor angle over which Newton's method finds the next rest pose safely."""
_SHORTEST_LEG_RAD = math.radians(0.05)
"""Where tendons have become taut or slack, a shorter leg may find what a longer one did not."""
_NEWTON_LIMIT = 60
_LONGEST_STEP_RAD = 0.2
_SHORTEST_SHARE = 1e-3
_PUSHES_BACK = 0.1
"""Greatest force against a step at its end, as a share of the force along it at its start."""
_KEPT_WHILE_SHRINKING_BY = 0.3
"""A compliance is reused while each step with it reduces the forces to less than this fraction."""


class Equilibrium:
    """Rest poses of one twin, each found from the previous one.

    A payload of the twin counts if it is present from power-up; a push is ignored.
    """

    def __init__(self, twin: Twin) -> None:
        radius_m = twin.pulley_radius_mm / _MM_PER_M
        self._motors = [tendon.motor - 1 for _, tendon in tendons_of(twin.segments)]
        self._wound_m_rad = np.array(
            [tendon.winding * radius_m for _, tendon in tendons_of(twin.segments)]
        )
        self._model = robot_model(twin)
        self._model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONSTRAINT
        self._data = mujoco.MjData(self._model)
        mujoco.mj_forward(self._model, self._data)
        self._slack_lengths_m = self._data.ten_length + np.divide(twin.slack_mm, _MM_PER_M)
        ends = 1, len(twin.segments) + 1
        self._markers = [self._model.site(MARKERS.format(number)).id for number in ends]
        if twin.payload_start_s == 0:
            self._model.body_mass[self._model.body(TIP).id] = twin.payload_g * _KG_PER_G
            mujoco.mj_setConst(self._model, mujoco.MjData(self._model))
        self._tendon_stiffness_n_m = twin.tendon_stiffness_n_m
        self._force_max_n = twin.tendon_force_max_n
        self._probes = _PROBE * self._model.jnt_range[:, 1]
        self._compliance: Array | None = None
        self.joints_rad = np.zeros(self._model.nv)
        """Position of each joint, rad or m, at which the next search starts."""
        self.motor_rad = np.zeros(len(twin.servo_neutral_us))
        """Motor angles of this pose, (n,)."""

    def tip_mm(self, motor_rad: ArrayLike) -> Array:
        """Rest position of the tip, (3,), at motor angles, (n,).

        Raises:
            CcrError: no rest pose was found.
        """
        self._walk(np.array(motor_rad, dtype=np.float64))
        base, tip = self._data.site_xpos[self._markers]
        position: Array = (tip - base) * _MM_PER_M
        return position

    @property
    def pose(self) -> tuple[Array, Array]:
        """Motor angles and joints, at which the next search starts."""
        return self.motor_rad, self.joints_rad

    @pose.setter
    def pose(self, pose: tuple[Array, Array]) -> None:
        self.motor_rad, self.joints_rad = pose

    @property
    def forces_n(self) -> Array:
        """Force of each tendon at the pose that was found last, 0 or less."""
        forces_n: Array = self._data.actuator_force
        return forces_n

    def play_rad(self, motor: int) -> tuple[float, ...]:
        """Turns of a motor, from 0, that would make a tendon taut; none if one that it winds is.

        They are those from the pose that was found last, one in each direction in which it winds.
        """
        travel_rad = (self._data.ctrl - self._data.ten_length) / self._wound_m_rad
        mine = np.array(self._motors) == motor
        if (self.forces_n[mine] < 0).any():
            return ()
        sides = (travel_rad[mine & (self._wound_m_rad * side > 0)] for side in (1, -1))
        return tuple(float(side[abs(side).argmin()]) for side in sides if side.size)

    def _walk(self, there_rad: Array) -> None:
        """Find the rest pose at motor angles, by way of others if they are far from the present."""
        travel_rad = there_rad - self.motor_rad
        is_short = abs(travel_rad).max() < _SHORTEST_LEG_RAD
        if abs(travel_rad).max() <= LONGEST_LEG_RAD:
            wound_m = self._wound_m_rad * there_rad[self._motors]
            self._data.ctrl[:] = self._slack_lengths_m - wound_m
            with suppress(*() if is_short else (CcrError,)):
                self.joints_rad = self._rest(self.joints_rad)
                self.motor_rad = there_rad
                return
            self._compliance = None
        self._walk(self.motor_rad + 0.5 * travel_rad)
        self._walk(there_rad)

    def _forces_nm(self, joints_rad: Array) -> Array:
        self._data.qpos[:] = joints_rad
        mujoco.mj_forward(self._model, self._data)
        forces: Array = self._data.qfrc_smooth.copy()
        return forces

    def _rest(self, joints_rad: Array) -> Array:
        """Newton's method; a compliance is reused while it reduces the forces fast enough.

        With the compliance of the current pose, the step is shortened until the forces at its end
        hardly push back. As they are the slope of an energy, that holds where a tendon becomes taut
        or slack too; the greatest of the forces may have to grow there.
        """
        forces = self._forces_nm(joints_rad)
        size = abs(forces).max()
        for _ in range(_NEWTON_LIMIT):
            if size < _REST_NM:
                return joints_rad
            compliance = self._compliance
            is_of_this_pose = compliance is None
            if compliance is None:
                compliance = np.linalg.inv(self._stiffness(joints_rad)).astype(np.float64)
                self._compliance = compliance
            step = -compliance @ forces
            share = min(1.0, _LONGEST_STEP_RAD / abs(step).max())
            while True:
                trial = joints_rad + share * step
                trial_forces = self._forces_nm(trial)
                trial_size = abs(trial_forces).max()
                pushes_back = -(trial_forces @ step) > _PUSHES_BACK * (forces @ step)
                if not is_of_this_pose or not pushes_back or share < _SHORTEST_SHARE:
                    break
                share *= 0.5
            if trial_size > _KEPT_WHILE_SHRINKING_BY * size:
                self._compliance = None
            if is_of_this_pose or trial_size < size:
                joints_rad, forces, size = trial, trial_forces, trial_size
        raise CcrError(
            "the twin found no rest pose for some motor angles",
            "raise twin.bending_stiffness_nm_rad or lower the masses",
        )

    def _stiffness(self, joints_rad: Array) -> Array:
        """Derivative of the forces, (joints, joints).

        That of taut tendons is computed as such: differences would make some taut or slack.
        """
        model, data = self._model, self._data
        forces_nm = self._forces_nm(joints_rad)
        routes = tendon_jacobian(model, data)
        lengths_m, pulls_m = data.ten_length.copy(), data.ctrl.copy()
        taut = (data.actuator_force < 0) & (data.actuator_force > -self._force_max_n)
        columns = []
        for probe in np.diag(self._probes):
            data.qpos[:] = joints_rad + probe
            mujoco.mj_fwdPosition(model, data)
            data.ctrl[:] = pulls_m + data.ten_length - lengths_m
            mujoco.mj_fwdVelocity(model, data)
            mujoco.mj_fwdActuation(model, data)
            mujoco.mj_fwdAcceleration(model, data)
            columns.append((data.qfrc_smooth - forces_nm) / probe.max())
        data.ctrl[:] = pulls_m
        by_tendons = self._tendon_stiffness_n_m * routes[taut].T @ routes[taut]
        return np.asarray(np.array(columns).T - by_tendons, dtype=np.float64)


_PROBE_RAD = 1e-3
_WITHIN = 1e-9
"""Least distance from the limits, rad: a search begins between them."""
_ROUNDS, _GAINED_MM = 10, 1e-3
_ROUNDING_MM = 1e-6
_REACHED_MM = 0.02
_ELSEWHERE_RAD = 0.5
"""A guess this near to what was found would lead there as well."""
_EFFORT_MM_N = 0.02
"""Weight of the tendons' forces beside the distance: 1 mm costs as much as 50 N. It decides where
many motor angles are as good; tendons that pull against each other would buckle the backbone."""


class NearestRest:
    """Follows targets with the tip of a twin at rest.

    Between two tendons that are slack a motor moves nothing, and no derivative tells on which side
    of this play it should be. So motors are turned to where they begin to pull, to the better side,
    in turns with Gauss-Newton steps. What is found is a minimum, not always the least one.
    ``lower_rad`` and ``upper_rad`` are the limits of the shafts, (n,).
    """

    def __init__(self, twin: Twin, lower_rad: Array, upper_rad: Array) -> None:
        self._equilibrium = Equilibrium(twin)
        self._lower_rad, self._upper_rad = lower_rad, upper_rad
        self.motor_rad: Array = np.clip(np.zeros(len(lower_rad)), lower_rad, upper_rad)
        """Motor angles of the last pose, (n,), at which the next search starts."""

    def distance_mm(self, target_mm: Array, guess_rad: Array | None = None) -> float:
        """Go to the rest pose nearest to a target, and return its distance.

        Args:
            target_mm: desired tip, (3,).
            guess_rad: motor angles, (n,), from which to search as well if the tip does not reach
                the target from the last pose and another pose is there.

        Raises:
            CcrError: the twin has no rest pose there.
        """
        distance_mm, motor_rad = self._descended(self.motor_rad, target_mm)
        if guess_rad is not None and distance_mm > _REACHED_MM:
            guess_rad = np.clip(guess_rad, self._lower_rad, self._upper_rad)
            if (abs(guess_rad - motor_rad) > _ELSEWHERE_RAD).any():
                other_mm, other_rad = self._descended(guess_rad, target_mm)
                if other_mm < distance_mm:
                    distance_mm, motor_rad = other_mm, other_rad
        self.motor_rad = motor_rad
        return distance_mm

    def _descended(self, motor_rad: Array, target_mm: Array) -> tuple[float, Array]:
        """Distance of a target, mm, and motor angles of the minimum that is found from some."""
        motor_rad = np.clip(motor_rad, self._lower_rad + _WITHIN, self._upper_rad - _WITHIN)
        distance_mm = np.inf
        for _ in range(_ROUNDS):
            motor_rad = self._taken_up(motor_rad, target_mm)
            found = least_squares(
                self._cost_mm,
                motor_rad,
                self._cost_slope_mm_rad,
                bounds=(self._lower_rad, self._upper_rad),
                ftol=1e-4,
                xtol=1e-5,
                gtol=1e-2,
                max_nfev=30,
                args=(target_mm,),
            )
            before_mm, distance_mm = distance_mm, float(np.linalg.norm(found.fun[:3]))
            motor_rad = found.x
            if distance_mm > before_mm - _GAINED_MM:
                break
        return distance_mm, motor_rad

    def _taken_up(self, motor_rad: Array, target_mm: Array) -> Array:
        """Turn motors whose tendons are slack to where they pull, if that brings the tip nearer."""
        distance_mm = float(np.linalg.norm(self._equilibrium.tip_mm(motor_rad) - target_mm))
        for motor in range(len(motor_rad)):
            self._equilibrium.tip_mm(motor_rad)
            better_rad = motor_rad
            for play_rad in self._equilibrium.play_rad(motor):
                trial_rad = motor_rad.copy()
                trial_rad[motor] += play_rad + np.copysign(_PROBE_RAD, play_rad)
                if self._lower_rad[motor] < trial_rad[motor] < self._upper_rad[motor]:
                    trial_mm = np.linalg.norm(self._equilibrium.tip_mm(trial_rad) - target_mm)
                    if trial_mm < distance_mm - _ROUNDING_MM:
                        better_rad, distance_mm = trial_rad, float(trial_mm)
            motor_rad = better_rad
        return motor_rad

    def _cost_mm(self, motor_rad: Array, target_mm: Array) -> Array:
        """The tip off its target, then the weighted forces of the tendons.

        Not a number where there is no rest: the search then takes a shorter step.
        """
        start = self._equilibrium.pose
        try:
            off_mm = self._equilibrium.tip_mm(motor_rad) - target_mm
        except CcrError:
            self._equilibrium.pose = start
            return np.full(3 + len(self._equilibrium.forces_n), np.nan)
        return np.concatenate([off_mm, _EFFORT_MM_N * self._equilibrium.forces_n])

    def _cost_slope_mm_rad(self, motor_rad: Array, target_mm: Array) -> Array:
        here_mm = self._cost_mm(motor_rad, target_mm)
        here, columns = self._equilibrium.pose, []
        for motor, angle_rad in enumerate(motor_rad):
            probe_rad = np.zeros(len(motor_rad))
            is_below = angle_rad < self._upper_rad[motor] - _PROBE_RAD
            probe_rad[motor] = _PROBE_RAD if is_below else -_PROBE_RAD
            there_mm = self._cost_mm(motor_rad + probe_rad, target_mm)
            columns.append((there_mm - here_mm) / probe_rad[motor])
            self._equilibrium.pose = here
        slope: Array = np.nan_to_num(np.array(columns).T)
        return slope


def nearest_rests(
    twin: Twin, lower_rad: Array, upper_rad: Array, targets_mm: Array, guesses_rad: Array
) -> tuple[Array, Array]:
    """The rest pose nearest to each target, found from the one before or from a guess.

    Args:
        twin: the ``twin`` section of the robot description.
        lower_rad: lower limits of the shafts, (n,).
        upper_rad: upper limits of the shafts, (n,).
        targets_mm: desired tips, (N, 3).
        guesses_rad: motor angles, (N, n).

    Returns:
        Motor angles, (N, n), and distances from the targets in mm, (N,).

    Raises:
        CcrError: the twin has no rest pose on the way.
    """
    nearest = NearestRest(twin, lower_rad, upper_rad)
    nearest.distance_mm(targets_mm[0], guesses_rad[0])
    found = [
        (nearest.distance_mm(target_mm, guess_rad), nearest.motor_rad)
        for target_mm, guess_rad in zip(targets_mm, guesses_rad, strict=True)
    ]
    distances_mm, motors_rad = zip(*found, strict=True)
    return np.array(motors_rad), np.array(distances_mm)
