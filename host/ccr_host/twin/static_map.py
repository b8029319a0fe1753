"""Where the twin rests for every pair of motor angles.

Rest is a root of MuJoCo's generalised forces at zero velocity, dry friction left out: with friction
the rest pose depends on where the robot came from, and no single map exists.
"""

from __future__ import annotations

import hashlib
import math
import os
from dataclasses import dataclass
from pathlib import Path

import mujoco
import numpy as np
from numpy.typing import NDArray

from ccr_host.config import Twin
from ccr_host.errors import CcrError
from ccr_host.twin.mjcf import MARKERS, TIP, robot_mjcf

Array = NDArray[np.float64]

GRID_STEP_DEG = 1.0
"""Bilinear cells of this size are good to about 0.03 mm away from the kinks of the map."""

_MAP_VERSION = 1
"""Part of the cache's key; raise it when the map of the same twin changes."""
_MM_PER_M = 1e3
_KG_PER_G = 1e-3
_PROBE_RAD = 1e-6
_REST_NM = 1e-9
"""A millionth of the moment that bends a segment by a degree."""
_LONGEST_LEG_RAD = math.radians(5.0)
"""Newton's method finds the next rest pose safely over so much of motor angle."""
_NEWTON_LIMIT = 60
_LONGEST_STEP_RAD = 0.2
_SHORTEST_SHARE = 1e-3


@dataclass(frozen=True)
class StaticMap:
    """Rest positions of the tip over a regular grid of motor angles.

    ``axis_1_rad`` (A,), ``axis_2_rad`` (B,), ``tip_mm`` (A, B, 3): M3 - M1, the f of (10).
    """

    axis_1_rad: Array
    axis_2_rad: Array
    tip_mm: Array


class Equilibrium:
    """Rest poses of one twin, each found from the one before.

    Args:
        twin: the ``twin`` section of the robot description.
    """

    def __init__(self, twin: Twin) -> None:
        self._radius_m = twin.pulley_radius_mm / _MM_PER_M
        self._model = mujoco.MjModel.from_xml_string(robot_mjcf(twin))
        self._model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONSTRAINT
        self._data = mujoco.MjData(self._model)
        mujoco.mj_forward(self._model, self._data)
        self._slack_lengths_m = self._data.ten_length + twin.slack_mm / _MM_PER_M
        self._markers = [self._model.site(MARKERS[0]).id, self._model.site(MARKERS[2]).id]
        if twin.payload_start_s == 0:
            self._model.body_mass[self._model.body(TIP).id] = twin.payload_g * _KG_PER_G
            mujoco.mj_setConst(self._model, mujoco.MjData(self._model))
        self.joints_rad = np.zeros(self._model.nv)
        """Bending of each flexure, where the next search starts."""
        self.motor_rad = np.zeros(2)
        """Motor angles that belong to it."""

    def tip_mm(self, motor_1_rad: float, motor_2_rad: float) -> Array:
        """Rest position of the tip, (3,).

        Raises:
            CcrError: no rest pose was found.
        """
        there = np.array((motor_1_rad, motor_2_rad))
        here = self.motor_rad
        legs = max(1, math.ceil(np.abs(there - here).max() / _LONGEST_LEG_RAD))
        for leg in range(1, legs + 1):
            wound_m = self._radius_m * (here + leg / legs * (there - here))
            self._data.ctrl[:] = self._slack_lengths_m - np.concatenate([wound_m, -wound_m])
            self.joints_rad = self._rest(self.joints_rad)
        self.motor_rad = there
        base, tip = self._data.site_xpos[self._markers]
        position: Array = (tip - base) * _MM_PER_M
        return position

    def _forces_nm(self, joints_rad: Array) -> Array:
        self._data.qpos[:] = joints_rad
        mujoco.mj_forward(self._model, self._data)
        forces: Array = self._data.qfrc_smooth.copy()
        return forces

    def _rest(self, joints_rad: Array) -> Array:
        """Newton's method, shortened until the forces shrink."""
        forces = self._forces_nm(joints_rad)
        size = np.abs(forces).max()
        for _ in range(_NEWTON_LIMIT):
            if size < _REST_NM:
                return joints_rad
            step = -np.linalg.solve(self._stiffness(joints_rad, forces), forces)
            share = min(1.0, _LONGEST_STEP_RAD / np.abs(step).max())
            while True:
                trial = joints_rad + share * step
                trial_forces = self._forces_nm(trial)
                trial_size = np.abs(trial_forces).max()
                if trial_size < size or share < _SHORTEST_SHARE:
                    break
                share *= 0.5
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


