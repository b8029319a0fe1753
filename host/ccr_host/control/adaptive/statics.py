"""Where the robot rests: two bending angles, slack elastic tendons, gravity.

The equations stand in docs/control-statics.md.

Each segment bends evenly by theta_j. Its pose minimises the energy of bending, gravity and the
tendons, each of which pulls when taut and never pushes. All energies count in units of segment 1's
bending stiffness k_1, so only ratios enter: they are the unknowns of :class:`Parameters`. As in
``robot.kinematics``, f[0] is carried as ``across`` and the other two coordinates as
s = -f[1] + i f[2]; the same lines serve one pose (floats) and many (arrays).
"""

from __future__ import annotations

import cmath
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ccr_host.config import Robot
from ccr_host.robot.arc import arc_derivatives, arc_derivatives_at

FloatArray = NDArray[np.float64]
Number = Any
"""A float, a complex number, or an array of them."""

_NEWTON_LIMIT = 30
_LONGEST_STEP_RAD = 0.5
_REST_RAD = 1e-7
_LEAST_STIFFNESS = 0.2
"""Of k_1: keeps Newton's steps downhill where gravity nearly buckles the robot."""

_CHANGE_OVER = 0.003
"""Of k_1 a radian: half width of a tendon pair's change-over, 0.2 deg of bending. A wider one
leaves the segment hanging on no tendon, lightly damped, for longer."""

_LEAST_SOFTENED = 0.4
"""Of a segment's stiffness against uneven bending: a model beyond it would have buckled."""

_SEGMENT_1_SHARE, _MARKER_2_SHARE, _SEGMENT_2_SHARE = 0.4, 0.25, 0.35
"""Of the weight without the tip, a printed robot of the paper's kind. What the shares get wrong
the stiffness ratio and the tip's weight take up."""


class Parameters(NamedTuple):
    """What the controller does not know exactly; floats, or arrays that broadcast."""

    length_1_mm: Number
    length_2_mm: Number
    marker_offset_mm: Number
    gain_1: Number
    """theta_1 / phi_1 of inextensible, taut tendons: r_p / r_c."""
    gain_2: Number
    compliance_1: Number
    """k_1 / (k_t r_c^2): how much further a motor must turn against stretching tendons."""
    compliance_2: Number
    slack_1_rad: Number
    """Motor angle that takes up the slack of a straight segment."""
    slack_2_rad: Number
    sag_1: Number
    """Slack in units of r_c that bending adds per theta_1^2: holes of a bent segment come closer
    on both sides."""
    sag_2: Number
    body_per_mm: Number
    """Weight of everything but the tip over k_1."""
    tip_per_mm: Number
    """Weight at the tip over k_1: marker, tool, payload."""
    stiffness_ratio: Number
    """k_2 / k_1."""
    turn_x_rad: Number
    """Rotation of the camera against the robot, small angles."""
    turn_y_rad: Number
    turn_z_rad: Number
    play_rad: Number
    """How far a servo stays behind its setpoint, on the side it came from."""
    friction_1: Number
    """Moment over k_1 that holds a segment back against its last motion."""
    friction_2: Number


COUNT = len(Parameters._fields)


class Prior(NamedTuple):
    """What the description and its kind of robot say of each parameter, (COUNT,) each."""

    mean: FloatArray
    deviation: FloatArray
    lower: FloatArray
    upper: FloatArray


def prior_of(robot: Robot) -> Prior:
    """The prior, from the description alone.

    The geometry is believed to some per cent. The rest are assumptions about a printed robot with
    thread tendons: 1 mm of slack, tendons four times stiffer than the flexures, gravity bending it
    by a third of a radian. Bounds keep the model meaningful, whatever is measured.
    """
    length_1, length_2 = robot.segment_lengths_mm
    offset = robot.marker_offset_mm
    gain = robot.pulley_radius_mm / robot.tendon_radius_mm
    slack_unit = 1.0 / robot.pulley_radius_mm
    length, turn = (0.07, 0.6, 1.5), (0.0, 0.06, -0.3, 0.3)
    compliance, sag = (0.25, 0.15, 0.02, 1.2), (0.04, 0.03, 0.0, 0.15)
    slack = (slack_unit, 0.6 * slack_unit, 0.0, 4.0 * slack_unit)
    friction = (0.0, 0.1, 0.0, 0.5)
    rows = Parameters(
        length_1_mm=(length_1, *(length_1 * share for share in length)),
        length_2_mm=(length_2, *(length_2 * share for share in length)),
        marker_offset_mm=(offset, 0.1 * offset, 0.6 * offset, 1.5 * offset),
        gain_1=(gain, 0.12 * gain, 0.6 * gain, 1.5 * gain),
        gain_2=(gain, 0.12 * gain, 0.6 * gain, 1.5 * gain),
        compliance_1=compliance,
        compliance_2=compliance,
        slack_1_rad=slack,
        slack_2_rad=slack,
        sag_1=sag,
        sag_2=sag,
        body_per_mm=(0.008, 0.004, 0.0, 0.04),
        tip_per_mm=(0.002, 0.002, 0.0, 0.02),
        stiffness_ratio=(1.0, 0.3, 0.3, 3.0),
        turn_x_rad=turn,
        turn_y_rad=turn,
        turn_z_rad=turn,
        play_rad=(0.0, 0.01, 0.0, 0.03),
        friction_1=friction,
        friction_2=friction,
    )
    return Prior(*np.array(rows, dtype=np.float64).T)


