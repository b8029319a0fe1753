"""Position of the tip at given bending angles, in the frame of the turned camera.

As in ``robot.kinematics``, f[0] is called ``across`` and the other two coordinates are combined to
s = -f[1] + i f[2].
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ccr_host.control.adaptive.loads import Beyond, Lifts, given_way, hung_of, lifts_of, uneven_of
from ccr_host.control.adaptive.parameters import Parameters, up_in_sagittal_plane
from ccr_host.core.arrays import (
    Array,
    Number,
    Three,
    Two,
    positive,
    sign,
    stacked,
)
from ccr_host.robot.arc import LEAST_SOFTENED, SHORTER_BY_SAG, arc_at


class Tip(NamedTuple):
    """f before the camera's rotation, f[0] and -f[1] + i f[2], with derivatives in theta.

    ``middle_across`` and ``middle`` are M2 - M1.
    """

    across: Number
    across_1: Number
    across_2: Number
    sagittal: Number
    sagittal_1: Number
    sagittal_2: Number
    middle_across: Number
    middle: Number


def tip_mm(p: Parameters, theta_1: Number, theta_2: Number) -> Array:
    """Tip in the camera's frame, (..., 3)."""
    tip = tip_of(p, theta_1, theta_2)
    return stacked(*seen_of(p, tip.across, tip.sagittal))


def straight_tip_mm(p: Parameters, theta_1: Number, theta_2: Number) -> Array:
    """Tip in the robot's frame, (..., 3)."""
    tip = tip_of(p, theta_1, theta_2)
    return stacked(tip.across, -tip.sagittal.real, tip.sagittal.imag)


def markers_of(p: Parameters, theta_1: Number, theta_2: Number) -> tuple[Three, Three]:
    """M2 - M1 and M3 - M1 in the camera's frame."""
    tip = tip_of(p, theta_1, theta_2)
    return seen_of(p, tip.middle_across, tip.middle), seen_of(p, tip.across, tip.sagittal)


def seen_of(p: Parameters, across: Number, sagittal: Number) -> Three:
    """Convert a vector from ``across`` and ``sagittal`` to the camera's frame."""
    return _turned(_turn_of(p, 1.0), (across, -sagittal.real, sagittal.imag))


def turned_back_mm(p: Parameters, seen_mm: Array) -> Array:
    """Convert a vector from the camera's frame to the robot's, (3,)."""
    x, y, z = (float(coordinate) for coordinate in seen_mm)
    return np.array(_turned(_turn_of(p, -1.0), (x, y, z)))


def _turn_of(p: Parameters, sense: float) -> Three:
    return sense * p.turn_x_rad, sense * p.turn_y_rad, sense * p.turn_z_rad


def _turned(turn: Three, point: Three) -> Three:
    """Turn v by w = 2 tan(angle/2) axis (Cayley): v + (w x v + w x (w x v)/2) / (1 + w^2/4)."""
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
    even_2, turn_2 = arc_at(theta_2)
    up, uneven_1, uneven_2 = up_in_sagittal_plane(p), uneven_of(arc_1), uneven_of(even_2)
    raised, arc_2 = turn * up, _tapered(even_2, theta_2, p.taper_2)
    hung = hung_of(p)
    lifts = lifts_of(p, up, raised, uneven_1, uneven_2)
    pulls = _pulls_of(p, theta_1, theta_2, raised, hung)
    yields_1 = -3.0 * hung[0] * p.length_1_mm
    yields_2 = -3.0 * hung[1] * p.length_2_mm / p.stiffness_ratio
    pull_1_slope = sign(pulls.pull_1) * pulls.pull_1_slope
    pull_2_slope = sign(pulls.pull_2) * pulls.pull_2_slope
    short_1 = SHORTER_BY_SAG * p.tendon_radius_mm * p.sag_1
    short_2 = SHORTER_BY_SAG * p.tendon_radius_mm * p.sag_2
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
    # Real part along the tangent at the end of segment 1, imaginary part across it.
    marker = (p.marker_along_mm + 1j * p.marker_aside_mm) * turn_2
    end_2 = reach_2 * arc_2[0] + marker
    end_2_slope = reach_2 * arc_2[1] + reach_2_slope * arc_2[0] + 1j * marker
    aside, aside_2 = end_2.imag, end_2_slope.imag
    # Turned bending planes, to first order.
    tilt_1, tilt_2 = -p.plane_1_rad, p.plane_1_rad - p.plane_2_rad
    turning = (end_2.real + 1j * (p.marker_offset_mm + tilt_2 * aside)) * turn
    turning_2 = (end_2_slope.real + 1j * tilt_2 * aside_2) * turn
    bulge, bulge_1, bulge_2 = _bulge_mm(p, pulls, theta_1, yields_1, lifts, uneven_1)
    arc_1 = _tapered(arc_1, theta_1, p.taper_1)
    end_1 = reach_1 * arc_1[0] + bulge - p.marker_along_mm - 1j * p.marker_offset_mm
    end_1_slope = reach_1 * arc_1[1] + reach_1_slope * arc_1[0] + bulge_1
    end_12_slope = bulge_2 - pressed_1 * pull_2_slope * arc_1[0]
    glued = p.marker_along_mm + p.middle_along_mm + 1j * (p.marker_offset_mm + p.middle_up_mm)
    middle = glued * turn
    # Segment 1 gives way to its side.
    beyond = Beyond(turning / turn, turning_2 / turn, aside, aside_2, glued)
    way = given_way(p, theta_1, pulls.pull_2, pulls.pull_2_slope, beyond)
    # Segment 2 bends unevenly.
    bulge, bulge_1 = yields_2 * lifts.lift_2 * uneven_2[0], yields_2 * lifts.lift_21 * uneven_2[0]
    bulge_2 = yields_2 * (lifts.lift_22 * uneven_2[0] + lifts.lift_2 * uneven_2[1])
    across = aside - p.marker_aside_mm + way.across + bulge.imag
    across_1, across_2 = way.across_1 + bulge_1.imag, aside_2 + way.across_2 + bulge_2.imag
    turning, turning_2 = turning + bulge.real * turn, turning_2 + bulge_2.real * turn
    sagittal = end_1 + turning + way.sagittal
    sagittal_1 = end_1_slope + 1j * turning + bulge_1.real * turn + way.sagittal_1
    sagittal_2 = turning_2 + end_12_slope + way.sagittal_2
    middle_across = p.middle_aside_mm + way.middle_across
    return Tip(
        across - tilt_1 * sagittal.imag,
        across_1 - tilt_1 * sagittal_1.imag,
        across_2 - tilt_1 * sagittal_2.imag,
        sagittal + 1j * tilt_1 * across,
        sagittal_1 + 1j * tilt_1 * across_1,
        sagittal_2 + 1j * tilt_1 * across_2,
        middle_across - tilt_1 * (end_1 + middle).imag,
        end_1 + middle,
    )


