"""MuJoCo behind a small typed interface: tendons and loads in, positions out."""

from __future__ import annotations

from collections.abc import Sequence

import mujoco
import numpy as np

from ccr_host.core.arrays import Array
from ccr_host.core.errors import CcrError, ConfigError
from ccr_host.description.robot import tendons_of
from ccr_host.description.simulation import Twin
from ccr_host.sim.robot.memory import Memory, memories
from ccr_host.sim.robot.mjcf import DISKS, MARKERS, TIP, robot_model


def linear_step_limit_s(
    model: mujoco.MjModel, data: mujoco.MjData, tendon_stiffness_n_m: float
) -> float:
    """Longest stable step h about the pose of ``data``, all tendons taut.

    Semi-implicit Euler with implicit damping is stable while 4 M + 2 h C - h^2 K is positive
    definite (M inertia, C damping, K stiffness). ``data`` must be up to date (mj_forward).
    """
    inertia = np.zeros((model.nv, model.nv))
    mujoco.mj_fullM(model, data, inertia)
    damping = np.diag(model.dof_damping)
    routes = tendon_jacobian(model, data)
    stiffness = np.diag(model.jnt_stiffness) + tendon_stiffness_n_m * routes.T @ routes
    stable_s, unstable_s = 1e-9, 1.0
    while unstable_s > 1.001 * stable_s:
        step_s = float(np.sqrt(stable_s * unstable_s))
        margin = 4 * inertia + 2 * step_s * damping - step_s**2 * stiffness
        if np.linalg.eigvalsh(margin)[0] > 0:
            stable_s = step_s
        else:
            unstable_s = step_s
    return stable_s


def tendon_jacobian(model: mujoco.MjModel, data: mujoco.MjData) -> Array:
    """Derivative of the tendon lengths by the joint angles, m/rad, (tendons, joints)."""
    jacobian = np.zeros((model.ntendon, model.nv))
    for row, (start, count) in enumerate(zip(model.ten_J_rowadr, model.ten_J_rownnz, strict=True)):
        columns = model.ten_J_colind[start : start + count]
        jacobian[row, columns] = data.ten_J[start : start + count]
    return jacobian


_MM_PER_M = 1e3
_KG_PER_G = 1e-3

_STABLE_SHARE = 0.3
"""Fraction of the linear limit of the time step: with tendons going taut and slack, nearly undamped
structures became unstable from about 0.5 on."""
_NEVER = 1 << 62
_SHORTEST_STEP_US = 5
"""Below this, a run of 80 s would take minutes."""

_SETTLED_RAD_S = 1e-7
_SETTLE_LIMIT_S = 100.0
_SETTLE_CHUNK_STEPS = 50
_SETTLE_DAMPING_S = 0.1
"""Damping over stiffness of each flexure while settling: about critical for the slowest mode."""


class UnfitTwinError(ConfigError):
    """The description cannot be simulated."""


