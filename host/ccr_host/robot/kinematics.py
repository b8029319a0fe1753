"""The constant-curvature model, eqs. (1)-(12) of the paper, with analytic derivatives.

Segment 1 bends the robot in the y-z plane of (10), segment 2 bends across it. So f[0] depends on
segment 2 alone, and the other two coordinates are carried as one complex number
s = -f[1] + i f[2], in which (10) reads

    s = L1 E(theta1) + (L2 S(theta2) + i d_m) exp(i theta1) - i d_m,    f[0] = L2 V(theta2)

with E = S + i V the unit arc of ``arc``. The same code serves one pose (floats) and many (arrays).
"""

from __future__ import annotations

import cmath
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ccr_host.description.schema import Robot
from ccr_host.robot.arc import arc_derivatives, arc_derivatives_at

FloatArray = NDArray[np.float64]


class TipJet(NamedTuple):
    """The tip and its partial derivatives by the motor angles up to third order.

    ``across`` is f[0] in mm, ``sagittal`` is s = -f[1] + i f[2] in mm; a suffix lists the motors
    of the derivative (``sagittal_112`` is the third derivative, twice by phi_1, once by phi_2), in
    mm/rad^n. Partial derivatives that are left out are zero.
    """

    across: Any
    across_2: Any
    across_22: Any
    across_222: Any
    sagittal: Any
    sagittal_1: Any
    sagittal_2: Any
    sagittal_11: Any
    sagittal_12: Any
    sagittal_22: Any
    sagittal_111: Any
    sagittal_112: Any
    sagittal_122: Any
    sagittal_222: Any

    @property
    def tip_mm(self) -> FloatArray:
        """f of (10), (3,), for a jet at one pose."""
        return np.array((self.across, -self.sagittal.real, self.sagittal.imag))


class Geometry(NamedTuple):
    """What the model knows of a robot."""

    lengths_mm: tuple[float, float]
    marker_offset_mm: float
    bending_per_motor: float
    """theta / phi = r_p / r_c, of both segments."""


def jet_at(geometry: Geometry, motor_1_rad: float, motor_2_rad: float) -> TipJet:
    """Tip and derivatives at one pose, as floats and complex numbers."""
    gain = geometry.bending_per_motor
    theta_1 = gain * motor_1_rad
    arc_1, arc_2 = arc_derivatives_at(theta_1), arc_derivatives_at(gain * motor_2_rad)
    return assemble_jet(geometry, arc_1, arc_2, cmath.exp(1j * theta_1))


def assemble_jet(
    geometry: Geometry,
    arc_1: tuple[Any, Any, Any, Any],
    arc_2: tuple[Any, Any, Any, Any],
    turn_1: Any,  # noqa: ANN401 - complex or array, as all of these
) -> TipJet:
    """Tip and derivatives from the unit arcs of both segments and ``turn_1`` = exp(i theta1)."""
    (length_1, length_2), offset_mm, gain = geometry
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


class ConstantCurvature:
    """Forward kinematics of the two-segment robot.

    Args:
        geometry: the controller's model of the robot (Table I).
    """

    def __init__(self, geometry: Robot) -> None:
        self.geometry = Geometry(
            geometry.segment_lengths_mm,
            geometry.marker_offset_mm,
            geometry.pulley_radius_mm / geometry.tendon_radius_mm,
        )
        self.lengths_mm, self.marker_offset_mm, self.bending_per_motor = self.geometry

    def bending_rad(self, q_rad: ArrayLike) -> FloatArray:
        """Bending angles theta = k L of both segments (4), (5); shape of ``q_rad``."""
        return np.asarray(q_rad, dtype=np.float64) * self.bending_per_motor

    def tip_mm(self, q_rad: ArrayLike) -> FloatArray:
        """Position of marker 3 relative to marker 1, f of (10); ``q_rad`` (..., 2) -> (..., 3)."""
        jet = self._jet(q_rad)
        return _vector(jet.across, jet.sagittal)

    def jacobian_mm_rad(self, q_rad: ArrayLike) -> FloatArray:
        """J = df/dq of (11); ``q_rad`` (..., 2) -> (..., 3, 2)."""
        jet = self._jet(q_rad)
        by_1 = _vector(0.0, jet.sagittal_1)
        by_2 = _vector(jet.across_2, jet.sagittal_2)
        return np.stack([by_1, by_2], axis=-1)

    def hessian_mm_rad2(self, q_rad: ArrayLike) -> FloatArray:
        """d2f/dq dq; ``q_rad`` (..., 2) -> (..., 3, 2, 2)."""
        jet = self._jet(q_rad)
        by_11 = _vector(0.0, jet.sagittal_11)
        by_12 = _vector(0.0, jet.sagittal_12)
        by_22 = _vector(jet.across_22, jet.sagittal_22)
        rows = [np.stack([by_11, by_12], axis=-1), np.stack([by_12, by_22], axis=-1)]
        return np.stack(rows, axis=-2)

    def jet_at(self, motor_1_rad: float, motor_2_rad: float) -> TipJet:
        """Tip and derivatives at one pose, see ``jet_at``."""
        return jet_at(self.geometry, motor_1_rad, motor_2_rad)

    def backbone_mm(self, q_rad: ArrayLike, points: int = 41) -> FloatArray:
        """Points along the backbone from base to tip, in the frame of (10).

        The origin is marker 1, so the backbone starts at (0, 0, -d_m). ``q_rad`` (..., 2) ->
        (..., points, 3), evenly spaced along the length.
        """
        theta = self.bending_rad(q_rad)[..., None, :]
        length_1, length_2 = self.lengths_mm
        along = np.linspace(0.0, length_1 + length_2, points)
        share_1 = np.clip(along / length_1, 0.0, 1.0)
        share_2 = np.clip((along - length_1) / length_2, 0.0, 1.0)
        arc_1 = length_1 * share_1 * arc_derivatives(share_1 * theta[..., 0])[0]
        arc_2 = length_2 * share_2 * arc_derivatives(share_2 * theta[..., 1])[0]
        sagittal = arc_1 + arc_2.real * np.exp(1j * theta[..., 0]) - 1j * self.marker_offset_mm
        return _vector(arc_2.imag, sagittal)

    def _jet(self, q_rad: ArrayLike) -> TipJet:
        theta = self.bending_rad(q_rad)
        return assemble_jet(
            self.geometry,
            arc_derivatives(theta[..., 0]),
            arc_derivatives(theta[..., 1]),
            np.exp(1j * theta[..., 0]),
        )


def _vector(across: ArrayLike, sagittal: NDArray[np.complex128]) -> FloatArray:
    across_like = np.broadcast_to(np.asarray(across, dtype=np.float64), np.shape(sagittal))
    return np.stack([across_like, -sagittal.real, sagittal.imag], axis=-1)