def _tapered(arc: tuple[Number, ...], theta: Number, taper: Number) -> tuple[Number, Number]:
    """End of a unit arc whose curvature grows along it by a share, and its derivative.

    The bending angle theta (u - taper (u - u^2) / 2) at the share u of the length.
    """
    uneven, uneven_slope, _ = uneven_of(arc)
    return (
        arc[0] - 0.5 * taper * theta * uneven,
        arc[1] - 0.5 * taper * (uneven + theta * uneven_slope),
    )


class _Pulls(NamedTuple):
    """Moments of the tendons at rest, of a straight robot's loads, and what makes them up."""

    pull_1: Number
    pull_1_slope: Number
    """Derivative by theta_1."""
    pull_2: Number
    pull_2_slope: Number
    """Derivative by theta_2."""


def _pulls_of(p: Parameters, theta_1: Number, theta_2: Number, raised: Number, hung: Two) -> _Pulls:
    weight = 0.5 * hung[0] + hung[1]
    return _Pulls(
        theta_1 * (1.0 + p.stiffening * theta_1 * theta_1) + weight * raised.real,
        1.0 + 3.0 * p.stiffening * theta_1 * theta_1 - weight * raised.imag,
        p.stiffness_ratio * theta_2 * (1.0 + p.stiffening * theta_2 * theta_2)
        + 0.5 * hung[1] * p.up_x,
        p.stiffness_ratio * (1.0 + 3.0 * p.stiffening * theta_2 * theta_2),
    )


def _bulge_mm(
    p: Parameters, pulls: _Pulls, theta_1: Number, yields_1: Number, lifts: Lifts, uneven_1: Three
) -> Three:
    """Uneven bending of segment 1 by gravity, strongest at the base, with slopes in both angles.

    Taut tendons soften it, as they soften any bending of a chain with sag, and a segment that
    stiffens as it bends resists it more.
    """
    hardened = 3.0 * p.stiffening * theta_1
    softer = 2.0 * p.sag_1 * (abs(pulls.pull_1) + abs(pulls.pull_2))
    margin = 1.0 - LEAST_SOFTENED + hardened * theta_1 - softer
    softened = LEAST_SOFTENED + positive(margin)
    by_margin = (margin > 0.0) / softened
    softening = 2.0 * p.sag_1 * by_margin
    amplitude = yields_1 / softened
    bulge = amplitude * lifts.lift_1 * uneven_1[0]
    slope = amplitude * (lifts.lift_11 * uneven_1[0] + lifts.lift_1 * uneven_1[1])
    return (
        bulge,
        slope
        + bulge * softening * sign(pulls.pull_1) * pulls.pull_1_slope
        - bulge * 2.0 * hardened * by_margin,
        bulge * softening * sign(pulls.pull_2) * pulls.pull_2_slope,
    )
