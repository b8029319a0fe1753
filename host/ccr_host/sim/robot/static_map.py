"""The twin's static map: rest position of the tip over the motor angles."""

from __future__ import annotations

import hashlib
import math
import os
import zipfile
from collections import deque
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ccr_host.core.user_file import replacing
from ccr_host.description.simulation import Twin
from ccr_host.sim.robot.equilibrium import LONGEST_LEG_RAD, Equilibrium

Array = NDArray[np.float64]

GRID_STEP_DEG = 1.0
"""Floors on this grid are 0.4 to 3 % above the limit of finer grids (docs/twin.md)."""

_MAP_VERSION = 3
"""Part of the cache key; increment it when the map of the same twin changes."""

_MOST_KEPT = 100
"""Files of a kind: a map has 0.7 MB."""


@dataclass(frozen=True)
class StaticMap:
    """Rest positions of the tip over a regular grid of motor angles.

    ``axis_1_rad`` (A,), ``axis_2_rad`` (B,), ``tip_mm`` (A, B, 3): M3 - M1, the f of (10).
    """

    axis_1_rad: Array
    axis_2_rad: Array
    tip_mm: Array


def compute_static_map(
    twin: Twin, lower_deg: Array, upper_deg: Array, step_deg: float = GRID_STEP_DEG
) -> StaticMap:
    """Rest positions over a grid that covers the motor limits, (2,) each.

    Raises:
        CcrError: no rest pose was found for some motor angles.
    """
    axis_1, axis_2 = (
        np.radians(np.linspace(low, high, 1 + math.ceil((high - low) / step_deg)))
        for low, high in zip(lower_deg, upper_deg, strict=True)
    )
    equilibrium = Equilibrium(twin)
    is_fine = axis_2[1] - axis_2[0] <= LONGEST_LEG_RAD
    tip_mm = np.empty((len(axis_1), len(axis_2), 3))
    # Alternating directions, so that each search starts close to its solution.
    for row, motor_1_rad in enumerate(axis_1):
        columns = range(len(axis_2)) if row % 2 == 0 else range(len(axis_2) - 1, -1, -1)
        poses_rad: deque[Array] = deque(maxlen=3)
        for column in columns:
            if is_fine and len(poses_rad) == poses_rad.maxlen:
                equilibrium.joints_rad = _extrapolated(*poses_rad)
            tip_mm[row, column] = equilibrium.tip_mm((motor_1_rad, axis_2[column]))
            poses_rad.append(equilibrium.joints_rad)
    return StaticMap(axis_1, axis_2, tip_mm)


def load_static_map(
    twin: Twin,
    lower_deg: Array,
    upper_deg: Array,
    cache: Path | None,
    step_deg: float = GRID_STEP_DEG,
) -> StaticMap:
    """The static map from the cache folder; computed and stored there if missing.

    A cache that cannot be read or written is ignored.

    Args:
        twin: the ``twin`` section of the robot description.
        lower_deg: lower motor limits, (2,).
        upper_deg: upper motor limits, (2,).
        cache: folder for the maps; None disables the cache.
        step_deg: step of the grid.

    Raises:
        CcrError: no rest pose was found for some motor angles.
    """
    key = (
        _MAP_VERSION,
        twin.model_dump_json(include=set(STATIC_KEYS)),
        np.asarray(lower_deg, dtype=np.float64).tolist(),
        np.asarray(upper_deg, dtype=np.float64).tolist(),
        step_deg,
    )
    compute = partial(compute_static_map, twin, lower_deg, upper_deg, step_deg)
    return StaticMap(**kept_arrays(cache, "static-map", key, lambda: vars(compute())))


def kept_arrays(
    cache: Path | None, name: str, key: object, compute: Callable[[], dict[str, Array]]
) -> dict[str, Array]:
    """Arrays from the cache folder; computed and stored there if they are missing.

    Args:
        cache: folder; None computes without storing.
        name: start of the file's name.
        key: all that the arrays depend on, by its representation.
        compute: makes them.
    """
    if cache is None:
        return compute()
    file = cache / f"{name}-{hashlib.sha256(repr(key).encode()).hexdigest()[:16]}.npz"
    kept = _read(file)
    if kept is not None:
        return kept
    found = compute()
    _write(file, name, found)
    return found


def default_cache() -> Path:
    """Folder for results that can be recomputed."""
    return Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "ccr-host"


def _extrapolated(before_last: Array, last: Array, here: Array) -> Array:
    """Quadratic extrapolation of three equally spaced poses by one step."""
    return 3 * (here - last) + before_last


def _read(file: Path) -> dict[str, Array] | None:
    try:
        with np.load(file) as kept:
            return dict(kept)
    except (OSError, ValueError, EOFError, RuntimeError, zipfile.BadZipFile):
        return None


def _write(file: Path, name: str, found: dict[str, Any]) -> None:
    with suppress(OSError):
        file.parent.mkdir(parents=True, exist_ok=True)
        with replacing(file) as draft, draft.open("wb") as opened:
            np.savez(opened, **found)
        kept = sorted(file.parent.glob(f"{name}-*.npz"), key=lambda one: one.stat().st_mtime)
        for oldest in kept[:-_MOST_KEPT]:
            oldest.unlink()


STATIC_KEYS = (
    "segments", "flexures", "segment_lengths_mm", "tendon_radius_mm", "marker_offset_mm",
    "pulley_radius_mm",
    "bending_stiffness_nm_rad", "disk_mass_g", "marker_mass_g", "payload_g", "payload_start_s",
    "slack_mm", "tendon_stiffness_n_m", "tendon_force_max_n", "gravity_m_s2", "axial_stiffness_n_m",
    "stiffness_taper", "stiffening", "bending_plane_turn_deg", "sideways_stiffness_nm_rad",
    "torsion_stiffness_nm_rad",
)  # fmt: skip
"""Keys that a rest pose depends on."""