class Mechanics:
    """The structure and its tendons, at rest under gravity with the pulleys at zero.

    ``payload_g`` is a mass on the tip from the start.

    Raises:
        UnfitTwinError: these parameters cannot be simulated.
    """

    def __init__(self, twin: Twin, payload_g: float) -> None:
        self._twin = twin
        self._model = robot_model(twin)
        self._data = mujoco.MjData(self._model)
        mujoco.mj_forward(self._model, self._data)
        slack_lengths_m = self._data.ten_length + np.divide(twin.slack_mm, _MM_PER_M)
        self._slack_lengths_m: list[float] = slack_lengths_m.tolist()
        self._tendon_lengths_m = self._data.ctrl  # kept as views: attribute access is slow
        self._forces_n = self._data.actuator_force  # negative: a tendon only pulls
        self._joints = self._data.qpos
        self._per_bound = 1.0 / self._model.jnt_range[:, 1]
        """Beyond these bounds, a joint is as unphysical as a NaN."""
        self._tip = self._model.body(TIP).id
        markers = range(1, len(twin.segments) + 2)
        self._markers = [self._model.site(MARKERS.format(number)).id for number in markers]
        disks = range(sum(twin.flexures) + 1)
        self._disks = [self._model.site(DISKS.format(number)).id for number in disks]
        self._radius_m = twin.pulley_radius_mm / _MM_PER_M
        self._windings = [
            (tendon.motor - 1, tendon.winding) for _, tendon in tendons_of(twin.segments)
        ]
        self.step_us = self._choose_step_us()
        self._model.opt.timestep = self.step_us * 1e-6
        self._steps_done = 0
        self._next_update = _NEVER
        self._memories: list[tuple[int, Memory]] = []
        self.set_payload(payload_g)
        self.pull([0.0] * len(twin.servo_neutral_us))
        self._settle()
        for memory in memories(twin, self._model, self._data, self._slack_lengths_m):
            memory.start()
            self._memories.append((max(1, memory.period_us // self.step_us), memory))
        self._find_next_update()

    def pull(self, pulleys_rad: Sequence[float]) -> None:
        """Turn the pulleys (2), (n,): each winds up some tendons, and may pay out others."""
        lengths_m, slack_m = self._tendon_lengths_m, self._slack_lengths_m
        wound_m = [self._radius_m * angle_rad for angle_rad in pulleys_rad]
        for tendon, (motor, winding) in enumerate(self._windings):
            lengths_m[tendon] = slack_m[tendon] - winding * wound_m[motor]

    def pulley_moments_nm(self) -> list[float]:
        """Moment of the tendons on each pulley, positive if it turns it to greater angles."""
        forces_n = [0.0] * len(self._twin.servo_neutral_us)
        for (motor, winding), force_n in zip(self._windings, self._forces_n.tolist(), strict=True):
            forces_n[motor] += winding * force_n
        return [self._radius_m * force_n for force_n in forces_n]

    def set_payload(self, payload_g: float) -> None:
        """Attach a point mass to the centre of the last disk."""
        self._model.body_mass[self._tip] = payload_g * _KG_PER_G
        # On scratch data, as mj_setConst leaves its data in the straight pose.
        mujoco.mj_setConst(self._model, mujoco.MjData(self._model))

    def push(self, force_n: tuple[float, float, float]) -> None:
        """Set the force on the centre of the last disk, in the frame of (10)."""
        self._data.xfrc_applied[self._tip, :3] = force_n

    def advance(self, steps: int) -> None:
        """Simulate some steps of ``step_us``.

        Raises:
            CcrError: the simulation became unstable.
        """
        last_step = self._steps_done + steps
        while self._next_update <= last_step:
            self._step(self._next_update - self._steps_done)
            # At once, as reading the markers moves the positions on to the new state.
            for every, memory in self._memories:
                if self._steps_done % every == 0:
                    memory.update(every * self.step_us * 1e-6)
            self._find_next_update()
        if self._steps_done < last_step:
            self._step(last_step - self._steps_done)

    def _find_next_update(self) -> None:
        done = self._steps_done
        due = (done - done % every + every for every, _ in self._memories)
        self._next_update = min(due, default=_NEVER)

    def _step(self, steps: int) -> None:
        mujoco.mj_step(self._model, self._data, nstep=steps)
        self._steps_done += steps
        parts = self._joints * self._per_bound
        if not parts.dot(parts) < 1.0:
            self._check_bounds()

    def _check_bounds(self) -> None:
        outside = ~(np.abs(self._joints) * self._per_bound < 1.0)
        if not outside.any():
            return
        if (self._model.jnt_type[outside] == mujoco.mjtJoint.mjJNT_SLIDE).all():
            raise CcrError(
                "the load shortens a part of the twin's backbone by half",
                "raise twin.axial_stiffness_n_m, or lower the load or twin.tendon_force_max_n",
            )
        raise CcrError(
            f"the twin became unstable at a step of {self.step_us / 1000:g} ms",
            "raise twin.joint_damping, or lower twin.time_step_ms, the load or the stiffness",
        )

    def markers_mm(self) -> Array:
        """Positions of M1 and the marker at the end of each of S segments, (S + 1, 3)."""
        return self._site_positions_mm(self._markers)

    def backbone_mm(self) -> Array:
        """Centres of the disks from base to tip, (1 + flexures, 3)."""
        return self._site_positions_mm(self._disks)

    def _site_positions_mm(self, sites: list[int]) -> Array:
        # mj_step leaves positions one step behind the state.
        mujoco.mj_kinematics(self._model, self._data)
        positions: Array = self._data.site_xpos[sites] * _MM_PER_M
        return positions

    def _settle(self) -> None:
        """Simulate until rest, with extra damping and without friction."""
        model = self._model
        damping, friction = model.dof_damping.copy(), model.tendon_frictionloss.copy()
        model.dof_damping[:] = model.jnt_stiffness * _SETTLE_DAMPING_S
        model.tendon_frictionloss[:] = 0.0
        for _ in range(round(_SETTLE_LIMIT_S * 1e6 / self.step_us / _SETTLE_CHUNK_STEPS)):
            try:
                self.advance(_SETTLE_CHUNK_STEPS)
            except CcrError as error:
                raise UnfitTwinError(error.cause, error.cure) from None
            if np.abs(self._data.qvel).max() < _SETTLED_RAD_S:
                break
        else:
            raise UnfitTwinError(
                f"the twin did not come to rest within {_SETTLE_LIMIT_S:g} s",
                "raise twin.bending_stiffness_nm_rad, lower the masses or shorten the segments",
            )
        model.dof_damping[:], model.tendon_frictionloss[:] = damping, friction

    def _choose_step_us(self) -> int:
        """``time_step_ms``, or the longest stable step if that is shorter, us."""
        wanted_us = max(1, round(self._twin.time_step_ms * 1000))
        at_rest = self._model.jnt_stiffness.copy()
        self._model.jnt_stiffness[:] *= 1.0 + sum(self._twin.creep_share)
        limit_s = linear_step_limit_s(self._model, self._data, self._twin.tendon_stiffness_n_m)
        self._model.jnt_stiffness[:] = at_rest
        stable_us = int(_STABLE_SHARE * limit_s * 1e6)
        step_us = min(wanted_us, max(stable_us, _SHORTEST_STEP_US))
        if step_us > stable_us:
            raise UnfitTwinError(
                f"this twin needs time steps below {_SHORTEST_STEP_US} us",
                "lower twin.tendon_stiffness_n_m, twin.bending_stiffness_nm_rad or twin.flexures, "
                "or raise twin.disk_mass_g",
            )
        return step_us
