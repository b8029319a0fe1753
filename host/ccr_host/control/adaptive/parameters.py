"""The uncertain parameters of the static model, and their prior."""

from __future__ import annotations

import copy
import math
from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from ccr_host.control.adaptive.parameter_space import (
    BEFORE_SETUP_TURN_RAD,
    BEFORE_SETUP_ZERO_RAD,
    Gravity,
    Mounting,
    ParameterSpace,
    Prior,
    Roles,
)
from ccr_host.core.arrays import Array, Number
from ccr_host.description.schema import Description, Robot
from ccr_host.description.simulation import Tracker

SEGMENT_1_SHARE, MARKER_2_SHARE, SEGMENT_2_SHARE = 0.4, 0.25, 0.35
"""Fractions of the weight without the tip, for a printed robot like the paper's. The stiffness
ratio and the tip's weight compensate for errors of these."""


class Parameters(NamedTuple):
    """The uncertain parameters; floats, or arrays that broadcast."""

    length_1_mm: Number
    length_2_mm: Number
    marker_offset_mm: Number
    gain_1: Number
    """theta_1 / phi_1 of inextensible, taut tendons: r_p / r_c."""
    gain_ratio: Number
    """Ratio of the gains, segment 2 to segment 1."""
    compliance_1: Number
    """k_1 / (k_t r_c^2): the additional motor angle due to the stretch of the tendons."""
    compliance_2: Number
    slack_1_rad: Number
    """Motor angle that takes up the slack of a straight segment."""
    slack_2_rad: Number
    sag_1: Number
    """Slack in units of r_c that bending adds per theta_1^2, as the holes of a bent segment get
    closer on both sides."""
    sag_2: Number
    body_per_mm: Number
    """Weight of everything except the tip, divided by k_1."""
    tip_per_mm: Number
    """Weight at the tip (marker, tool, payload), divided by k_1."""
    stiffness_ratio: Number
    """k_2 / k_1."""
    turn_x_rad: Number
    """Rotation vector of the camera relative to the robot, of length 2 tan(angle / 2)."""
    turn_y_rad: Number
    turn_z_rad: Number
    backlash_rad: Number
    """Angle by which a servo lags behind its setpoint, on the side it came from."""
    friction_1: Number
    """Friction moment of a segment, divided by k_1."""
    friction_ratio: Number
    """Ratio of the friction moments, segment 2 to segment 1."""
    push_x_per_mm: Number
    """Steady force on the tip, divided by k_1, along two axes at right angles to gravity: x and y
    of (10) in a robot mounted as usual. Along gravity it is weight."""
    push_y_per_mm: Number
    zero_1_rad: Number = 0.0
    """Setpoint at which a shaft is at 0, given by the horn's position on the spline. Half the
    difference in slack of a pair's tendons has the same effect."""
    zero_2_rad: Number = 0.0
    middle_along_mm: Number = 0.0
    """Offset of M2 from its nominal place: along the backbone, away from it, and along f[0]."""
    middle_up_mm: Number = 0.0
    middle_aside_mm: Number = 0.0
    shortening: Number = 0.0
    """Shortening of segment 1 by a tension of k_1 / r_c, divided by r_c: k_1 / (r_c^2 times its
    axial stiffness). Segment 2 yields as much per length."""
    taper_1: Number = 0.0
    """Share by which segment 1 is bent more at its end than at its start."""
    taper_2: Number = 0.0
    stiffening: Number = 0.0
    """Share by which a segment resists more than linearly at 1 rad; it grows as the square."""
    plane_1_rad: Number = 0.0
    """Turn of a segment's bending plane about the backbone, from z towards x of (10)."""
    plane_2_rad: Number = 0.0
    marker_along_mm: Number = 0.0
    """Offset of all markers along the backbone and along f[0], beside that away from it."""
    marker_aside_mm: Number = 0.0
    sideways: Number = 0.0
    """k_1 over the stiffness of segment 1 across its bending plane."""
    twisting: Number = 0.0
    """k_1 over the torsional stiffness of segment 1."""
    creep: Number = 0.0
    """Share of its stiffness by which a segment resists a new bend more, until it has crept."""
    up_x: Number = 0.0
    """Unit vector against gravity in the frame of (10). It is described, not estimated."""
    up_y: Number = 0.0
    up_z: Number = 1.0
    tendon_radius_mm: Number = 4.5
    """r_c as described."""

    @property
    def gain_2(self) -> Number:
        """theta_2 / phi_2."""
        return self.gain_1 * self.gain_ratio

    @property
    def friction_2(self) -> Number:
        """Friction moment of segment 2, divided by k_1."""
        return self.friction_1 * self.friction_ratio


