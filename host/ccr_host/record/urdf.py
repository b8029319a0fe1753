"""The straight robot as URDF, for viewers that want a model of the robot.

URDF has rigid links only, so the segments are drawn straight, one cylinder each, and bend nowhere.
"""

from __future__ import annotations

import math
from xml.sax.saxutils import quoteattr

from ccr_host.description.schema import Description
from ccr_host.record.log.visuals import ROBOT_FRAME

_ALONG = f"{math.pi / 2:.9f} 0 0"
"""Turns the z axis of a cylinder, and of each segment's frame, along the backbone: -y of (10)."""
_GREY = '<material name="nylon"><color rgba="0.8 0.8 0.8 1"/></material>'


def urdf_of(description: Description) -> str:
    """URDF in metres; the root is ``robot``, the frame of (10) with its origin in marker 1.

    ``base`` is the start of the backbone with its z axis along it, ``segment_1_end`` and so on the
    ends of the segments; the last one is the tip.
    """
    robot = description.robot
    bodies = [(segment.length_mm, segment.tendon_radius_mm) for segment in robot.chain]
    name = quoteattr(robot.board_name or "continuum_robot")
    parts = [f"<robot name={name}>", f'  <link name="{ROBOT_FRAME}"/>']
    parts += _fixed(ROBOT_FRAME, "base", (0.0, 0.0, -robot.marker_offset_mm), _ALONG)
    start = "base"
    for number, (length_mm, radius_mm) in enumerate(bodies, 1):
        end = f"segment_{number}_end"
        parts += _link(start, length_mm, radius_mm)
        parts += _fixed(start, end, (0.0, 0.0, length_mm), "0 0 0")
        start = end
    return "\n".join([*parts, f'  <link name="{start}"/>', "</robot>"]) + "\n"


def _link(name: str, length_mm: float, radius_mm: float) -> list[str]:
    """A link whose segment starts in its frame."""
    cylinder = f'<cylinder length="{length_mm * 1e-3:g}" radius="{radius_mm * 1e-3:g}"/>'
    middle = f'<origin xyz="0 0 {length_mm * 0.5e-3:g}" rpy="0 0 0"/>'
    return [
        f'  <link name="{name}">',
        f"    <visual>{middle}<geometry>{cylinder}</geometry>{_GREY}</visual>",
        "  </link>",
    ]


def _fixed(parent: str, child: str, at_mm: tuple[float, float, float], rpy: str) -> list[str]:
    xyz = " ".join(f"{mm * 1e-3:g}" for mm in at_mm)
    return [
        f'  <joint name="{parent}_to_{child}" type="fixed">',
        f'    <parent link="{parent}"/><child link="{child}"/>',
        f'    <origin xyz="{xyz}" rpy="{rpy}"/>',
        "  </joint>",
    ]