def compute_static_map(
    twin: Twin, lower_deg: Array, upper_deg: Array, step_deg: float
) -> StaticMap:
    """Rest positions over a grid that covers the motor limits, (2,) each.

    Raises:
        CcrError: some motor angles leave the twin without a rest pose.
    """
    axis_1, axis_2 = (
        np.radians(np.linspace(low, high, 1 + math.ceil((high - low) / step_deg)))
        for low, high in zip(lower_deg, upper_deg, strict=True)
    )
    equilibrium = Equilibrium(twin)
    tip_mm = np.empty((len(axis_1), len(axis_2), 3))
    # There and back, so that each search starts next to its solution.
    for row, motor_1_rad in enumerate(axis_1):
        columns = range(len(axis_2)) if row % 2 == 0 else range(len(axis_2) - 1, -1, -1)
        for column in columns:
            tip_mm[row, column] = equilibrium.tip_mm(motor_1_rad, axis_2[column])
    return StaticMap(axis_1, axis_2, tip_mm)


def load_static_map(
    twin: Twin,
    lower_deg: Array,
    upper_deg: Array,
    cache: Path | None,
    step_deg: float = GRID_STEP_DEG,
) -> StaticMap:
    """The static map from the cache folder, or computed and left there.

    Args:
        twin: the ``twin`` section of the robot description.
        lower_deg: of the motor angles, (2,).
        upper_deg: of the motor angles, (2,).
        cache: folder that keeps the maps; None computes without keeping.
        step_deg: of the grid.
    """
    if cache is None:
        return compute_static_map(twin, lower_deg, upper_deg, step_deg)
    file = cache / f"static-map-{_key(twin, lower_deg, upper_deg, step_deg)}.npz"
    if file.exists():
        with np.load(file) as kept:
            return StaticMap(kept["axis_1_rad"], kept["axis_2_rad"], kept["tip_mm"])
    found = compute_static_map(twin, lower_deg, upper_deg, step_deg)
    cache.mkdir(parents=True, exist_ok=True)
    unfinished = file.with_name(f"{file.stem}-{os.getpid()}.npz")
    np.savez(unfinished, **vars(found))
    unfinished.replace(file)
    return found


def default_cache() -> Path:
    """Folder for what can be computed again."""
    return Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "ccr-host"


_STATIC_KEYS = (
    "flexures", "segment_lengths_mm", "tendon_radius_mm", "marker_offset_mm", "pulley_radius_mm",
    "bending_stiffness_nm_rad", "disk_mass_g", "marker_mass_g", "payload_g", "payload_start_s",
    "slack_mm", "tendon_stiffness_n_m", "tendon_force_max_n", "gravity_m_s2",
)  # fmt: skip
"""What a rest pose depends on."""


def _key(twin: Twin, lower_deg: Array, upper_deg: Array, step_deg: float) -> str:
    content = (
        _MAP_VERSION,
        twin.model_dump_json(include=set(_STATIC_KEYS)),
        np.asarray(lower_deg, dtype=np.float64).tolist(),
        np.asarray(upper_deg, dtype=np.float64).tolist(),
        step_deg,
    )
    return hashlib.sha256(repr(content).encode()).hexdigest()[:16]
