"""Forces on the bending angles by stiffness, gravity and a push."""

from __future__ import annotations

from typing import NamedTuple

from ccr_host.control.adaptive.arithmetic import sign
from ccr_host.control.adaptive.parameters import (
    MARKER_2_SHARE,
    SEGMENT_1_SHARE,
    SEGMENT_2_SHARE,
    Parameters,
    up_in_sagittal_plane,
)
from ccr_host.control.adaptive.uneven import hung_of, lifts_of, uneven_of
from ccr_host.robot.arc import Number, arc_at, doubled


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
