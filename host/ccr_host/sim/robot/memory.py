"""What the structure remembers of its past: friction of the tendons in their holes, and creep.

MuJoCo knows neither. Both states are slow beside its steps, so they are brought up to date every
few steps, and MuJoCo applies their forces in between.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol

import mujoco
import numpy as np

from ccr_host.core.arrays import Array
from ccr_host.description.simulation import Twin

_PART_OF_TIME = 0.02
"""Period of creep over its shortest time constant: the creep comes late by half of that."""
_ONES = np.ones(3)
_PRESLIDING_M = 1e-4
"""Travel in which a reversed tendon gives up 63 % of its stuck state; assumed: stiff tendons in
printed holes have between some micrometres and a tenth of a millimetre."""
_DAMPED_S = 4e-3
"""Damping over stiffness of stuck holes, two periods of their updates. Their force follows its
travel with about one period's delay, which alone would feed fast vibrations."""


class Memory(Protocol):
    """A state that the mechanics brings up to date at regular times."""

    @property
    def period_us(self) -> int:
        """Longest time between two updates."""

    def start(self) -> None:
        """Begin at the present pose, at rest."""

    def update(self, elapsed_s: float) -> None:
        """Follow the pose, ``elapsed_s`` after the previous update."""


def memories(
    twin: Twin, model: mujoco.MjModel, data: mujoco.MjData, slack_lengths_m: list[float]
) -> list[Memory]:
    """The states that this twin has, in the order of their updates."""
    found: list[Memory] = []
    if twin.capstan_friction > 0:
        found.append(CapstanFriction(twin.capstan_friction, model, data, slack_lengths_m))
    if max(twin.creep_share) > 0:
        found.append(Creep(twin.creep_share, twin.creep_time_s, model, data))
    return found


