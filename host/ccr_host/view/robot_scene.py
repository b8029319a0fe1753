"""The robot in three dimensions: model, measurement, markers, disks, horizon and trail."""

from __future__ import annotations

import numpy as np
import trimesh
from numpy.typing import NDArray
from viser import BatchedMeshHandle, IcosphereHandle, LineSegmentsHandle, SceneApi

from ccr_host.core.arrays import Array
from ccr_host.description.robot import Robot
from ccr_host.description.schema import Description
from ccr_host.robot.backbone import (
    fitted_bending_rad,
    marker_feet_mm,
    measured_backbone_mm,
    turns_to,
)
from ccr_host.robot.kinematics import ConstantCurvature
from ccr_host.robot.reference import Reference
from ccr_host.run.observer import RunSetup
from ccr_host.view import palette
from ccr_host.view.history import Moment

SCENE_UNIT_MM = 100.0
"""The browser's camera and lights expect things of about one unit."""
_FLOOR_MM = -70.0
_GRID_MM = 200.0
_GRID_CENTRE_Y_MM = -50.0
_CELL_MM = 10.0
_AXIS_MM = 30.0
_AXES_AT_MM = np.array((-0.1 * _GRID_MM, _GRID_CENTRE_Y_MM - 0.5 * _GRID_MM, _FLOOR_MM))
"""Off the robot, on the edge of the floor before the camera."""
_USUAL_LENGTH_MM = 102.0
"""Length of the robot for which these are made."""
_BASE_MM = (40.0, 4.0, 46.0)


def scale_of(robot: Robot) -> float:
    """How much larger floor and camera's distance have to be for a longer robot."""
    return max(1.0, sum(segment.length_mm for segment in robot.chain) / _USUAL_LENGTH_MM)


def joined(points_mm: Array) -> NDArray[np.float32]:
    """Segments between consecutive points in scene units, (N, 3) -> (N - 1, 2, 3)."""
    points = (points_mm / SCENE_UNIT_MM).astype(np.float32)
    return np.stack([points[:-1], points[1:]], axis=1)


def draw_surroundings(scene: SceneApi, description: Description) -> None:
    """Base plate, floor with a grid of 10 mm, axes of (10)."""
    scene.set_up_direction("+z")
    base_z_mm = -description.robot.marker_offset_mm
    scale = scale_of(description.robot)
    scene.add_box(
        "/base",
        palette.DESIRED,
        np.array(_BASE_MM) / SCENE_UNIT_MM,
        position=np.array((0.0, _BASE_MM[1] / 2, base_z_mm)) / SCENE_UNIT_MM,
        opacity=0.6,
    )
    scene.add_grid(
        "/floor",
        width=scale * _GRID_MM / SCENE_UNIT_MM,
        height=scale * _GRID_MM / SCENE_UNIT_MM,
        cell_size=_CELL_MM / SCENE_UNIT_MM,
        section_size=5 * _CELL_MM / SCENE_UNIT_MM,
        position=scale * np.array((0.0, _GRID_CENTRE_Y_MM, _FLOOR_MM)) / SCENE_UNIT_MM,
    )
    _draw_axes(scene, scale * _AXES_AT_MM)


def draw_desired(scene: SceneApi, reference: Reference) -> None:
    """The path, with its unreachable parts in another colour."""
    segments = joined(reference.target_mm)
    reachable = reference.reachable[:-1] & reference.reachable[1:]
    for name, chosen, colour in (
        ("/path/reachable", reachable, palette.DESIRED),
        ("/path/unreachable", ~reachable, palette.UNREACHABLE),
    ):
        scene.add_line_segments(
            name, segments[chosen], colour, thickness=3, thickness_units="screen"
        )


