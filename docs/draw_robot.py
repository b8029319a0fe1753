"""Draws a robot from its description: tendons, holes, markers, positive directions.

python docs/draw_robot.py                                  # docs/images/robot.svg
python docs/draw_robot.py --robot my-robot.toml --out my-robot.svg
"""

from __future__ import annotations

import argparse
import itertools
import math
from collections import Counter
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np

from ccr_host.description import schema as config
from ccr_host.description.schema import Description
from ccr_host.robot.kinematics import ConstantCurvature

PICTURE = Path(__file__).parent / "images" / "robot.svg"
SCALE = 4.2
"""Pixels a mm."""
TIE_PX = 1e-6
"""So that rounding errors do not decide which way a tie is rounded."""
RIM_MM = 2.0
"""Distance from the tendon holes to the edge of a disk."""
SHOWN_MM = 26.0
"""How far the motor that moves the tip most has moved it in the bent poses."""
INK, PALE, SHADE, MARKER = "#222222", "#999999", "#e6e6e6", "#e0c200"
MOTORS = ("#0072b2", "#b03a7f", "#009e73", "#d55e00", "#56b4e9", "#7a4fa3", "#8c6d00", "#333333")
"""Colours, from the first again after the last."""

_Z = 2
"""Number of the paths' z among the coordinates of a backbone."""
_SAME_MM = 1e-6
_APART_MM = 4.0
"""Distance between the names of motors, upwards."""
_ARROW_MM = 6.0
"""Shortest arrow that starts beside the robot, not at its middle."""

Point = tuple[float, float]