class Drive(NamedTuple):
    """What the servos were told.

    ``setpoint_rad`` (..., 2); ``side`` (..., 2) is the direction of the last motion, from -1 to 1.
    """

    setpoint_rad: FloatArray
    side: FloatArray


class Tip(NamedTuple):
    """f before the camera's rotation, f[0] and -f[1] + i f[2], with derivatives in theta."""

    across: Number
    across_2: Number
    sagittal: Number
    sagittal_1: Number
    sagittal_2: Number


class Pose(NamedTuple):
    """Forces and tip at given bending and motor angles, with derivatives in the bending angles.

    ``moment_1``, ``moment_2``: gradient of the energy, zero at rest; ``stiffness_..``: its second
    derivatives.
    """

    moment_1: Number
    moment_2: Number
    stiffness_11: Number
    stiffness_12: Number
    stiffness_22: Number
    tip: Tip


class _Shape(NamedTuple):
    """The unit arcs of both segments and of half of each, with derivatives; exp(i theta_1)."""

    arc_1: tuple[Number, ...]
    arc_2: tuple[Number, ...]
    half_1: tuple[Number, ...]
    half_2: tuple[Number, ...]
    turn_1: Number


def _shape_of(theta_1: Number, theta_2: Number) -> _Shape:
    if isinstance(theta_1, float):
        return _Shape(
            arc_derivatives_at(theta_1),
            arc_derivatives_at(theta_2),
            arc_derivatives_at(0.5 * theta_1),
            arc_derivatives_at(0.5 * theta_2),
            cmath.exp(1j * theta_1),
        )
    return _Shape(
        arc_derivatives(theta_1),
        arc_derivatives(theta_2),
        arc_derivatives(0.5 * theta_1),
        arc_derivatives(0.5 * theta_2),
        np.exp(1j * theta_1),
    )


def _split(pairs: FloatArray) -> tuple[Number, Number]:
    """Both columns of (..., 2), as floats if there is but one pair: those are much faster."""
    if pairs.ndim == 1:
        return float(pairs[0]), float(pairs[1])
    return pairs[..., 0], pairs[..., 1]


def pose_at(p: Parameters, theta_rad: FloatArray, drive: Drive) -> Pose:
    """Forces and tip at bending angles ``theta_rad`` (..., 2)."""
    theta_1, theta_2 = _split(theta_rad)
    return _pose(p, theta_1, theta_2, drive, _shape_of(theta_1, theta_2))


def tip_at(p: Parameters, theta_rad: FloatArray) -> Tip:
    """The tip alone, at bending angles (..., 2)."""
    theta_1, theta_2 = _split(theta_rad)
    if isinstance(theta_1, float):
        arc_1, arc_2 = arc_derivatives_at(theta_1), arc_derivatives_at(theta_2)
        return _tip(p, theta_1, theta_2, arc_1, arc_2, cmath.exp(1j * theta_1))
    arcs_1, arcs_2 = arc_derivatives(theta_1), arc_derivatives(theta_2)
    return _tip(p, theta_1, theta_2, arcs_1, arcs_2, np.exp(1j * theta_1))


def tip_mm(p: Parameters, theta_rad: FloatArray) -> FloatArray:
    """Tip in the camera's frame over bending angles (..., 2) -> (..., 3)."""
    tip = tip_at(p, theta_rad)
    return vector_mm(p, tip.across, tip.sagittal)


