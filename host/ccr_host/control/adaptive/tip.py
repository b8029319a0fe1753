"""Position of the tip at given bending angles, in the frame of the turned camera.

As in ``robot.kinematics``, f[0] is called ``across`` and the other two coordinates are combined to
s = -f[1] + i f[2].
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ccr_host.control.adaptive.arithmetic import (
    FloatArray,
    Three,
    arc_at,
    positive,
    sign,
    stacked,
)
from ccr_host.control.adaptive.parameters import SEGMENT_1_SHARE, SEGMENT_2_SHARE, Parameters
from ccr_host.robot.arc import Number

_LEAST_SOFTENED = 0.4
"""Minimum fraction of a segment's stiffness against uneven bending: below it, the model would have
buckled."""
_SHORTER_BY_SAG = 2.0 / 3.0
"""A chain of n hinges is shorter than its arc by theta^2 / (12 n^2), and its sag is
L / (8 n^2 r_c): the former is 2/3 r_c / L of the latter."""


class Tip(NamedTuple):
    """f before the camera's rotation, f[0] and -f[1] + i f[2], with derivatives in theta.

    ``middle`` is M2 - M1 in the sagittal plane, in which it moves.
    """

    across: Number
    across_2: Number
    sagittal: Number
    sagittal_1: Number
    sagittal_2: Number
    middle: Number


def tip_mm(p: Parameters, theta_1: Number, theta_2: Number) -> FloatArray:
    """Tip in the camera's frame, (..., 3)."""
    tip = tip_of(p, theta_1, theta_2)
    return stacked(*seen_of(p, tip.across, tip.sagittal))


def straight_tip_mm(p: Parameters, theta_1: Number, theta_2: Number) -> FloatArray:
    """Tip in the robot's frame, (..., 3)."""
    tip = tip_of(p, theta_1, theta_2)
    return stacked(tip.across, -tip.sagittal.real, tip.sagittal.imag)


def markers_of(p: Parameters, theta_1: Number, theta_2: Number) -> tuple[Three, Three]:
    """M2 - M1 and M3 - M1 in the camera's frame."""
    tip = tip_of(p, theta_1, theta_2)
    return seen_of(p, p.middle_aside_mm, tip.middle), seen_of(p, tip.across, tip.sagittal)


def seen_of(p: Parameters, across: Number, sagittal: Number) -> Three:
    """Convert a vector from ``across`` and ``sagittal`` to the camera's frame."""
    return _turned(_turn_of(p, 1.0), (across, -sagittal.real, sagittal.imag))


def turned_back_mm(p: Parameters, seen_mm: FloatArray) -> FloatArray:
    """Convert a vector from the camera's frame to the robot's, (3,)."""
    x, y, z = (float(coordinate) for coordinate in seen_mm)
    return np.array(_turned(_turn_of(p, -1.0), (x, y, z)))


def _turn_of(p: Parameters, sense: float) -> Three:
    return sense * p.turn_x_rad, sense * p.turn_y_rad, sense * p.turn_z_rad


def _turned(turn: Three, point: Three) -> Three:
    """By w = 2 tan(angle / 2) axis, Cayley: v + (w x v + w x (w x v) / 2) / (1 + w^2 / 4)."""
    once = _cross(turn, point)
    twice = _cross(turn, once)
    share = 1.0 / (1.0 + 0.25 * (turn[0] * turn[0] + turn[1] * turn[1] + turn[2] * turn[2]))
    return (
        point[0] + share * (once[0] + 0.5 * twice[0]),
        point[1] + share * (once[1] + 0.5 * twice[1]),
        point[2] + share * (once[2] + 0.5 * twice[2]),
    )


def _cross(a: Three, b: Three) -> Three:
    return (
        a[1] * b[2] - a[2] * b[1],
        a[2] * b[0] - a[0] * b[2],
        a[0] * b[1] - a[1] * b[0],
    )