FIELDS = len(Parameters._fields)
COUNT = Parameters._fields.index("up_x")
"""Number of the uncertain ones, which come first."""


def numbers_of(*names: str) -> list[int]:
    """Places of parameters among the scores."""
    return [Parameters._fields.index(name) for name in names]


TURNS = numbers_of("turn_x_rad", "turn_y_rad", "turn_z_rad")
ZEROS = numbers_of("zero_1_rad", "zero_2_rad")
PUSHES = numbers_of("push_x_per_mm", "push_y_per_mm")
_ROLES = Roles(
    drifting=numbers_of("compliance_1", "compliance_2", "slack_1_rad", "slack_2_rad", "tip_per_mm"),
    hindrances=numbers_of("backlash_rad", "friction_1"),
    warming=ZEROS,
    loads=[*numbers_of("tip_per_mm"), *PUSHES],
    pushes=PUSHES,
    varying=[
        number
        for number, name in enumerate(Parameters._fields[:COUNT])
        if not name.startswith(("length", "marker_offset", "gain", "slack", "turn", "zero"))
    ],
    turns=TURNS,
)
"""Threads creep and tools change, while the geometry stays constant."""
_ZEROS_1_RAD = np.radians((-12.0, -6.0, 0.0, 6.0, 12.0))
_ZEROS_2_RAD = np.radians((-10.0, -5.0, 0.0, 5.0, 10.0))
"""Zeros from which the fit may start. Friction distorts the cost, so that a single start can end in
a local minimum, most of all along the zero of motor 1, which looks like a turn about x."""
_MOUNTINGS = [
    (sign * x + 0.0, sign * y + 0.0, sign * z + 0.0)
    for x, y, z in np.eye(3).tolist()
    for sign in (1.0, -1.0)
]
_FEW_START_RAD = math.radians(3.0)
"""Zeros from which the fit to few rests may start."""
_SAME_DIRECTION = 0.9
"""Cosine of the angle within which a mounting is the described one."""
_USUAL_TURN_DEG = 0.5
"""Standard deviation of a registration that does not state it."""
_LEAST_TURN_DEG = 0.1
_ALIGNED = 0.1
"""Factor of the turn's deviation for an aligned camera: 0.3 deg, as a registration states."""
_STRONG_EVIDENCE = 6.0
"""Twice the logarithm of odds of 20 to 1, from which evidence is called strong (Kass and Raftery,
Bayes factors, J. Am. Stat. Assoc. 90, 1995)."""
_USUALLY_SMALL = (
    "plane_1_rad", "plane_2_rad", "taper_1", "taper_2", "stiffening", "sideways", "twisting",
    "marker_along_mm", "marker_aside_mm", "creep",
)  # fmt: skip
_ZERO_FREEDOM = 3.0
"""Factor by which zeros may be further off than assumed where there are few rests."""
_SURPRISE_OF_FEW = 2.5
"""Limit for few rests, as the first moves change what creeps and rubs."""
_NARROW = 0.05
"""Factor of their deviations for a robot without such faults."""
_FREE_ZERO_RAD = 0.8
"""Range of the zeros: the horn of a servo fits on its spline every 14.4 deg."""


