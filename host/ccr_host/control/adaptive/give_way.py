"""How segment 1 gives way across its bending plane: it bends sideways and twists."""

from __future__ import annotations

from typing import NamedTuple

from ccr_host.control.adaptive.parameters import (
    MARKER_2_SHARE,
    SEGMENT_1_SHARE,
    SEGMENT_2_SHARE,
    Parameters,
    up_in_sagittal_plane,
)
from ccr_host.robot.arc import Number, arc_at

_NODES = 0.5 - 3.0**-0.5 / 2.0, 0.5 + 3.0**-0.5 / 2.0
"""Of Gauss's rule with two points, weighted equally: shares of segment 1 before its end."""


class Beyond(NamedTuple):
    """What the end of segment 1 carries, mm.

    Places are a + i b, with a along the tangent at that end and b across it in the bending plane.
    """

    tip: Number
    tip_2: Number
    """By theta_2."""
    aside: Number
    """Distance of the tip from the bending plane."""
    aside_2: Number
    middle: Number
    """Place of M2."""


class GivenWay(NamedTuple):
    """Motion of tip and M2 as in ``Tip``, mm."""

    across: Number
    across_1: Number
    across_2: Number
    sagittal: Number
    sagittal_1: Number
    sagittal_2: Number
    middle_across: Number


def given_way(
    p: Parameters, theta_1: Number, pull_2: Number, pull_2_slope: Number, beyond: Beyond
) -> GivenWay:
    """Motion of tip and M2 by a segment 1 that bends sideways and twists, to first order.

    Moments are m + i n at any place: m about the normal of the bending plane's tangent, n about the
    tangent. A weight W at a + i b of that place's tangent, and at c beside the plane, makes
    i W c conj(t u) - W up_x (a + i b), with the tangent t and u of ``up_in_sagittal_plane``; the
    tendon of motor 2, which passes beside the segment, makes ``pull_2``. A piece that is turned
    by w = sideways m + i twisting n moves a point by Re(conj(w) (a + i b)) to the side and by
    -c t w in the plane.

    Args:
        p: parameters.
        theta_1: bending angle of segment 1.
        pull_2: moment of motor 2's tendons at rest.
        pull_2_slope: its derivative by theta_2.
        beyond: what segment 1 carries.
    """
    up, turn = up_in_sagittal_plane(p), arc_at(theta_1).turn
    marker, weight_2 = MARKER_2_SHARE * p.body_per_mm, SEGMENT_2_SHARE * p.body_per_mm
    weight = marker + weight_2 + p.tip_per_mm
    # The middle of a bent segment is half as far along, and a third as far aside, as its end.
    hung, reaching = weight_2 / 3.0 + p.tip_per_mm, weight_2 / 2.0 + p.tip_per_mm
    held, held_2 = reaching * beyond.tip + marker * beyond.middle, reaching * beyond.tip_2
    across, across_1, across_2, middle_across = 0.0, 0.0, 0.0, 0.0
    sagittal, sagittal_1, sagittal_2 = 0j, 0j, 0j
    for share in _NODES:
        arc, ahead = arc_at(share * theta_1)
        tangent = turn * ahead.conjugate()
        chord, chord_1 = p.length_1_mm * share * arc[0], p.length_1_mm * share * share * arc[1]
        ahead_1, tangent_1 = 1j * share * ahead, 1j * (1.0 - share) * tangent
        lever = chord + ahead * beyond.tip
        lever_1, lever_2 = chord_1 + ahead_1 * beyond.tip, ahead * beyond.tip_2
        carried = weight + 0.5 * share * SEGMENT_1_SHARE * p.body_per_mm
        hanging, hanging_1 = (
            1j * hung * (tangent * up).conjugate(),
            1j * hung * (tangent_1 * up).conjugate(),
        )
        load = beyond.aside * hanging - p.up_x * (carried * chord + ahead * held)
        load_1 = beyond.aside * hanging_1 - p.up_x * (carried * chord_1 + ahead_1 * held)
        load_2 = beyond.aside_2 * hanging - p.up_x * ahead * held_2
        turned, turned_1 = _turned(p, load + pull_2), _turned(p, load_1)
        turned_2 = _turned(p, load_2 + pull_2_slope)
        across += (turned.conjugate() * lever).real
        across_1 += (turned_1.conjugate() * lever + turned.conjugate() * lever_1).real
        across_2 += (turned_2.conjugate() * lever + turned.conjugate() * lever_2).real
        middle_across += (turned.conjugate() * (chord + ahead * beyond.middle)).real
        sagittal -= beyond.aside * turned * tangent
        sagittal_1 -= beyond.aside * (turned_1 * tangent + turned * tangent_1)
        sagittal_2 -= (beyond.aside_2 * turned + beyond.aside * turned_2) * tangent
    return GivenWay(across, across_1, across_2, sagittal, sagittal_1, sagittal_2, middle_across)


def _turned(p: Parameters, moment: Number) -> Number:
    """Turn of the piece that a node stands for, half of the segment."""
    return (p.sideways * moment.real + 1j * p.twisting * moment.imag) / len(_NODES)