def _draw_axes(scene: SceneApi, at_mm: Array) -> None:
    """Axes as the trajectories name them: y is f[0], x is f[1], z is f[2]."""
    scene.add_label(
        "/axes/scale",
        f"grid {_CELL_MM:g} mm",
        position=(at_mm - np.array((0.0, 0.0, 6.0))) / SCENE_UNIT_MM,
        font_screen_scale=0.8,
    )
    for column, (name, direction) in enumerate(
        (("y", (1.0, 0.0, 0.0)), ("x", (0.0, 1.0, 0.0)), ("z", (0.0, 0.0, 1.0)))
    ):
        end_mm = at_mm + _AXIS_MM * np.array(direction)
        scene.add_arrows(
            f"/axes/{name}",
            np.stack([at_mm, end_mm])[None] / SCENE_UNIT_MM,
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


_TRAIL_POINTS = 1500
"""Longer trails show every second, third ... step."""
_DISK_MARGIN_MM = 2.0
"""Distance from the tendon holes to the rim of a disk."""
_DISK_THICKNESS_MM = 1.5
_MARKER_RADIUS_MM = 3.5
_TARGET_RADIUS_MM = 4.5
_BACKBONE_POINTS = 41
_NO_SEGMENTS = np.zeros((0, 2, 3), np.float32)


class RobotScene:
    """What stands still is drawn once; ``show`` and ``show_trail`` move the rest."""

    def __init__(self, scene: SceneApi, setup: RunSetup) -> None:
        self._model = ConstantCurvature(setup.description.robot)
        draw_surroundings(scene, setup.description)
        draw_desired(scene, setup.reference)
        plan = palette.of_controller(setup.options.controller)
        self.ideal = _line(scene, "/model", palette.MODEL, 5)
        """Where an ideal robot would be at the commanded angles; not shown at first."""
        self.ideal.visible = False
        self._measured = _line(scene, "/measured", palette.MEASURED, 6)
        self._stalks = _line(scene, "/markers/stalks", palette.MEASURED, 2)
        self._horizon = _line(scene, "/horizon", plan, 4)
        self._trail = scene.add_line_segments(
            "/trail", _NO_SEGMENTS, np.zeros((0, 2, 3), np.uint8), thickness=4,
            thickness_units="screen",
        )  # fmt: skip
        self._markers = [_add_marker(scene, name) for name in setup.description.robot.markers]
        radius = _TARGET_RADIUS_MM / SCENE_UNIT_MM
        self._target = scene.add_icosphere(
            "/target", radius, plan, subdivisions=1, wireframe=True, visible=False
        )
        self.disks = _add_disks(scene, setup.description)
        self._disk_points = np.linspace(
            0, _BACKBONE_POINTS - 1, len(self.disks.batched_positions) + 1
        ).round().astype(int)[1:]  # fmt: skip

    def show(self, moment: Moment) -> None:
        """Move robot, target and horizon to a moment."""
        board, straight_rad = moment.board, np.zeros(self._model.motors)
        commanded_rad = straight_rad if board is None else board.setpoint_rad
        backbone_mm = self._model.backbone_mm(commanded_rad, _BACKBONE_POINTS)
        self.ideal.points = joined(backbone_mm)
        for measured in (self._measured, self._stalks, *self._markers):
            measured.visible = moment.markers_mm is not None
        if moment.markers_mm is not None:
            start_rad = self._model.bending_rad(commanded_rad)
            backbone_mm = self._show_measured(moment.markers_mm, start_rad)
        self._place_disks(backbone_mm)
        self._horizon.points = joined(moment.horizon_mm) if len(moment.horizon_mm) else _NO_SEGMENTS
        self._target.visible = moment.record is not None
        if moment.record is not None:
            self._target.position = moment.record.target_mm / SCENE_UNIT_MM

    def show_trail(self, moment: Moment, full_scale_mm: float) -> None:
        """Draw where the tip was at the end of each step, coloured by its error."""
        stride = 1 + len(moment.trail_mm) // _TRAIL_POINTS
        segments = joined(moment.trail_mm[::stride])
        colours = palette.error_colours(moment.steps.error_mm[::stride], full_scale_mm)
        seen = np.isfinite(segments).all(axis=(1, 2))
        self._trail.colors = np.stack([colours[:-1], colours[1:]], axis=1)[seen]
        self._trail.points = segments[seen]

    def _show_measured(self, markers_mm: Array, start_rad: Array) -> Array:
        bending_rad = fitted_bending_rad(self._model, markers_mm, start_rad)
        backbone_mm = measured_backbone_mm(self._model, markers_mm, bending_rad, _BACKBONE_POINTS)
        self._measured.points = joined(backbone_mm)
        feet_mm = marker_feet_mm(self._model, markers_mm, bending_rad)
        stalks = np.stack([feet_mm, markers_mm], axis=1) / SCENE_UNIT_MM
        self._stalks.points = stalks.astype(np.float32)
        for marker, position_mm in zip(self._markers, markers_mm, strict=True):
            marker.position = position_mm / SCENE_UNIT_MM
        return backbone_mm

    def _place_disks(self, backbone_mm: Array) -> None:
        along = np.gradient(backbone_mm, axis=0)[self._disk_points]
        directions = along / np.linalg.norm(along, axis=1, keepdims=True)
        positions = backbone_mm[self._disk_points] / SCENE_UNIT_MM
        self.disks.batched_positions = positions.astype(np.float32)
        self.disks.batched_wxyzs = turns_to(directions).astype(np.float32)


def _line(scene: SceneApi, name: str, colour: palette.Rgb, pixels: float) -> LineSegmentsHandle:
    return scene.add_line_segments(
        name, _NO_SEGMENTS, colour, thickness=pixels, thickness_units="screen"
    )


def _add_marker(scene: SceneApi, name: str) -> IcosphereHandle:
    marker = scene.add_icosphere(
        f"/markers/{name}", _MARKER_RADIUS_MM / SCENE_UNIT_MM, palette.MARKER, subdivisions=2
    )
    scene.add_label(
        f"/markers/{name}/name",
        name,
        position=(0.0, 0.0, 1.5 * _MARKER_RADIUS_MM / SCENE_UNIT_MM),
        anchor="bottom-center",
        font_screen_scale=0.8,
    )
    return marker


def _add_disks(scene: SceneApi, description: Description) -> BatchedMeshHandle:
    """Add the disks of the twin's description; those of a real robot are not described."""
    disk = trimesh.creation.cylinder(
        radius=(description.robot.tendon_radius_mm + _DISK_MARGIN_MM) / SCENE_UNIT_MM,
        height=_DISK_THICKNESS_MM / SCENE_UNIT_MM,
        sections=24,
    )
    count = sum(description.twin.flexures)
    return scene.add_batched_meshes_simple(
        "/disks",
        disk.vertices,
        disk.faces,
        np.tile((1.0, 0.0, 0.0, 0.0), (count, 1)),
        np.zeros((count, 3)),
        batched_colors=palette.DESIRED,
        opacity=0.8,
        lod="off",
    )