class View:
    """SVG elements of one view, in mm about an origin, the second coordinate upwards.

    Args:
        title: of the view.
        origin_px: in the picture.
        title_mm: middle of the title.
        scale: pixels a mm, across and upwards.
    """

    def __init__(
        self, title: str, origin_px: Point, title_mm: Point, scale: Point = (SCALE, SCALE)
    ) -> None:
        self._origin_px, self._scale = origin_px, scale
        self.elements: list[str] = []
        self.text(title_mm, title, size=15)

    def _px(self, point: Point) -> Point:
        x_px, y_px = self._origin_px
        across, upwards = self._scale
        x_px, y_px = x_px + across * point[0] + TIE_PX, y_px - upwards * point[1] + TIE_PX
        return round(x_px, 1), round(y_px, 1)

    def line(
        self,
        *points: Point,
        colour: str = INK,
        width: float = 1.0,
        ends: Sequence[str] = (),
        fill: str = "none",
    ) -> None:
        """Through points; ``ends``: markers of the line, ``start`` or ``end`` and a shape."""
        path = " ".join("{:g},{:g}".format(*self._px(point)) for point in points)
        marks = " ".join(
            f'marker-{where}="url(#{shape})"' for where, shape in (e.split() for e in ends)
        )
        self.elements.append(
            f'<polyline points="{path}" fill="{fill}" stroke="{colour}" stroke-width="{width:g}" '
            f'color="{colour}" {marks}/>'
        )

    def circle(self, centre: Point, radius_mm: float, fill: str, stroke: str = INK) -> None:
        x_px, y_px = self._px(centre)
        radius_px = self._scale[0] * radius_mm
        self.elements.append(
            f'<circle cx="{x_px:g}" cy="{y_px:g}" r="{radius_px:.1f}" fill="{fill}" '
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
    robot = description.robot
    beyond_px = 160 + SCALE * (sum(robot.segment_lengths_mm) + 78)
    apart_mm = 2 * robot.pulley_radius_mm + 14
    width_px = max(beyond_px + 200, 160 + SCALE * apart_mm * robot.motors)
    views = (
        _along(description, "from the side, y away from you", (160, 215), (2, 1), "z"),
        _along(description, "from above, z towards you", (160, 470), (1, 2), "y"),
        _from_the_tip(description, (beyond_px, 215)),
        _pulleys(description, (180, 720)),
    )
    return svg(views, width_px, 850)


def holes_mm(description: Description) -> list[Point]:
    """Where the tendons pass through the disks of segment 1, along the paths' y and z."""
    robot = description.robot
    radius_mm, clocking_deg = robot.chain[0].tendon_radius_mm, robot.chain[0].clocking_deg
    angles = [math.radians(tendon.angle_deg + clocking_deg) for _, tendon in robot.tendons]
    return [(radius_mm * math.cos(angle), radius_mm * math.sin(angle)) for angle in angles]


def _along(
    description: Description, title: str, origin_px: Point, coordinates: tuple[int, int], up: str
) -> View:
    """The straight robot and each motor's motion, mostly along the first of two coordinates."""
    robot, (shown, hidden) = description.robot, coordinates
    ends_mm = [0.0, *itertools.accumulate(robot.segment_lengths_mm)]
    d_m, whole = robot.marker_offset_mm, ends_mm[-1]
    view = View(title, origin_px, (whole / 2, 43 if shown == _Z else 22))
    start_mm = (d_m if shown == _Z else robot.tendon_radius_mm) + 3
    all_bent = _bent_mm(description)
    in_view = [
        motor
        for motor, bent in enumerate(all_bent)
        if abs(bent[-1, shown]) > abs(bent[-1, hidden]) - _SAME_MM
    ]
    name_mm = -math.inf
    for motor in sorted(in_view, key=lambda motor: all_bent[motor][-1, shown]):
        bent = all_bent[motor][:, [0, shown]]
        name_mm = max(bent[-1, 1] + 1, name_mm + _APART_MM)
        _draw_bent(view, bent, (whole, start_mm), motor, name_mm)
    _draw_straight(view, description)
    holes = zip(robot.tendons, holes_mm(description), strict=True)
    drawn_at: Counter[float] = Counter()
    for number, ((segment, tendon), place) in enumerate(holes, start=1):
        beside_mm = place[shown - 1]
        if abs(beside_mm) > abs(place[hidden - 1]) - _SAME_MM:
            aside_mm = _APART_MM * drawn_at[round(beside_mm, 3)]
            drawn_at[round(beside_mm, 3)] += 1
            ends = -9 - 3 * segment - aside_mm, ends_mm[segment + 1]
            _draw_tendon(view, beside_mm, ends, number, colour_of(tendon.motor - 1))
    for name, along_mm in zip(robot.markers, ends_mm, strict=True):
        height_mm = d_m if shown == _Z else 0.0
        view.line((along_mm, 0), (along_mm, height_mm))
        view.circle((along_mm, height_mm), 2.2, MARKER)
        if shown == _Z:
            view.text((along_mm - 3.2, height_mm + 1), name, anchor="end")
    if shown == _Z:
        for number, (near, far) in enumerate(itertools.pairwise(ends_mm), start=1):
            words = f"L_{number} = {far - near:g} mm"
            view.measure((near, -10), (far, -10), words, ((near + far) / 2, -14))
        beside = (-18, 0), (-18, d_m)
        view.measure(*beside, f"d_m = {d_m:g} mm", (-21, d_m + 2))
    view.axes((-12, -22), "-x", up)
    return view


def _from_the_tip(description: Description, origin_px: Point) -> View:
    r_c, d_m = description.robot.chain[0].tendon_radius_mm, description.robot.marker_offset_mm
    view = View("a disk of segment 1 from the tip, x away from you", origin_px, (0, 43))
    view.circle((0, 0), r_c + RIM_MM, SHADE)
    view.line((0, 0), (0, d_m))
    view.circle((0, d_m), 2.2, MARKER)
    view.text((3.2, d_m - 1), "marker", anchor="start")
    outside = (r_c + RIM_MM + 2.5) / r_c
    holes = zip(description.robot.tendons, holes_mm(description), strict=True)
    for number, ((_, tendon), (y_mm, z_mm)) in enumerate(holes, start=1):
        colour = colour_of(tendon.motor - 1)
        view.circle((y_mm, z_mm), 0.9, "white", colour)
        aside = 2.5 if abs(y_mm) < _SAME_MM and z_mm > 0 else 0.0
        view.text((outside * y_mm + aside, outside * z_mm - 1.0), str(number), colour)
    view.measure((-1.2, 0), (-1.2, r_c), f"r_c = {r_c:g} mm", (-14, r_c + RIM_MM + 1))
    view.axes((-22, -22), "y", "z")
    return view


def _pulleys(description: Description, origin_px: Point) -> View:
    robot = description.robot
    radius_mm = robot.pulley_radius_mm
    apart = 2 * radius_mm + 14
    title_mm = (max(apart / 2, (robot.motors - 1) * apart / 2), radius_mm + 6)
    view = View("the pulleys, turned to a positive angle", origin_px, title_mm)
    for motor in range(robot.motors):
        x_mm, colour = motor * apart, colour_of(motor)
        view.circle((x_mm, 0), radius_mm, SHADE)
        view.text((x_mm, -1), f"motor {motor + 1} +", colour)
        for winding, side, words in ((1, -1, "wound up"), (-1, 1, "let out")):
            wound = [
                str(number)
                for number, (_, tendon) in enumerate(robot.tendons, start=1)
                if (tendon.motor, tendon.winding) == (motor + 1, winding)
            ]
            if not wound:
                continue
            edge = x_mm + side * radius_mm
            ends = ((edge, -22), (edge, 0))[::-side]
            view.line(*ends, colour=colour, width=1.6, ends=("end arrow",))
            anchor = "start" if winding > 0 else "end"
            at = (edge - 1.5 * side, -20 if winding > 0 else -25)
            view.text(at, f"{', '.join(wound)} is {words}", colour, anchor)
    view.measure((0, 4), (radius_mm, 4), f"r_p = {radius_mm:g} mm", (0, radius_mm + 2))
    return view


def _bent_mm(description: Description) -> list[np.ndarray]:
    """Backbone with each motor turned, (N, 3): along the straight robot, to paths' y and z."""
    model = ConstantCurvature(description.robot)
    each = np.eye(model.motors)
    most_mm = np.linalg.norm(model.jacobian_mm_rad(0 * each[0]), axis=0).max()
    bent = []
    for motor_rad in SHOWN_MM / most_mm * each:
        y_mm, x_mm, z_mm = model.backbone_mm(motor_rad).T
        bent.append(np.stack([-x_mm, y_mm, z_mm + model.marker_offset_mm], axis=1))
    return bent


def _draw_straight(view: View, description: Description) -> None:
    """Base, backbone and disks: as many of these as the description gives the twin."""
    segments, counts = description.robot.chain, description.twin.flexures
    view.line((-2, -18), (-2, 18), width=7, colour=PALE)
    view.text((-2, 20), "base")
    view.line((-2, 0), (sum(description.robot.segment_lengths_mm), 0), width=3)
    start_mm = 0.0
    for segment, count in zip(segments, counts, strict=True):
        radius_mm = segment.tendon_radius_mm + RIM_MM
        for along_mm in start_mm + segment.length_mm * np.arange(count + 1) / count:
            view.line((along_mm, -radius_mm), (along_mm, radius_mm), width=4)
        start_mm += segment.length_mm


def _draw_tendon(view: View, beside_mm: float, ends: Point, number: int, colour: str) -> None:
    start_mm, end_mm = ends
    view.line((start_mm, beside_mm), (end_mm, beside_mm), colour=colour, width=1.8)
    view.circle((end_mm, beside_mm), 0.7, colour, colour)
    view.text((start_mm - 2, beside_mm - 1), str(number), colour)


def _draw_bent(
    view: View, points: np.ndarray, straight_end: Point, motor: int, name_mm: float
) -> None:
    path, colour = [(float(x), float(y)) for x, y in points], colour_of(motor)
    end, (whole, from_mm) = path[-1], straight_end
    view.line(*path, colour=PALE, width=3)
    start_mm = math.copysign(from_mm, end[1]) if abs(end[1]) > from_mm + _ARROW_MM else 0.0
    view.line((whole + 2, start_mm), (end[0] + 2, end[1]), colour=colour, ends=("end arrow",))
    view.text((end[0] + 4, name_mm), f"motor {motor + 1} +", colour, "start")


def colour_of(motor: int) -> str:
    """Colour of a motor's tendons and lead, counted from 0."""
    return MOTORS[motor % len(MOTORS)]


def svg(views: Sequence[View], width_px: float, height_px: float) -> str:
    """A picture of views."""
    drawn = [line for view in views for line in view.elements]
    size = {"WIDTH": f"{width_px:.0f}", "HEIGHT": f"{height_px:.0f}"}
    head = [
        line.replace("WIDTH", size["WIDTH"]).replace("HEIGHT", size["HEIGHT"]) for line in _HEAD
    ]
    return "\n".join([*head, *drawn, "</svg>", ""])


def main(draw: Callable[[Description], str], what: str, picture: Path) -> None:
    """Draw the robot that the command line names."""
    parser = argparse.ArgumentParser(description=what.partition("\n")[0])
    parser.add_argument("--robot", help="description; the default robot without it")
    parser.add_argument("--out", type=Path, default=picture, help="SVG to write")
    words = parser.parse_args()
    words.out.write_text(draw(config.load(words.robot)), encoding="utf-8")


_HEAD = (
    '<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 WIDTH HEIGHT" font-family="sans-serif">',
    "<!-- Made by a script in docs/ from the robot description. -->",
    '<rect width="WIDTH" height="HEIGHT" fill="white"/>',
    '<defs><marker id="arrow" viewBox="0 0 10 10" refX="9" refY="5" markerWidth="7" '
    'markerHeight="7" orient="auto-start-reverse"><path d="M0,1 L10,5 L0,9 z" '
    'fill="context-stroke"/></marker></defs>',
)

if __name__ == "__main__":
    main(robot_svg, __doc__, PICTURE)
