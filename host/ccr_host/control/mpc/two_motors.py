"""The tip of two planar segments with a motor each, and its derivatives, for one pose in scalars.

What ``robot.kinematics`` computes for any robot in arrays; for the few poses of a short horizon
scalars are several times faster, above all in machine code. Segment 1 bends the robot in the y-z
plane of (10), segment 2 bends across it. So f[0] depends on segment 2 alone, and the other two
coordinates are carried as one complex number s = -f[1] + i f[2], in which (10) reads

    s = L1 E(theta1) + (L2 S(theta2) + i d_m) exp(i theta1) - i d_m,    f[0] = L2 V(theta2)

with E = S + i V the unit arc of ``robot.arc``.
"""

from __future__ import annotations

import cmath
from typing import NamedTuple

from ccr_host.robot.arc import arc_derivatives_at


class TipJet(NamedTuple):
    """The tip and its partial derivatives by the motor angles up to third order.

    ``across`` is f[0] in mm, ``sagittal`` is s = -f[1] + i f[2] in mm; a suffix lists the motors
    of the derivative (``sagittal_112`` is the third derivative, twice by phi_1, once by phi_2), in
    mm/rad^n. Partial derivatives that are left out are zero.
    """

    across: float
    across_2: float
    across_22: float
    across_222: float
    sagittal: complex
    sagittal_1: complex
    sagittal_2: complex
    sagittal_11: complex
    sagittal_12: complex
    sagittal_22: complex
    sagittal_111: complex
    sagittal_112: complex
    sagittal_122: complex
    sagittal_222: complex


class Geometry(NamedTuple):
    """What the model knows of a robot."""

    lengths_mm: tuple[float, float]
    marker_offset_mm: float
    bending_per_motor: float
    """theta / phi = r_p / r_c, of both segments."""


def jet_at(geometry: Geometry, motor_1_rad: float, motor_2_rad: float) -> TipJet:
    """Tip and derivatives at one pose, as floats and complex numbers."""
    (length_1, length_2), offset_mm, gain = geometry
    theta_1 = gain * motor_1_rad
    arc_1, arc_2 = arc_derivatives_at(theta_1), arc_derivatives_at(gain * motor_2_rad)
    turn_1 = cmath.exp(1j * theta_1)
    gain_2 = gain * gain
    gain_3 = gain_2 * gain
    turn_rate = 1j * gain
    offset = 1j * offset_mm
    turning = (length_2 * arc_2[0].real + offset) * turn_1
    along_2 = length_2 * turn_1
    by_2 = gain * arc_2[1].real * along_2
    by_22 = gain_2 * arc_2[2].real * along_2
    return TipJet(
        length_2 * arc_2[0].imag,
        length_2 * gain * arc_2[1].imag,
        length_2 * gain_2 * arc_2[2].imag,
        length_2 * gain_3 * arc_2[3].imag,
        length_1 * arc_1[0] + turning - offset,
        gain * length_1 * arc_1[1] + turn_rate * turning,
        by_2,
        gain_2 * (length_1 * arc_1[2] - turning),
        turn_rate * by_2,
        by_22,
        gain_3 * length_1 * arc_1[3] - gain_2 * turn_rate * turning,
        -gain_2 * by_2,
        turn_rate * by_22,
        gain_3 * arc_2[3].real * along_2,
    )
