"""Loads on the segments: their forces on the bending angles, and how else segments yield to them.

Segments bend unevenly under weight, and segment 1 gives way across its bending plane: it bends
sideways and twists.

A bending angle gamma (u - u^2) at the share u of a segment's length moves its end, but does not
turn it. It makes the energy least: a load that it lifts by gamma times ``lift`` takes gamma to
-3 load lift / stiffness, by which the energy falls by 3/2 (load lift)^2 / stiffness.
"""

from __future__ import annotations

from typing import NamedTuple

from ccr_host.control.adaptive.parameters import (
    MARKER_2_SHARE,
    SEGMENT_1_SHARE,
    SEGMENT_2_SHARE,
    Parameters,
    up_in_sagittal_plane,
)
from ccr_host.core.arrays import Number, Three, Two, sign
from ccr_host.robot.arc import arc_at, doubled

_VARIANCE = 0.05
"""Variance of u if its density is proportional to u - u^2."""


class Lifts(NamedTuple):
    """Rise of the ends of both segments, of unit length, by their gamma, with derivatives.

    The first digit is the segment, the others are the angles.
    """

    lift_1: Number
    lift_11: Number
    lift_111: Number
    lift_2: Number
    lift_21: Number
    lift_22: Number
    lift_211: Number
    lift_212: Number
    lift_222: Number


def uneven_of(arc: tuple[Number, ...]) -> Three:
    """Motion of the end of a unit arc by its gamma, D = E' + i E'', and two derivatives.

    The second is that of a normal density of the same variance, close enough for a stiffness.
    """
    d, slope = arc[1] + 1j * arc[2], arc[2] + 1j * arc[3]
    return d, slope, slope * slope / d - _VARIANCE * d


def hung_of(p: Parameters) -> Two:
    """Weights on the ends of both segments, with half of their own, times their lengths."""
    return (
        ((1.0 - 0.5 * SEGMENT_1_SHARE) * p.body_per_mm + p.tip_per_mm) * p.length_1_mm,
        (0.5 * SEGMENT_2_SHARE * p.body_per_mm + p.tip_per_mm) * p.length_2_mm,
    )


def lifts_of(p: Parameters, up: Number, raised: Number, uneven_1: Three, uneven_2: Three) -> Lifts:
    """Rises under gravity.

    Args:
        p: parameters.
        up: ``up_in_sagittal_plane``, which ``raised`` is after the turn of segment 1.
        raised: its imaginary part is the rise along the tangent at the end of segment 1.
        uneven_1: ``uneven_of`` segment 1.
        uneven_2: ``uneven_of`` segment 2.
    """
    (d_1, d_11, d_111), (d_2, d_22, d_222) = uneven_1, uneven_2
    along = d_2.real * raised.imag
    return Lifts(
        (d_1 * up).imag,
        (d_11 * up).imag,
        (d_111 * up).imag,
        along + p.up_x * d_2.imag,
        d_2.real * raised.real,
        d_22.real * raised.imag + p.up_x * d_22.imag,
        -along,
        d_22.real * raised.real,
        d_222.real * raised.imag + p.up_x * d_222.imag,
    )


class Forces(NamedTuple):
    """Gradient of the energy in the bending angles, zero at rest, and its second derivatives."""

    moment_1: Number
    moment_2: Number
    stiffness_11: Number
    stiffness_12: Number
    stiffness_22: Number