def vector_mm(p: Parameters, across: Number, sagittal: Number) -> FloatArray:
    """Turn ``across`` and ``sagittal`` into the camera's frame, (..., 3), to first order."""
    x, y, z = across, -sagittal.real, sagittal.imag
    turned = (
        x + p.turn_y_rad * z - p.turn_z_rad * y,
        y + p.turn_z_rad * x - p.turn_x_rad * z,
        z + p.turn_x_rad * y - p.turn_y_rad * x,
    )
    return np.stack(np.broadcast_arrays(*turned), axis=-1)


def tip_jacobian_mm_rad(p: Parameters, tip: Tip) -> FloatArray:
    """df/dtheta in the camera's frame, (..., 3, 2)."""
    by_1 = vector_mm(p, 0.0 * tip.across, tip.sagittal_1)
    by_2 = vector_mm(p, tip.across_2, tip.sagittal_2)
    return np.stack([by_1, by_2], axis=-1)


def rest_at(p: Parameters, drive: Drive, start_rad: FloatArray) -> FloatArray:
    """Bending angles at rest, (..., 2), found by Newton's method from a guess."""
    theta = start_rad
    for _ in range(_NEWTON_LIMIT):
        step = np.stack(_newton_step(pose_at(p, theta, drive)), axis=-1)
        theta = theta + np.clip(step, -_LONGEST_STEP_RAD, _LONGEST_STEP_RAD)
        if np.abs(step).max() < _REST_RAD:
            break
    return theta


def likely_bending_rad(p: Parameters, q_rad: FloatArray) -> FloatArray:
    """Rest without gravity and sag, to start a search from; (..., 2)."""
    gain = np.array((p.gain_1, p.gain_2))
    slack = np.array((p.slack_1_rad, p.slack_2_rad))
    compliance = np.array((p.compliance_1, p.compliance_2))
    taut = np.maximum(np.abs(q_rad) - slack, 0.0)
    bending: FloatArray = np.sign(q_rad) * gain * taut / (1.0 + compliance)
    return bending


def _newton_step(pose: Pose) -> tuple[Number, Number]:
    k_11 = pose.stiffness_11 + _shortfall(pose.stiffness_11)
    k_22 = pose.stiffness_22 + _shortfall(pose.stiffness_22)
    determinant = k_11 * k_22 - pose.stiffness_12 * pose.stiffness_12
    determinant = determinant + _shortfall(determinant)
    return (
        (pose.stiffness_12 * pose.moment_2 - k_22 * pose.moment_1) / determinant,
        (pose.stiffness_12 * pose.moment_1 - k_11 * pose.moment_2) / determinant,
    )


def _shortfall(stiffness: Number) -> Number:
    return _positive(_LEAST_STIFFNESS - stiffness)


def setpoints_for(p: Parameters, theta_rad: FloatArray, side: FloatArray) -> FloatArray:
    """Setpoints that hold given bending angles, the exact inverse of rest.

    Where a tendon pair changes over, the exact inverse jumps by twice the slack; the jump is
    blended over a narrow span of moments.

    Args:
        p: parameters, floats.
        theta_rad: bending angles, (..., 2).
        side: direction from which they are reached, (..., 2), from -1 to 1.

    Returns:
        Setpoints, (..., 2).
    """
    theta_1, theta_2 = theta_rad[..., 0], theta_rad[..., 1]
    load = _loads(p, theta_1, theta_2, _shape_of(theta_1, theta_2))
    sag_12 = p.sag_1 * theta_1 * theta_1
    pull_2 = load.moment_2 + p.friction_2 * side[..., 1]
    lever_2 = np.where(pull_2 < 0, -1.0, 1.0) + 2.0 * p.sag_2 * theta_2
    stretch_2 = p.compliance_2 / p.stiffness_ratio * np.abs(pull_2 / lever_2)
    tension_2 = np.abs(pull_2 / lever_2)
    excess_2 = p.gain_2 * p.slack_2_rad + p.sag_2 * theta_2 * theta_2 + sag_12
    pull_1 = load.moment_1 + p.friction_1 * side[..., 0] - tension_2 * 2.0 * p.sag_1 * theta_1
    lever_1 = np.where(pull_1 < 0, -1.0, 1.0) + 2.0 * p.sag_1 * theta_1
    stretch_1 = p.compliance_1 * np.abs(pull_1 / lever_1)
    excess_1 = p.gain_1 * p.slack_1_rad + sag_12
    wound_1 = np.tanh(pull_1 / _CHANGE_OVER) * excess_1 + np.sign(pull_1) * stretch_1
    wound_2 = np.tanh(pull_2 / _CHANGE_OVER) * excess_2 + np.sign(pull_2) * stretch_2
    shaft = np.stack([(theta_1 + wound_1) / p.gain_1, (theta_2 + wound_2) / p.gain_2], axis=-1)
    return np.asarray(shaft + p.play_rad * side)


