"""Rest poses of the twin.

A rest pose is a root of MuJoCo's generalised forces at zero velocity, without dry friction: with
friction it would depend on the previous motion.
"""

from __future__ import annotations

import math

import mujoco
import numpy as np
from numpy.typing import NDArray

from ccr_host.core.errors import CcrError
from ccr_host.description.simulation import Twin
from ccr_host.sim.robot.mjcf import MARKERS, TIP, robot_model

Array = NDArray[np.float64]

_MM_PER_M = 1e3
_KG_PER_G = 1e-3
_PROBE_RAD = 1e-6
_REST_NM = 1e-8
"""About 1e-5 of the moment that bends a segment by 1 deg: moves the tip by less than 0.1 um."""
LONGEST_LEG_RAD = math.radians(5.0)
"""Largest change of motor angle over which Newton's method finds the next rest pose safely."""
_NEWTON_LIMIT = 60
_LONGEST_STEP_RAD = 0.2
_SHORTEST_SHARE = 1e-3
_KEPT_WHILE_SHRINKING_BY = 0.3
"""A compliance is reused while each step with it reduces the forces to less than this fraction."""


class Equilibrium:
    """Rest poses of one twin, each found from the previous one.

    Args:
        twin: the ``twin`` section of the robot description; a payload counts if it is present from
            power-up, a push is ignored.
    """

    def __init__(self, twin: Twin) -> None:
        self._radius_m = twin.pulley_radius_mm / _MM_PER_M
        self._model = robot_model(twin)
        self._model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONSTRAINT
        self._data = mujoco.MjData(self._model)
        mujoco.mj_forward(self._model, self._data)
        self._slack_lengths_m = self._data.ten_length + np.divide(twin.slack_mm, _MM_PER_M)
        self._markers = [self._model.site(MARKERS[0]).id, self._model.site(MARKERS[2]).id]
        if twin.payload_start_s == 0:
            self._model.body_mass[self._model.body(TIP).id] = twin.payload_g * _KG_PER_G
            mujoco.mj_setConst(self._model, mujoco.MjData(self._model))
        self._compliance: Array | None = None
        self.joints_rad = np.zeros(self._model.nv)
        """Position of each joint, rad or m, at which the next search starts."""
        self.motor_rad = (0.0, 0.0)
        """Motor angles of this pose."""

    def tip_mm(self, motor_1_rad: float, motor_2_rad: float) -> Array:
        """Rest position of the tip, (3,).

        Raises:
            CcrError: no rest pose was found.
        """
        here_1, here_2 = self.motor_rad
        travel_1, travel_2 = motor_1_rad - here_1, motor_2_rad - here_2
        legs = max(1, math.ceil(max(abs(travel_1), abs(travel_2)) / LONGEST_LEG_RAD))
        for leg in range(1, legs + 1):
            wound_1_m = self._radius_m * (here_1 + leg / legs * travel_1)
            wound_2_m = self._radius_m * (here_2 + leg / legs * travel_2)
            wound_m = wound_1_m, wound_2_m, -wound_1_m, -wound_2_m
            self._data.ctrl[:] = self._slack_lengths_m - wound_m
            self.joints_rad = self._rest(self.joints_rad)
        self.motor_rad = (motor_1_rad, motor_2_rad)
        base, tip = self._data.site_xpos[self._markers]
        position: Array = (tip - base) * _MM_PER_M
        return position

    def _forces_nm(self, joints_rad: Array) -> Array:
        self._data.qpos[:] = joints_rad
        mujoco.mj_forward(self._model, self._data)
        forces: Array = self._data.qfrc_smooth.copy()
        return forces

    def _rest(self, joints_rad: Array) -> Array:
        """Newton's method; a compliance is reused while it reduces the forces fast enough.

        With the compliance of the current pose, the step is shortened until the forces decrease.
        """
        forces = self._forces_nm(joints_rad)
        size = abs(forces).max()
        for _ in range(_NEWTON_LIMIT):
            if size < _REST_NM:
                return joints_rad
            compliance = self._compliance
            is_of_this_pose = compliance is None
            if compliance is None:
                compliance = np.linalg.inv(self._stiffness(joints_rad, forces)).astype(np.float64)
                self._compliance = compliance
            step = -compliance @ forces
            share = min(1.0, _LONGEST_STEP_RAD / abs(step).max())
            while True:
                trial = joints_rad + share * step
                trial_forces = self._forces_nm(trial)
                trial_size = abs(trial_forces).max()
                if not is_of_this_pose or trial_size < size or share < _SHORTEST_SHARE:
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

    def _stiffness(self, joints_rad: Array, forces_nm: Array) -> Array:
        columns = [
            (self._forces_nm(joints_rad + probe) - forces_nm) / _PROBE_RAD
            for probe in _PROBE_RAD * np.eye(len(joints_rad))
        ]
        return np.array(columns).T