def loads_of(p: Parameters, theta_1: Number, theta_2: Number) -> Forces:
    """Forces of bending, gravity and push; gravity by the heights of markers and segments.

    A point s of the sagittal plane, ``across`` beside it, is at the height Im(s u) + up_x across,
    with u of ``up_in_sagittal_plane``; a push lowers the energy in the same way.

    A segment's weight acts at the mean of its points, by Simpson's rule (2 E(t/2) + E(t)) / 6.
    The push acts on the last disk. That segments yield to the weight by bending unevenly lowers the
    energy.
    """
    weight_1 = SEGMENT_1_SHARE * p.body_per_mm * p.length_1_mm
    weight_2 = SEGMENT_2_SHARE * p.body_per_mm * p.length_2_mm
    markers = MARKER_2_SHARE * p.body_per_mm + p.tip_per_mm
    carried = (markers + SEGMENT_2_SHARE * p.body_per_mm) * p.length_1_mm
    tip = p.tip_per_mm * p.length_2_mm
    middle_1, middle_2 = arc_at(0.5 * theta_1), arc_at(0.5 * theta_2)
    arc_1, turn = doubled(middle_1)
    half_1, half_2, arc_2 = (
        middle_1.derivatives,
        middle_2.derivatives,
        doubled(middle_2).derivatives,
    )
    along = weight_2 * (2.0 * half_2[0].real + arc_2[0].real) / 6.0 + tip * arc_2[0].real
    along_2 = weight_2 * (half_2[1].real + arc_2[1].real) / 6.0 + tip * arc_2[1].real
    along_22 = weight_2 * (0.5 * half_2[2].real + arc_2[2].real) / 6.0 + tip * arc_2[2].real
    aside_2 = weight_2 * (half_2[1].imag + arc_2[1].imag) / 6.0 + tip * arc_2[1].imag
    aside_22 = weight_2 * (0.5 * half_2[2].imag + arc_2[2].imag) / 6.0 + tip * arc_2[2].imag
    up, (push_x, push) = up_in_sagittal_plane(p), _push_of(p)
    raised, pushed = turn * up, turn * push * p.length_2_mm
    turning = (along + 1j * markers * p.marker_offset_mm) * raised
    pushing, push_1, push_2 = pushed * arc_2[0].real, push * p.length_1_mm, push_x * p.length_2_mm
    height_1 = (weight_1 * (half_1[1] + arc_1[1]) / 6.0 + carried * arc_1[1]) * up + 1j * turning
    height_11 = (weight_1 * (0.5 * half_1[2] + arc_1[2]) / 6.0 + carried * arc_1[2]) * up - turning
    (hung_1, hung_2), lifts = (
        hung_of(p),
        lifts_of(p, up, raised, uneven_of(arc_1), uneven_of(arc_2)),
    )
    yields_1, yields_2 = -3.0 * hung_1 * hung_1, -3.0 * hung_2 * hung_2 / p.stiffness_ratio
    lift_1, lift_11, lift_111, lift_2, lift_21, lift_22, lift_211, lift_212, lift_222 = lifts
    harder_1, harder_2 = p.stiffening * theta_1 * theta_1, p.stiffening * theta_2 * theta_2
    return Forces(
        theta_1 * (1.0 + harder_1)
        + (height_1 - push_1 * arc_1[1] - 1j * pushing).imag
        + yields_1 * lift_1 * lift_11
        + yields_2 * lift_2 * lift_21,
        p.stiffness_ratio * theta_2 * (1.0 + harder_2)
        + along_2 * raised.imag
        + p.up_x * aside_2
        - push_2 * arc_2[1].imag
        - pushed.imag * arc_2[1].real
        + yields_2 * lift_2 * lift_22,
        1.0
        + 3.0 * harder_1
        + (height_11 - push_1 * arc_1[2] + pushing).imag
        + yields_1 * (lift_11 * lift_11 + lift_1 * lift_111)
        + yields_2 * (lift_21 * lift_21 + lift_2 * lift_211),
        along_2 * raised.real
        - pushed.real * arc_2[1].real
        + yields_2 * (lift_21 * lift_22 + lift_2 * lift_212),
        p.stiffness_ratio * (1.0 + 3.0 * harder_2)
        + along_22 * raised.imag
        + p.up_x * aside_22
        - push_2 * arc_2[2].imag
        - pushed.imag * arc_2[2].real
        + yields_2 * (lift_22 * lift_22 + lift_2 * lift_222),
    )


def _push_of(p: Parameters) -> tuple[Number, Number]:
    """The push along x, and in the sagittal plane as ``up_in_sagittal_plane``.

    Its two axes are at right angles to gravity and to each other, by the formula of Duff et al.,
    Building an orthonormal basis, revisited, JCGT 6 (2017).
    """
    sense = sign(p.up_z)
    a = -1.0 / (sense + p.up_z)
    b = a * p.up_x * p.up_y
    push_x = p.push_x_per_mm * (1.0 + sense * a * p.up_x * p.up_x) + p.push_y_per_mm * b
    push_y = p.push_x_per_mm * sense * b + p.push_y_per_mm * (sense + a * p.up_y * p.up_y)
    push_z = -(p.push_x_per_mm * sense * p.up_x + p.push_y_per_mm * p.up_y)
    return push_x, push_z - 1j * push_y


_NODES = 0.5 - 3.0**-0.5 / 2.0, 0.5 + 3.0**-0.5 / 2.0
"""Nodes of Gauss's rule with two equally weighted points: shares of segment 1 before its end."""


class Beyond(NamedTuple):
    """What the end of segment 1 carries, mm.

    Places are a + i b, with a along the tangent at that end and b across it in the bending plane.
    """

    tip: Number
    tip_2: Number
    """Derivative by theta_2."""
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
    tendon of motor 2, which passes beside the segment, makes ``pull_2`` at rest, whose derivative
    by theta_2 is ``pull_2_slope``. A piece that is turned by w = sideways m + i twisting n moves a
    point by Re(conj(w) (a + i b)) to the side and by -c t w in the plane. ``beyond`` is what
    segment 1 carries.
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