class _Load(NamedTuple):
    """Gradient and second derivatives of bending and gravity energy."""

    moment_1: Number
    moment_2: Number
    stiffness_11: Number
    stiffness_12: Number
    stiffness_22: Number


def _loads(p: Parameters, theta_1: Number, theta_2: Number, shape: _Shape) -> _Load:
    """Spring and gravity, the latter through the heights of markers and segments.

    A segment's weight acts at the mean of its points, by Simpson's rule (2 E(t/2) + E(t)) / 6.
    """
    weight_1 = _SEGMENT_1_SHARE * p.body_per_mm * p.length_1_mm
    weight_2 = _SEGMENT_2_SHARE * p.body_per_mm * p.length_2_mm
    markers = _MARKER_2_SHARE * p.body_per_mm + p.tip_per_mm
    carried = (markers + _SEGMENT_2_SHARE * p.body_per_mm) * p.length_1_mm
    tip = p.tip_per_mm * p.length_2_mm
    arc_1, arc_2, half_1, half_2, turn = shape
    along = weight_2 * (2.0 * half_2[0].real + arc_2[0].real) / 6.0 + tip * arc_2[0].real
    along_2 = weight_2 * (half_2[1].real + arc_2[1].real) / 6.0 + tip * arc_2[1].real
    along_22 = weight_2 * (0.5 * half_2[2].real + arc_2[2].real) / 6.0 + tip * arc_2[2].real
    turning = (along + 1j * markers * p.marker_offset_mm) * turn
    height_1 = weight_1 * (half_1[1] + arc_1[1]) / 6.0 + carried * arc_1[1] + 1j * turning
    height_11 = weight_1 * (0.5 * half_1[2] + arc_1[2]) / 6.0 + carried * arc_1[2] - turning
    return _Load(
        theta_1 + height_1.imag,
        p.stiffness_ratio * theta_2 + along_2 * turn.imag,
        1.0 + height_11.imag,
        along_2 * turn.real,
        p.stiffness_ratio + along_22 * turn.imag,
    )


def _pose(p: Parameters, theta_1: Number, theta_2: Number, drive: Drive, shape: _Shape) -> Pose:
    side_1, side_2 = _split(drive.side)
    q_1, q_2 = _split(drive.setpoint_rad)
    moment_1, moment_2, stiffness_11, stiffness_12, stiffness_22 = _loads(
        p, theta_1, theta_2, shape
    )
    moment_1 = moment_1 + p.friction_1 * side_1
    moment_2 = moment_2 + p.friction_2 * side_2
    spring_1 = 1.0 / p.compliance_1
    spring_2 = p.stiffness_ratio / p.compliance_2
    sag_1 = p.sag_1 * theta_1 * theta_1
    sag_1_slope = 2.0 * p.sag_1 * theta_1
    sag_2 = p.sag_2 * theta_2 * theta_2
    sag_2_slope = 2.0 * p.sag_2 * theta_2
    wound_1 = p.gain_1 * (q_1 - p.play_rad * side_1) - theta_1
    wound_2 = p.gain_2 * (q_2 - p.play_rad * side_2) - theta_2
    excess_1 = p.gain_1 * p.slack_1_rad + sag_1
    excess_2 = p.gain_2 * p.slack_2_rad + sag_2 + sag_1
    for side in (1.0, -1.0):
        lever = side + sag_1_slope
        stretch = side * wound_1 - excess_1
        pull = spring_1 * _positive(stretch)
        taut = spring_1 * (stretch > 0.0)
        moment_1 = moment_1 - pull * lever
        stiffness_11 = stiffness_11 + taut * lever * lever - 2.0 * p.sag_1 * pull

        lever = side + sag_2_slope
        stretch = side * wound_2 - excess_2
        pull = spring_2 * _positive(stretch)
        taut = spring_2 * (stretch > 0.0)
        moment_1 = moment_1 - pull * sag_1_slope
        moment_2 = moment_2 - pull * lever
        stiffness_11 = stiffness_11 + taut * sag_1_slope * sag_1_slope - 2.0 * p.sag_1 * pull
        stiffness_12 = stiffness_12 + taut * sag_1_slope * lever
        stiffness_22 = stiffness_22 + taut * lever * lever - 2.0 * p.sag_2 * pull
    return Pose(
        moment_1,
        moment_2,
        stiffness_11,
        stiffness_12,
        stiffness_22,
        _tip(p, theta_1, theta_2, shape.arc_1, shape.arc_2, shape.turn_1),
    )