def prior_of(robot: Robot) -> Prior:
    """The prior, from the description alone.

    The geometry is known to a few per cent. The rest are assumptions about a printed robot with
    thread tendons: 1 mm of slack, tendons four times stiffer than the flexures, gravity bending it
    by a third of a radian, servo zeros as accurate as the camera's alignment, M2 placed within half
    a millimetre. Bounds keep the model meaningful, whatever is measured.
    """
    length_1, length_2 = robot.segment_lengths_mm
    offset = robot.marker_offset_mm
    gain = robot.pulley_radius_mm / robot.tendon_radius_mm
    slack_unit = 1.0 / robot.pulley_radius_mm
    length, turn = (0.07, 0.6, 1.5), (0.0, 0.06, -0.3, 0.3)
    compliance, sag = (0.25, 0.15, 0.02, 1.2), (0.04, 0.03, 0.0, 0.15)
    slack = (slack_unit, 0.6 * slack_unit, 0.0, 4.0 * slack_unit)
    push = (0.0, 0.0015, -0.01, 0.01)
    zero = (0.0, turn[1], -0.3, 0.3)
    glue = (0.0, 0.5, -3.0, 3.0)
    plane = (0.0, 0.02, -0.1, 0.1)
    taper = (0.0, 0.15, -0.5, 0.5)
    rows = Parameters(
        length_1_mm=(length_1, *(length_1 * share for share in length)),
        length_2_mm=(length_2, *(length_2 * share for share in length)),
        marker_offset_mm=(offset, 0.1 * offset or 0.1, 0.6 * offset, 1.5 * offset or 1.0),
        gain_1=(gain, 0.12 * gain, 0.6 * gain, 1.5 * gain),
        gain_ratio=(1.0, 0.03, 0.8, 1.25),
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
        backlash_rad=(0.0, 0.01, 0.0, 0.03),
        friction_1=(0.0, 0.15, 0.0, 0.8),
        friction_ratio=(1.0, 0.3, 0.3, 3.0),
        push_x_per_mm=push,
        push_y_per_mm=push,
        zero_1_rad=zero,
        zero_2_rad=zero,
        middle_along_mm=glue,
        middle_up_mm=glue,
        middle_aside_mm=glue,
        shortening=(0.0, 0.08, 0.0, 0.6),
        plane_1_rad=plane,
        plane_2_rad=plane,
        sideways=(0.0, 0.02, 0.0, 0.3),
        twisting=(0.0, 0.3, 0.0, 2.0),
        marker_along_mm=glue,
        marker_aside_mm=glue,
        taper_1=taper,
        taper_2=taper,
        stiffening=(0.0, 0.05, -0.1, 0.4),
        creep=(0.0, 0.05, 0.0, 0.3),
    )
    return Prior(*np.array(rows[:COUNT], dtype=np.float64).T)


def up_in_sagittal_plane(p: Parameters) -> Number:
    """A complex number u: the height of a point s of the sagittal plane is Im(s u)."""
    return p.up_z - 1j * p.up_y


def parameters_of(vector: Array | Sequence[float]) -> Parameters:
    """Convert a vector, (COUNT,) or (FIELDS,), to floats."""
    return Parameters(*map(float, vector))


