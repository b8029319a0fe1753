"""The constant-curvature model of ``robot.kinematics``, the same lines compiled."""

from __future__ import annotations

import cmath
from typing import NamedTuple

from ccr_host.control.compiled.jit import callable_when_compiled, compiled
from ccr_host.robot import arc, kinematics
from ccr_host.robot.kinematics import ConstantCurvature, TipJet

callable_when_compiled(arc._upwards)
callable_when_compiled(arc._downwards)
_arc_derivatives_at = callable_when_compiled(arc.arc_derivatives_at)
_assemble_jet = callable_when_compiled(kinematics.assemble_jet)


class Geometry(NamedTuple):
    """What ``ConstantCurvature`` knows of the robot."""

    length_1_mm: float
    length_2_mm: float
    marker_offset_mm: float
    bending_per_motor: float

    @classmethod
    def of(cls, model: ConstantCurvature) -> Geometry:
        """The geometry of a model."""
        return cls(*model.lengths_mm, model.marker_offset_mm, model.bending_per_motor)


@compiled
def jet_at(geometry: Geometry, motor_1_rad: float, motor_2_rad: float) -> TipJet:
    """``ConstantCurvature.jet_at``."""
    theta_1 = geometry.bending_per_motor * motor_1_rad
    theta_2 = geometry.bending_per_motor * motor_2_rad
    return _assemble_jet(
        (geometry.length_1_mm, geometry.length_2_mm),
        geometry.marker_offset_mm,
        geometry.bending_per_motor,
        _arc_derivatives_at(theta_1),
        _arc_derivatives_at(theta_2),
        cmath.exp(1j * theta_1),
    )