def _tip(
    p: Parameters,
    theta_1: Number,
    theta_2: Number,
    arc_1: tuple[Number, ...],
    arc_2: tuple[Number, ...],
    turn: Number,
) -> Tip:
    short_1 = _SHORTENING * p.sag_1 / (p.gain_1 * p.length_1_mm)
    short_2 = _SHORTENING * p.sag_2 / (p.gain_2 * p.length_2_mm)
    reach_1 = p.length_1_mm * (1.0 - short_1 * theta_1 * theta_1)
    reach_2 = p.length_2_mm * (1.0 - short_2 * theta_2 * theta_2)
    reach_1_slope = -2.0 * short_1 * theta_1 * p.length_1_mm
    reach_2_slope = -2.0 * short_2 * theta_2 * p.length_2_mm
    turning = (reach_2 * arc_2[0].real + 1j * p.marker_offset_mm) * turn
    bulge, bulge_1, bulge_2 = _bulge_mm(p, theta_1, theta_2, arc_1, turn)
    return Tip(
        reach_2 * arc_2[0].imag,
        reach_2 * arc_2[1].imag + reach_2_slope * arc_2[0].imag,
        reach_1 * arc_1[0] + turning + bulge - 1j * p.marker_offset_mm,
        reach_1 * arc_1[1] + reach_1_slope * arc_1[0] + 1j * turning + bulge_1,
        (reach_2 * arc_2[1].real + reach_2_slope * arc_2[0].real) * turn + bulge_2,
    )


def _bulge_mm(
    p: Parameters, theta_1: Number, theta_2: Number, arc_1: tuple[Number, ...], turn: Number
) -> tuple[Number, Number, Number]:
    """How gravity, strongest at the base, bends segment 1 unevenly; slopes in both angles.

    Bending angle gamma (u - u^2) at the share u of the length moves the segment's end by
    gamma L_1 D with D = E' + i E''; its energy is gamma^2 / 6 and the load's gamma load Im D.
    Pulling tendons soften it, as they soften every bending of a chain with sag; how hard they
    pull is taken from the loads of a straight robot.
    """
    load = ((1.0 - 0.5 * _SEGMENT_1_SHARE) * p.body_per_mm + p.tip_per_mm) * p.length_1_mm
    beyond = (0.5 * _SEGMENT_2_SHARE * p.body_per_mm + p.tip_per_mm) * p.length_2_mm
    weight = 0.5 * load + beyond
    pull_1 = theta_1 + weight * turn.real
    pull_2 = p.stiffness_ratio * theta_2
    margin = 1.0 - _LEAST_SOFTENED - 2.0 * p.sag_1 * (abs(pull_1) + abs(pull_2))
    softened = _LEAST_SOFTENED + _positive(margin)
    softening = 2.0 * p.sag_1 * (margin > 0.0) / softened
    reach = arc_1[1] + 1j * arc_1[2]
    reach_slope = arc_1[2] + 1j * arc_1[3]
    amplitude = -3.0 * load * p.length_1_mm / softened
    bulge = amplitude * reach.imag * reach
    slope = amplitude * (reach_slope.imag * reach + reach.imag * reach_slope)
    return (
        bulge,
        slope + bulge * softening * _sign(pull_1) * (1.0 - weight * turn.imag),
        bulge * softening * _sign(pull_2) * p.stiffness_ratio,
    )


_SHORTENING = 2.0 / 3.0 * 12.5
"""A chain of n hinges ends short of its arc by theta^2 / (12 n^2), and its sag is
L / (8 n^2 r_c): the former is 2/3 r_c / L of the latter, with r_c = r_p / gain and the paper's r_p.
The effect is below 1 mm, so another pulley's r_p is not worth a parameter."""


def _positive(x: Number) -> Number:
    """max(x, 0), of floats and arrays."""
    return 0.5 * (x + abs(x))


def _sign(x: Number) -> Number:
    """1 or -1, of floats and arrays."""
    return 2.0 * (x > 0.0) - 1.0


def parameters_of(vector: FloatArray | Sequence[float]) -> Parameters:
    """Floats from a vector, (COUNT,)."""
    return Parameters(*map(float, vector))
