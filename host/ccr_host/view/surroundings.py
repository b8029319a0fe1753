"""What stands still around the robot: its base, the desired path, a scale, the axes."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from viser import SceneApi

from ccr_host.config import Description
from ccr_host.robot.reference import Reference
from ccr_host.view import palette

FloatArray = NDArray[np.float64]

SCENE_UNIT_MM = 100.0
"""The browser's camera and lights expect things of about one unit."""
_FLOOR_MM = -70.0
_GRID_MM = 200.0
_GRID_CENTRE_Y_MM = -50.0
_CELL_MM = 10.0
_AXIS_MM = 30.0
_AXES_AT_MM = np.array((-0.1 * _GRID_MM, _GRID_CENTRE_Y_MM - 0.5 * _GRID_MM, _FLOOR_MM))
"""Off the robot, on the edge of the floor before the camera."""
_BASE_MM = (40.0, 4.0, 46.0)


def joined(points_mm: FloatArray) -> NDArray[np.float32]:
    """Segments between consecutive points in scene units, (N, 3) -> (N - 1, 2, 3)."""
    points = (points_mm / SCENE_UNIT_MM).astype(np.float32)
    return np.stack([points[:-1], points[1:]], axis=1)


def draw_surroundings(scene: SceneApi, description: Description) -> None:
    """Base plate, floor with a grid of 10 mm, axes of (10)."""
    scene.set_up_direction("+z")
    base_z_mm = -description.robot.marker_offset_mm
    scene.add_box(
        "/base",
        palette.DESIRED,
        np.array(_BASE_MM) / SCENE_UNIT_MM,
        position=np.array((0.0, _BASE_MM[1] / 2, base_z_mm)) / SCENE_UNIT_MM,
        opacity=0.6,
    )
    scene.add_grid(
        "/floor",
        width=_GRID_MM / SCENE_UNIT_MM,
        height=_GRID_MM / SCENE_UNIT_MM,
        cell_size=_CELL_MM / SCENE_UNIT_MM,
        section_size=5 * _CELL_MM / SCENE_UNIT_MM,
        position=np.array((0.0, _GRID_CENTRE_Y_MM, _FLOOR_MM)) / SCENE_UNIT_MM,
    )
    _draw_axes(scene)


def draw_desired(scene: SceneApi, reference: Reference) -> None:
    """The path, its unreachable parts in a colour of their own."""
    segments = joined(reference.target_mm)
    reachable = reference.reachable[:-1] & reference.reachable[1:]
    for name, chosen, colour in (
        ("/path/reachable", reachable, palette.DESIRED),
        ("/path/unreachable", ~reachable, palette.UNREACHABLE),
    ):
        scene.add_line_segments(
            name, segments[chosen], colour, thickness=3, thickness_units="screen"
        )


def _draw_axes(scene: SceneApi) -> None:
    """Axes as the trajectories name them: y is f[0], x is f[1], z is f[2]."""
    scene.add_label(
        "/axes/scale",
        f"grid {_CELL_MM:g} mm",
        position=(_AXES_AT_MM - np.array((0.0, 0.0, 6.0))) / SCENE_UNIT_MM,
        font_screen_scale=0.8,
    )
    for column, (name, direction) in enumerate(
        (("y", (1.0, 0.0, 0.0)), ("x", (0.0, 1.0, 0.0)), ("z", (0.0, 0.0, 1.0)))
    ):
        end_mm = _AXES_AT_MM + _AXIS_MM * np.array(direction)
        scene.add_arrows(
            f"/axes/{name}",
            np.stack([_AXES_AT_MM, end_mm])[None] / SCENE_UNIT_MM,
            palette.AXES[column],
            shaft_radius=0.008,
            head_radius=0.02,
            head_length=0.05,
        )
        scene.add_label(
            f"/axes/{name}/name",
            name,
            position=(end_mm + 6.0 * np.array(direction)) / SCENE_UNIT_MM,
            anchor="center-center",
        )
