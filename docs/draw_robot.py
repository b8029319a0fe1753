"""Draws a robot from its description: tendons, holes, markers, positive directions.

python docs/draw_robot.py                                  # docs/images/robot.svg
python docs/draw_robot.py --robot my-robot.toml --out my-robot.svg
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from ccr_host.description import schema as config
from ccr_host.description.schema import Description
from ccr_host.robot.kinematics import ConstantCurvature

PICTURE = Path(__file__).parent / "images" / "robot.svg"
SCALE = 4.2
"""Pixels a mm."""
RIM_MM = 2.0
"""From the tendon holes to the edge of a disk."""
SHOWN_DEG = 9.0
"""Motor angle of the bent poses."""
INK, PALE, SHADE, MARKER = "#222222", "#999999", "#e6e6e6", "#e0c200"
MOTORS = ("#0072b2", "#b03a7f")

Point = tuple[float, float]


class View:
    """SVG elements of one view, in mm about an origin, the second coordinate upwards."""

    def __init__(self, title: str, origin_px: Point, title_mm: Point) -> None:
        self._origin_px = origin_px
        self.elements: list[str] = []
        self.text(title_mm, title, size=15)

    def _px(self, point: Point) -> Point:
        x_px, y_px = self._origin_px
        return round(x_px + SCALE * point[0], 1), round(y_px - SCALE * point[1], 1)

    def line(
        self, *points: Point, colour: str = INK, width: float = 1.0, ends: Sequence[str] = ()
    ) -> None:
        """Through points; ``ends``: markers of the line, ``start`` or ``end`` and a shape."""
        path = " ".join("{:g},{:g}".format(*self._px(point)) for point in points)
        marks = " ".join(
            f'marker-{where}="url(#{shape})"' for where, shape in (e.split() for e in ends)
        )
        self.elements.append(
            f'<polyline points="{path}" fill="none" stroke="{colour}" stroke-width="{width:g}" '
            f'color="{colour}" {marks}/>'
        )

    def circle(self, centre: Point, radius_mm: float, fill: str, stroke: str = INK) -> None:
        x_px, y_px = self._px(centre)
        self.elements.append(
            f'<circle cx="{x_px:g}" cy="{y_px:g}" r="{SCALE * radius_mm:.1f}" fill="{fill}" '
            f'stroke="{stroke}"/>'
        )

    def text(
        self, at: Point, words: str, colour: str = INK, anchor: str = "middle", size: int = 13
    ) -> None:
        x_px, y_px = self._px(at)
        self.elements.append(
            f'<text x="{x_px:g}" y="{y_px:g}" fill="{colour}" text-anchor="{anchor}" '
            f'font-size="{size}">{words}</text>'
        )

    def measure(self, start: Point, end: Point, words: str, words_at: Point) -> None:
        """A length between two points."""
        self.line(start, end, colour=PALE, ends=("start arrow", "end arrow"))
        self.text(words_at, words)

    def axes(self, corner: Point, right: str, up: str) -> None:
        """Directions of the axes; a name that starts with - points the other way."""
        x, y = corner
        for name, far in ((right, (x + 8, y)), (up, (x, y + 8))):
            tip, tail = (far, corner) if not name.startswith("-") else (corner, far)
            self.line(tail, tip, ends=("end arrow",))
            beside = (far[0] + 2, far[1] - 1) if far[1] == y else (far[0], far[1] + 2)
            self.text(beside, name.removeprefix("-"))


def robot_svg(description: Description) -> str:
    """The drawing as SVG text."""
    views = (
        _from_the_side(description),
        _from_above(description),
        _from_the_tip(description),
        _pulleys(description),
    )
    drawn = [line for view in views for line in view.elements]
    return "\n".join([*_HEAD, *drawn, "</svg>", ""])


def holes_mm(tendon_radius_mm: float) -> dict[int, Point]:
    """Where the tendons pass through a disk, along the paths' y and z."""
    r_c = tendon_radius_mm
    return {1: (0.0, r_c), 2: (r_c, 0.0), 3: (0.0, -r_c), 4: (-r_c, 0.0)}


def _from_the_side(description: Description) -> View:
    robot = description.robot
    base_to_1, whole = robot.segment_lengths_mm[0], sum(robot.segment_lengths_mm)
    d_m, r_c = robot.marker_offset_mm, robot.tendon_radius_mm
    view = View("from the side, y away from you", (80, 215), (whole / 2, 43))
    bent = _backbone_mm(description, (SHOWN_DEG, 0.0))
    _draw_bent(view, bent[:, [0, 2]], whole, d_m + 3, "motor 1 +", MOTORS[0])
    _draw_straight(view, description)
    for z_mm, number in ((r_c, 1), (-r_c, 3)):
        _draw_tendon(view, z_mm, base_to_1, number, MOTORS[0])
    for number, along_mm in enumerate((0.0, base_to_1, whole), start=1):
        view.line((along_mm, 0), (along_mm, d_m))
        view.circle((along_mm, d_m), 2.2, MARKER)
        view.text((along_mm - 3.2, d_m + 1), f"M{number}", anchor="end")
    view.measure((0, -10), (base_to_1, -10), f"L_1 = {base_to_1:g} mm", (base_to_1 / 2, -14))
    middle_2 = (base_to_1 + whole) / 2
    view.measure((base_to_1, -10), (whole, -10), f"L_2 = {whole - base_to_1:g} mm", (middle_2, -14))
    view.measure((whole + 6, 0), (whole + 6, d_m), f"d_m = {d_m:g} mm", (whole + 19, d_m / 2))
    view.axes((-12, -22), "-x", "z")
    return view


