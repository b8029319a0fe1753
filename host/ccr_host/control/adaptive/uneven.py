"""How segments bend unevenly under weight, beside the bending angles at their ends.

A bending angle gamma (u - u^2) at the share u of its length moves the end of a segment, but does
not turn it. It makes the energy least: a load that it lifts by gamma times ``lift`` takes gamma to
-3 load lift / stiffness, by which the energy falls by 3/2 (load lift)^2 / stiffness.
"""

from __future__ import annotations

from typing import NamedTuple

from ccr_host.control.adaptive.arithmetic import Three, Two
from ccr_host.control.adaptive.parameters import SEGMENT_1_SHARE, SEGMENT_2_SHARE, Parameters
from ccr_host.robot.arc import Number

_VARIANCE = 0.05
"""Of u, if u - u^2 is taken for its density."""


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