class CapstanFriction:
    """Loss of tension in each hole by ``exp(-mu angle z)``.

    ``angle`` is that by which the tendon turns in the hole. ``z`` from -1 to 1 is the direction
    in which it slid last, positive towards the base; after a reversal it changes over
    `_PRESLIDING_M` of travel (Dahl's model), which makes hysteresis loops with memory.

    In MuJoCo each span between two holes is a branch of its tendon, behind a pulley whose divisor
    sets the branch's share of the force at the base. The actuator then measures the weighted sum of
    the spans' lengths; ``slack_lengths_m`` and the controls are shifted by its difference from the
    true length. With all shares 1 this is the tendon without friction. The model's shares and
    damping are set here; the controls in ``data`` and the lengths are shifted in place.
    """

    period_us = 2000

    def __init__(
        self,
        coefficient: float,
        model: mujoco.MjModel,
        data: mujoco.MjData,
        slack_lengths_m: list[float],
    ) -> None:
        self._sites_m = data.site_xpos
        self._joints = data.qpos
        self._controls_m = data.ctrl
        self._forces_n = data.actuator_force
        self._divisors = model.wrap_prm
        self._damping = model.dof_damping
        self._slack_lengths_m = slack_lengths_m
        self._pulleys = np.flatnonzero(model.wrap_type == mujoco.mjtWrap.mjWRAP_PULLEY)
        self._tendon = np.searchsorted(model.tendon_adr, self._pulleys, side="right") - 1
        spans = np.arange(len(self._pulleys))
        same = self._tendon[:, None] == self._tendon
        self._up_to_here = (same & (spans <= spans[:, None])).astype(np.float64)
        self._from_here_on = self._up_to_here.T.copy()
        self._by_tendon = (self._tendon == np.arange(model.ntendon)[:, None]).astype(np.float64)
        self._starts = model.wrap_objid[self._pulleys + 1]
        self._ends = model.wrap_objid[self._pulleys + 2]
        self._turns = coefficient * self._turns_by_joint(model)
        self._undamped = model.dof_damping.copy()
        self._damping_by_hole = self._bound_of_damping(model, data)
        self._stuck = np.zeros(len(spans))
        self._beyond_m = np.zeros(len(spans))
        self._shifts_m = np.zeros(model.ntendon)

    def start(self) -> None:
        """Begin with all tendons as if they had never slid."""
        self._beyond_m = self._from_here_on @ self._lengths_m()

    def update(self, elapsed_s: float) -> None:
        """Follow the tendons' travel through their holes."""
        lengths_m = self._lengths_m()
        beyond_m = self._from_here_on @ lengths_m
        travel_m = self._beyond_m - beyond_m
        self._beyond_m = beyond_m
        side = np.sign(travel_m)
        kept = np.exp(np.abs(travel_m) * (-1.0 / _PRESLIDING_M))
        stuck = side + kept * (self._stuck - side)
        self._stuck = stuck
        turns = self._turns @ self._joints
        turns *= turns
        slopes = np.sqrt(turns[: len(stuck)] + turns[len(stuck) :])
        divisors = np.exp(self._up_to_here @ (slopes * stuck))
        self._divisors[self._pulleys] = divisors
        shifts_m = self._by_tendon @ (lengths_m / divisors - lengths_m)
        change_m = shifts_m - self._shifts_m
        self._shifts_m = shifts_m
        self._controls_m += change_m
        for tendon, by_m in enumerate(change_m.tolist()):
            self._slack_lengths_m[tendon] += by_m
        # A hole that slides on does not resist more; one that turns back does, as a spring.
        resisting_n = self._forces_n[self._tendon] * slopes / divisors * (side * stuck - 1.0)
        self._damping[:] = self._undamped + self._damping_by_hole @ resisting_n

    def _lengths_m(self) -> Array:
        spans_m = self._sites_m.take(self._ends, 0) - self._sites_m.take(self._starts, 0)
        spans_m *= spans_m
        lengths_m: Array = np.sqrt(spans_m @ _ONES)
        return lengths_m

    def _turns_by_joint(self, model: mujoco.MjModel) -> Array:
        """Angle of each hole's turn by the joints, about x and then z of its disk.

        (2 spans, joints).

        A flexure tilts the span across it by half its angle against either disk, wherever the
        tendon runs.
        """
        flexure = model.jnt_bodyid - model.jnt_bodyid.min() + 1
        is_hinge = model.jnt_type == mujoco.mjtJoint.mjJNT_HINGE
        first = np.searchsorted(self._tendon, self._tendon)
        hole = np.arange(len(self._tendon)) - first
        beside = (flexure == hole[:, None]) | (flexure == hole[:, None] + 1)
        about_x, _, about_z = 0.5 * np.where(is_hinge, model.jnt_axis.T, 0.0)
        return np.concatenate([beside * about_x, beside * about_z])

    def _bound_of_damping(self, model: mujoco.MjModel, data: mujoco.MjData) -> Array:
        """Damping of each joint by the force that resists in each hole, (joints, spans).

        With g the travel in a hole by the angles q of the m joints beyond it, (g q)^2 is at most
        m times the sum of (g_i q_i)^2: joints damped one by one dissipate at least as much.
        """
        spans_m = self._sites_m[self._ends] - self._sites_m[self._starts]
        directions = spans_m / self._lengths_m()[:, None]
        by_site = np.zeros((model.nsite, 3, model.nv))
        for site, jacobian in enumerate(by_site):
            mujoco.mj_jacSite(model, data, jacobian, None, site)
        by_span = np.einsum("si,sij->sj", directions, by_site[self._ends] - by_site[self._starts])
        travel = self._from_here_on @ by_span
        joints_beyond = np.count_nonzero(travel, axis=1)
        bound: Array = _DAMPED_S / _PRESLIDING_M * (travel.T**2 * joints_beyond)
        return bound


class Creep:
    """Viscoelastic joints: branches of a spring and a damper in series beside each spring.

    A branch adds ``share`` of the joint's stiffness at first, and nothing after some times its time
    constant (a standard linear solid, for several branches a generalised Maxwell body). Time
    constants hold at constant deflection. The model's stiffness becomes that of a fast motion; the
    forces are applied here.
    """

    def __init__(
        self,
        shares: Sequence[float],
        times_s: Sequence[float],
        model: mujoco.MjModel,
        data: mujoco.MjData,
    ) -> None:
        self._shares = np.array(shares)
        self._times_s = np.array(times_s)
        self.period_us = round(_PART_OF_TIME * min(times_s) * 1e6)
        self._model = model
        self._joints = data.qpos
        self._forces_nm = data.qfrc_applied
        self._stiffness = model.jnt_stiffness.copy()
        self._relaxed = np.zeros((len(shares), model.nv))

    def start(self) -> None:
        """Begin with all branches relaxed."""
        self._model.jnt_stiffness[:] = self._stiffness * (1.0 + self._shares.sum())
        self._relaxed[:] = self._joints
        self._apply()

    def update(self, elapsed_s: float) -> None:
        """Relax all branches towards the present pose."""
        gone = -np.expm1(-elapsed_s / self._times_s)
        self._relaxed += gone[:, None] * (self._joints - self._relaxed)
        self._apply()

    def _apply(self) -> None:
        self._forces_nm[:] = self._stiffness * (self._shares @ self._relaxed)
