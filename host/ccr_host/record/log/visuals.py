"""What a run looks like, as messages that Foxglove draws. Metres, in the frame ``robot``.

``robot`` is the frame of (10): origin in marker 1, z up.
"""

from __future__ import annotations

from itertools import pairwise
from typing import Any

import numpy as np

from ccr_host.core.arrays import Array
from ccr_host.robot.reference import Reference

Json = dict[str, Any]

ROBOT_FRAME = "robot"
INFO, WARNING = 2, 3
"""Levels of ``foxglove.Log``."""

_DECIMALS = 5
"""Hundredths of a millimetre: below what any eye sees, and short."""
_LINE_STRIP, _LINE_LIST = 0, 2
_PRIMITIVES = (
    "arrows", "cubes", "spheres", "cylinders", "lines", "triangles", "texts", "models",
)  # fmt: skip
_PATH_POINTS_MAX = 2000
UPRIGHT: Json = {"x": 0.0, "y": 0.0, "z": 0.0, "w": 1.0}
_ORIGIN: Json = {"position": {"x": 0.0, "y": 0.0, "z": 0.0}, "orientation": UPRIGHT}
_FOR_GOOD: Json = {"sec": 0, "nsec": 0}
_MARKER_M = {"x": 0.004, "y": 0.004, "z": 0.004}
_GREY: Json = {"r": 0.5, "g": 0.5, "b": 0.5, "a": 1.0}
_BLUE: Json = {"r": 0.12, "g": 0.38, "b": 0.78, "a": 1.0}
_RED: Json = {"r": 0.84, "g": 0.15, "b": 0.16, "a": 1.0}
_GREEN: Json = {"r": 0.17, "g": 0.63, "b": 0.17, "a": 1.0}
_ORANGE: Json = {"r": 1.0, "g": 0.5, "b": 0.05, "a": 1.0}


def stamp(time_us: int) -> Json:
    """A time as Foxglove writes it."""
    return {"sec": time_us // 1_000_000, "nsec": time_us % 1_000_000 * 1000}


PHASE = "phase"
"""Name of the log messages that tell of phases; all others bear the program's."""


def log_message(time_us: int, level: int, text: str, name: str = "ccr-host") -> Json:
    """``foxglove.Log``."""
    return {
        "timestamp": stamp(time_us),
        "level": level,
        "message": text,
        "name": name,
        "file": "",
        "line": 0,
    }


def pose(time_us: int, position_mm: Array) -> Json:
    """``foxglove.PoseInFrame`` of a point, (3,)."""
    return {
        "timestamp": stamp(time_us),
        "frame_id": ROBOT_FRAME,
        "pose": {"position": _points(position_mm[None])[0], "orientation": UPRIGHT},
    }


def transforms(time_us: int, positions_mm: dict[str, Array]) -> Json:
    """``foxglove.FrameTransforms``: frames at points, (3,), of the robot's frame, by name."""
    return {
        "transforms": [
            {
                "timestamp": stamp(time_us),
                "parent_frame_id": ROBOT_FRAME,
                "child_frame_id": name,
                "translation": _points(position_mm[None])[0],
                "rotation": UPRIGHT,
            }
            for name, position_mm in positions_mm.items()
        ]
    }


def desired_path(time_us: int, reference: Reference) -> Json:
    """``foxglove.SceneUpdate``: the path, what cannot be reached of it in red."""
    stride = -(-len(reference) // _PATH_POINTS_MAX)
    points = _points(reference.target_mm[::stride])
    reachable = reference.reachable[::stride].tolist()
    pairs = [point for pair in pairwise(points) for point in pair]
    colors = [
        _GREY if both else _RED
        for before, after in pairwise(reachable)
        for both in (before and after,) * 2
    ]
    line = _line(pairs, _GREY, thickness_px=2.0, kind=_LINE_LIST) | {"colors": colors}
    return _scene([_entity(time_us, "desired path", lines=[line])])


def robot(time_us: int, backbone_mm: Array, horizon_mm: Array, markers_mm: Array | None) -> Json:
    """``foxglove.SceneUpdate``.

    Args:
        time_us: of the scene.
        backbone_mm: (n, 3), of the model at the commanded angles.
        horizon_mm: (k, 3), the predicted tip.
        markers_mm: (3, 3) as measured, seen from M1; rows of NaN are left out.
    """
    entities = [
        _entity(time_us, "backbone", lines=[_line(_points(backbone_mm), _BLUE, thickness_px=6.0)]),
        _entity(time_us, "horizon", lines=[_line(_points(horizon_mm), _GREEN, thickness_px=3.0)]),
    ]
    if markers_mm is not None:
        seen = markers_mm[np.isfinite(markers_mm).all(axis=1)]
        entities.append(_entity(time_us, "markers", spheres=[_sphere(p) for p in _points(seen)]))
    return _scene(entities)


def diagnostics(time_us: int, statuses: list[Json]) -> Json:
    """``diagnostic_msgs/DiagnosticArray``."""
    header = {"seq": 0, "stamp": stamp(time_us), "frame_id": ""}
    return {"header": header, "status": statuses}


def diagnostic(name: str, level: int, message: str, values: dict[str, object]) -> Json:
    """``diagnostic_msgs/DiagnosticStatus``; level 0 ok, 1 warning, 2 error."""
    return {
        "level": level,
        "name": name,
        "message": message,
        "hardware_id": "",
        "values": [{"key": key, "value": str(value)} for key, value in values.items()],
    }


def _points(positions_mm: Array) -> list[Json]:
    rows = np.round(positions_mm * 1e-3, _DECIMALS).tolist()
    return [{"x": x, "y": y, "z": z} for x, y, z in rows]


def _sphere(point: Json) -> Json:
    return {
        "pose": {"position": point, "orientation": UPRIGHT}, "size": _MARKER_M, "color": _ORANGE
    }  # fmt: skip


def _line(points: list[Json], color: Json, thickness_px: float, kind: int = _LINE_STRIP) -> Json:
    return {
        "type": kind,
        "pose": _ORIGIN,
        "thickness": thickness_px,
        "scale_invariant": True,
        "points": points,
        "color": color,
        "colors": [],
        "indices": [],
    }


def _entity(time_us: int, name: str, **primitives: list[Json]) -> Json:
    return {
        "timestamp": stamp(time_us),
        "frame_id": ROBOT_FRAME,
        "id": name,
        "lifetime": _FOR_GOOD,
        "frame_locked": False,
        "metadata": [],
        **{kind: [] for kind in _PRIMITIVES},
        **primitives,
    }


def _scene(entities: list[Json]) -> Json:
    return {"deletions": [], "entities": entities}