def _from_above(description: Description) -> View:
    whole, r_c = sum(description.robot.segment_lengths_mm), description.robot.tendon_radius_mm
    view = View("from above, z towards you", (80, 470), (whole / 2, 22))
    bent = _backbone_mm(description, (0.0, SHOWN_DEG))
    _draw_bent(view, bent[:, [0, 1]], whole, r_c + 1, "motor 2 +", MOTORS[1])
    _draw_straight(view, description)
    for y_mm, number in ((r_c, 2), (-r_c, 4)):
        _draw_tendon(view, y_mm, whole, number, MOTORS[1])
    for along_mm in (0.0, description.robot.segment_lengths_mm[0], whole):
        view.circle((along_mm, 0), 2.2, MARKER)
    view.axes((-12, -22), "-x", "y")
    return view


def _from_the_tip(description: Description) -> View:
    r_c, d_m = description.robot.tendon_radius_mm, description.robot.marker_offset_mm
    view = View("a disk from the tip, x away from you", (760, 215), (0, 43))
    view.circle((0, 0), r_c + RIM_MM, SHADE)
    view.line((0, 0), (0, d_m))
    view.circle((0, d_m), 2.2, MARKER)
    view.text((3.2, d_m - 1), "marker", anchor="start")
    outside = (r_c + RIM_MM + 2.5) / r_c
    for number, (y_mm, z_mm) in holes_mm(r_c).items():
        colour = MOTORS[(number - 1) % 2]
        view.circle((y_mm, z_mm), 0.9, "white", colour)
        aside = (2.5, outside * z_mm) if y_mm == 0 else (outside * y_mm, -1.0)
        view.text(aside, str(number), colour)
    view.measure((-1.2, 0), (-1.2, r_c), f"r_c = {r_c:g} mm", (-12, r_c + RIM_MM + 1))
    view.axes((-22, -22), "y", "z")
    return view


def _pulleys(description: Description) -> View:
    radius_mm = description.robot.pulley_radius_mm
    apart = 2 * radius_mm + 14
    view = View(
        "the pulleys, turned to a positive angle", (760 - SCALE * apart / 2, 470), (apart / 2, 22)
    )
    for motor, (pulled, released) in enumerate(((1, 3), (2, 4))):
        x_mm, colour = motor * apart, MOTORS[motor]
        view.circle((x_mm, 0), radius_mm, SHADE)
        view.text((x_mm, -1), f"motor {motor + 1} +", colour)
        edges = (x_mm - radius_mm, x_mm + radius_mm)
        view.line((edges[0], -22), (edges[0], 0), colour=colour, width=1.6, ends=("end arrow",))
        view.line((edges[1], 0), (edges[1], -22), colour=colour, width=1.6, ends=("end arrow",))
        view.text((edges[0] + 1.5, -20), f"{pulled} is wound up", colour, "start")
        view.text((edges[1] - 1.5, -25), f"{released} is let out", colour, "end")
    view.measure((0, 4), (radius_mm, 4), f"r_p = {radius_mm:g} mm", (0, 14.5))
    return view


def _backbone_mm(description: Description, motors_deg: Point) -> np.ndarray:
    """(N, 3): along the straight robot, to path y and to path z, from the base."""
    model = ConstantCurvature(description.robot)
    y_mm, x_mm, z_mm = model.backbone_mm(np.radians(motors_deg)).T
    return np.stack([-x_mm, y_mm, z_mm + model.marker_offset_mm], axis=1)


def _draw_straight(view: View, description: Description) -> None:
    """Base, backbone and disks: as many of these as the description gives the twin."""
    radius_mm = description.robot.tendon_radius_mm + RIM_MM
    lengths, counts = description.robot.segment_lengths_mm, description.twin.flexures
    view.line((-2, -18), (-2, 18), width=7, colour=PALE)
    view.text((-2, 20), "base")
    view.line((-2, 0), (sum(lengths), 0), width=3)
    start_mm = 0.0
    for length_mm, count in zip(lengths, counts, strict=True):
        for along_mm in start_mm + length_mm * np.arange(count + 1) / count:
            view.line((along_mm, -radius_mm), (along_mm, radius_mm), width=4)
        start_mm += length_mm


def _draw_tendon(view: View, beside_mm: float, length_mm: float, number: int, colour: str) -> None:
    view.line((-9, beside_mm), (length_mm, beside_mm), colour=colour, width=1.8)
    view.circle((length_mm, beside_mm), 0.7, colour, colour)
    view.text((-11, beside_mm - 1), str(number), colour)


def _draw_bent(
    view: View, points: np.ndarray, whole: float, from_mm: float, name: str, colour: str
) -> None:
    path = [(float(x), float(y)) for x, y in points]
    view.line(*path, colour=PALE, width=3)
    view.line(
        (whole + 2, from_mm), (path[-1][0] + 2, path[-1][1]), colour=colour, ends=("end arrow",)
    )
    view.text((path[-1][0] + 3, path[-1][1] + 1), name, colour, "start")


_HEAD = (
    '<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 960 590" font-family="sans-serif">',
    "<!-- Made by docs/draw_robot.py from the robot description. -->",
    '<rect width="960" height="590" fill="white"/>',
    '<defs><marker id="arrow" viewBox="0 0 10 10" refX="9" refY="5" markerWidth="7" '
    'markerHeight="7" orient="auto-start-reverse"><path d="M0,1 L10,5 L0,9 z" '
    'fill="context-stroke"/></marker></defs>',
)

if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--robot", help="description; the paper's robot by default")
    parser.add_argument("--out", type=Path, default=PICTURE, help="SVG to write")
    words = parser.parse_args()
    words.out.write_text(robot_svg(config.load(words.robot)), encoding="utf-8")