def tip_of(p: Parameters, theta_1: Number, theta_2: Number) -> Tip:
    """The tip at bending angles."""
    arc_1, turn = arc_at(theta_1)
    arc_2 = arc_at(theta_2).derivatives
    pulls = _pulls_of(p, theta_1, theta_2, turn * up_in_sagittal_plane(p))
    pull_1_slope = sign(pulls.pull_1) * pulls.pull_1_slope
    pull_2_slope = sign(pulls.pull_2) * p.stiffness_ratio
    short_1 = _SHORTER_BY_SAG * p.tendon_radius_mm * p.sag_1
    short_2 = _SHORTER_BY_SAG * p.tendon_radius_mm * p.sag_2
    pressed_1 = p.tendon_radius_mm * p.shortening
    pressed_2 = pressed_1 * p.length_2_mm / p.length_1_mm
    reach_1 = (
        p.length_1_mm
        - short_1 * theta_1 * theta_1
        - pressed_1 * (abs(pulls.pull_1) + abs(pulls.pull_2))
    )
    reach_2 = p.length_2_mm - short_2 * theta_2 * theta_2 - pressed_2 * abs(pulls.pull_2)
    reach_1_slope = -2.0 * short_1 * theta_1 - pressed_1 * pull_1_slope
    reach_2_slope = -2.0 * short_2 * theta_2 - pressed_2 * pull_2_slope
    turning = (reach_2 * arc_2[0].real + 1j * p.marker_offset_mm) * turn
    bulge, bulge_1, bulge_2 = _bulge_mm(p, pulls, arc_1)
    end_1 = reach_1 * arc_1[0] + bulge - 1j * p.marker_offset_mm
    height_2 = p.marker_offset_mm + p.middle_up_mm
    return Tip(
        reach_2 * arc_2[0].imag,
        reach_2 * arc_2[1].imag + reach_2_slope * arc_2[0].imag,
        end_1 + turning,
        reach_1 * arc_1[1] + reach_1_slope * arc_1[0] + 1j * turning + bulge_1,
        (reach_2 * arc_2[1].real + reach_2_slope * arc_2[0].real) * turn
        - pressed_1 * pull_2_slope * arc_1[0]
        + bulge_2,
        end_1 + (p.middle_along_mm + 1j * height_2) * turn,
    )


def up_in_sagittal_plane(p: Parameters) -> Number:
    """A complex number u: the height of a point s of the sagittal plane is Im(s u)."""
    return p.up_z - 1j * p.up_y


class _Pulls(NamedTuple):
    """Moments of the tendons at rest, of a straight robot's loads, and what makes them up."""

    pull_1: Number
    pull_1_slope: Number
    """By theta_1."""
    pull_2: Number
    load: Number
    """Weight that bends segment 1 unevenly, times its length."""


def _pulls_of(p: Parameters, theta_1: Number, theta_2: Number, raised: Number) -> _Pulls:
    load = ((1.0 - 0.5 * SEGMENT_1_SHARE) * p.body_per_mm + p.tip_per_mm) * p.length_1_mm
    beyond = (0.5 * SEGMENT_2_SHARE * p.body_per_mm + p.tip_per_mm) * p.length_2_mm
    weight = 0.5 * load + beyond
    return _Pulls(
        theta_1 + weight * raised.real,
        1.0 - weight * raised.imag,
        p.stiffness_ratio * theta_2 + 0.5 * beyond * p.up_x,
        load,
    )


def _bulge_mm(
    p: Parameters, pulls: _Pulls, arc_1: tuple[Number, ...]
) -> tuple[Number, Number, Number]:
    """Uneven bending of segment 1 by gravity, strongest at the base, with slopes in both angles.

    Bending angle gamma (u - u^2) at the share u of the length moves the segment's end by
    gamma L_1 D with D = E' + i E''; its energy is gamma^2 / 6 and the load's gamma load Im(D u),
    with u of ``up_in_sagittal_plane``.
    Taut tendons soften it, as they soften any bending of a chain with sag.
    """
    up = up_in_sagittal_plane(p)
    margin = 1.0 - _LEAST_SOFTENED - 2.0 * p.sag_1 * (abs(pulls.pull_1) + abs(pulls.pull_2))
    softened = _LEAST_SOFTENED + positive(margin)
    softening = 2.0 * p.sag_1 * (margin > 0.0) / softened
    reach = arc_1[1] + 1j * arc_1[2]
    reach_slope = arc_1[2] + 1j * arc_1[3]
    amplitude = -3.0 * pulls.load * p.length_1_mm / softened
    lift = (reach * up).imag
    bulge = amplitude * lift * reach
    slope = amplitude * ((reach_slope * up).imag * reach + lift * reach_slope)
    return (
        bulge,
        slope + bulge * softening * sign(pulls.pull_1) * pulls.pull_1_slope,
        bulge * softening * sign(pulls.pull_2) * p.stiffness_ratio,
    )