class Scaling(ParameterSpace[Parameters]):
    """The parameters of the paper's robot as scores.

    Args:
        robot: section of the description for the prior.
        turn_deviation_rad: standard deviation of the camera's rotation, about each axis or about
            x, y and z, (3,), if it was registered.
        zero_deviation_rad: standard deviation of the servos' zeros, if not that of the prior.
        noise_mm: RMS length of the error of a measured vector between two markers.
    """

    def __init__(
        self,
        robot: Robot,
        turn_deviation_rad: Array | float | None = None,
        zero_deviation_rad: float | None = None,
        noise_mm: float = Tracker().noise_mm,
    ) -> None:
        prior = prior_of(robot)
        up = -np.array(robot.gravity_direction)
        self._known = np.append(up, robot.tendon_radius_mm)
        self._is_turn_known = turn_deviation_rad is not None
        if turn_deviation_rad is not None:
            prior.deviation[TURNS] = turn_deviation_rad
        if zero_deviation_rad is not None:
            prior.deviation[ZEROS] = zero_deviation_rad
            prior.lower[ZEROS], prior.upper[ZEROS] = -_FREE_ZERO_RAD, _FREE_ZERO_RAD
        super().__init__(prior, _ROLES, noise_mm)

    @classmethod
    def of(cls, description: Description) -> Scaling:
        """Scaling of a description, with the accuracy of its registration, if any."""
        registration, noise_mm = description.registration, description.tracker.noise_mm
        if registration is None:
            return cls(description.robot, noise_mm=noise_mm)
        stated_deg = registration.uncertainty_deg or _USUAL_TURN_DEG
        turn_rad = np.radians(np.maximum(stated_deg, _LEAST_TURN_DEG))
        return cls(description.robot, turn_rad, noise_mm=noise_mm)

    @classmethod
    def before_setup(cls, description: Description) -> Scaling:
        """Scaling of a robot of which neither camera nor zeros are known."""
        noise_mm = description.tracker.noise_mm
        return cls(description.robot, BEFORE_SETUP_TURN_RAD, BEFORE_SETUP_ZERO_RAD, noise_mm)

    @property
    def names(self) -> Sequence[str]:
        return Parameters._fields[:COUNT]

    @property
    def zero_rad(self) -> Array:
        return np.eye(COUNT)[ZEROS] * self.deviation

    def mounting(self, score: Array) -> Mounting:
        p = self.parameters(score)
        rows = (p.length_1_mm, p.length_2_mm), (p.slack_1_rad, p.slack_2_rad), (p.gain_1, p.gain_2)
        return Mounting(*map(np.array, rows))

    def starts(self) -> Array:
        scores = np.zeros((len(_ZEROS_1_RAD), len(_ZEROS_2_RAD), COUNT))
        scores[..., ZEROS[0]] = _ZEROS_1_RAD[:, None] / self.deviation[ZEROS[0]]
        scores[..., ZEROS[1]] = _ZEROS_2_RAD / self.deviation[ZEROS[1]]
        return scores

    def few_starts(self) -> Array:
        """The prior, then zeros of both signs."""
        scores = np.zeros((5, COUNT))
        scores[1:, ZEROS] = np.array([(-1, -1), (-1, 1), (1, -1), (1, 1)]) * _FEW_START_RAD
        scores[:, ZEROS] /= self.deviation[ZEROS]
        return scores

    def mountings(self) -> Mapping[Gravity, Scaling]:
        """The prior under gravity along each axis of (10)'s frame but the described direction."""
        up = self._known[:3]
        return {way: self.mounted(way) for way in _MOUNTINGS if -(up @ way) < _SAME_DIRECTION}

    def parameters(self, score: Array) -> Parameters:
        """The parameters of scores, as floats."""
        return parameters_of(np.append(self._mean + self.deviation * score, self._known))

    def each(self, scores: Array) -> Parameters:
        """The parameters of several sets of scores, (n, COUNT), as arrays, (n,)."""
        rows = np.empty((len(scores), FIELDS))
        rows[:, :COUNT], rows[:, COUNT:] = self._mean + self.deviation * scores, self._known
        return Parameters(*rows.T)

    def mounted(self, gravity: Gravity) -> Scaling:
        """The same robot under gravity in another direction, a unit vector in the frame of (10)."""
        other = copy.copy(self)
        other._known = np.append(-np.array(gravity), self._known[3])
        return other

    def by_shaft(self, shaft_rad: float) -> Array:
        scores = np.zeros((COUNT, len(ZEROS)))
        scores[ZEROS, range(len(ZEROS))] = shaft_rad / self.deviation[ZEROS]
        return scores

    def priors(self) -> tuple[Scaling, Scaling]:
        """The wide prior leaves the turn of an unregistered camera more uncertain.

        By 1 deg instead of 0.7 about x, which a robot without the faults that it allows for need
        not accept.
        """
        return self, self.narrow()

    def aligned(self) -> Scaling | None:
        """The prior for a camera that was never registered but stands as described."""
        if self._is_turn_known:
            return None
        other = self.freed(TURNS, _ALIGNED)
        other.doubt = _STRONG_EVIDENCE
        return other

    def narrow(self) -> Scaling:
        """The prior for a robot without the faults of cheap parts."""
        return self.freed(numbers_of(*_USUALLY_SMALL), _NARROW)

    def strict(self) -> Scaling:
        """The prior for the described robot, except for what every robot leaves open."""
        other = self.narrow()
        other.shaft_rad = 0.0
        return other

    def of_few_rests(self) -> Scaling:
        other = self.freed(ZEROS, _ZERO_FREEDOM)
        other.most_surprise = _SURPRISE_OF_FEW
        other.farther_moves_tell = True
        return other

    def freed(self, indices: Sequence[int], factor: float) -> Scaling:
        """Widen the deviation and the bounds of some parameters by a factor."""
        other = copy.copy(self)
        lower, upper = (self._mean + self.deviation * end for end in (self._lower, self._upper))
        other.deviation = self.deviation.copy()
        for index in indices:
            mean = self._mean[index]
            other.deviation[index] *= factor
            upper[index] = mean + factor * (upper[index] - mean)
            lower[index] *= factor if mean == 0.0 else 0.5
        other._lower = (lower - other._mean) / other.deviation
        other._upper = (upper - other._mean) / other.deviation
        return other
