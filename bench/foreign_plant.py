"""A second simulated robot, for judging controllers on mechanics that ours do not share.

ccr-host track 8shape --robot dirty --plant bench/foreign_plant.py:StrainRobot

It reads the keys of ``[twin]``, but is not a chain of hinges in MuJoCo: each segment is one elastic
rod whose strains are polynomials of the arc length (assumed strains: bending in both planes, twist,
stretch), and each tendon is a row of elastic bays between the holes that slips through a hole when
the tensions on both sides differ by more than the capstan law allows. So friction has a memory at
each hole, and a segment need not bend uniformly. There is no inertia: nothing vibrates, and nothing
shakes friction loose. Damping is a relaxation time. A push (``twin.push``) is ignored. It needs
numba (extra ``fast``); a minute of robot time takes one to two minutes to compute.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable

import numba
import numpy as np
import scipy
from numpy.typing import NDArray

import ccr_host
from ccr_host.core.errors import CcrError
from ccr_host.description.simulation import Twin

Array = NDArray[np.float64]

_STEP_US = 10_000
_MODES = 7
"""Modes of a segment: three of bending in its plane, two across it, a twist and a stretch."""
_FREE_MM = 80.0
"""Tendon between pulley and base plate, which stretches but does not rub."""
_RELAXATION_S = 0.03
"""Time constant of a segment's motion: 10 Hz and 0.15 of critical damping fade at that rate."""
_RIGID = 1e3
"""Multiple of the bending stiffness that stands for rigid: twist and bending across the plane."""
_RIGID_N_M = 1e6
_BASE_ANGLE_RAD = 0.05
"""Turn of a tendon at each hole of a straight robot, by its clearance."""
_KNEE_MM = 1e-3
"""Elongation within which a tendon goes from slack to taut, so that Newton's method converges."""


@numba.njit
def _holes(
    q: Array, geometry: tuple[Array, Array], radius_mm: float, turn: Array
) -> tuple[Array, Array, Array]:
    """Disk centres (n + 1, 3), axes (n + 1, 3, 3) and tendon holes (n + 1, 4, 3) in mm.

    Columns of an axis: across (x), tangent (-y) and up (z) of (10) while the robot is straight.
    """
    lengths, disks = geometry
    count = int(disks[0] + disks[1]) + 1
    centres, axes = np.zeros((count, 3)), np.zeros((count, 3, 3))
    holes = np.zeros((count, 4, 3))
    frame = np.array([[1.0, 0.0, 0.0], [0.0, -1.0, 0.0], [0.0, 0.0, 1.0]])
    centre = np.zeros(3)
    disk = 0
    for segment in range(2):
        own = q[segment * 7 : segment * 7 + 7]
        bays = int(disks[segment])
        step_mm = lengths[segment] / bays / 2
        if segment == 0:
            _place(centres, axes, holes, 0, centre, frame, radius_mm)
        for bay in range(bays):
            for sub in range(2):
                x = 2 * (bay + (sub + 0.5) / 2) / bays - 1
                inside = own[0] + own[1] * x + own[2] * 0.5 * (3 * x * x - 1)
                across = own[3] + own[4] * x
                share = step_mm / lengths[segment]
                # Angles by which this piece bends up (z), across (x), and twists. The bending plane
                # may be turned from z towards x.
                cosine, sine = math.cos(turn[segment]), math.sin(turn[segment])
                if segment == 0:
                    up, side = cosine * inside - sine * across, sine * inside + cosine * across
                else:
                    up, side = cosine * across - sine * inside, sine * across + cosine * inside
                up, side = up * share, side * share
                frame, along = _advanced(frame, up, side, own[5] * share)
                centre = centre + along * (step_mm * (1 + own[6]))
            disk += 1
            _place(centres, axes, holes, disk, centre, frame, radius_mm)
    return centres, axes, holes


@numba.njit
def _advanced(frame: Array, up: float, side: float, twist: float) -> tuple[Array, Array]:
    """The frame after a piece of constant strain, and the mean tangent on it."""
    # Rotation vector in the frame's axes (across, tangent, up): bending up turns the tangent to up.
    w = np.array([up, twist, -side])
    angle = math.sqrt(w[0] * w[0] + w[1] * w[1] + w[2] * w[2]) + 1e-12
    k = w / angle
    cross = np.array([[0.0, -k[2], k[1]], [k[2], 0.0, -k[0]], [-k[1], k[0], 0.0]])
    square = cross @ cross
    sine, versine = math.sin(angle), 1 - math.cos(angle)
    turned = frame @ (np.eye(3) + sine * cross + versine * square)
    mean = np.eye(3) + versine / angle * cross + (1 - sine / angle) * square
    return turned, np.ascontiguousarray((frame @ mean)[:, 1])


@numba.njit
def _place(
    centres: Array,
    axes: Array,
    holes: Array,
    disk: int,
    centre: Array,
    frame: Array,
    radius_mm: float,
) -> None:
    """Fill in a disk and its holes."""
    centres[disk] = centre
    axes[disk] = frame
    # Tendons 1, 2 bend segment 1 up and down, 3, 4 bend segment 2 to x and back.
    holes[disk, 0] = centre + radius_mm * frame[:, 2]
    holes[disk, 1] = centre - radius_mm * frame[:, 2]
    holes[disk, 2] = centre + radius_mm * frame[:, 0]
    holes[disk, 3] = centre - radius_mm * frame[:, 0]


@numba.njit
def _measures(
    q: Array,
    geometry: tuple[Array, Array],
    radius_mm: float,
    turn: Array,
    weights_n: Array,
    gravity: Array,
) -> tuple[Array, Array, float]:
    """Bay lengths (4, n) in mm, angles of the tendons at the holes (4, n), potential in N mm."""
    centres, axes, holes = _holes(q, geometry, radius_mm, turn)
    count = len(centres) - 1
    bays, angles = np.zeros((4, count)), np.zeros((4, count))
    for tendon in range(4):
        last = np.zeros(3)
        for bay in range(count):
            span = holes[bay + 1, tendon] - holes[bay, tendon]
            bays[tendon, bay] = math.sqrt((span * span).sum())
            unit = span / bays[tendon, bay]
            if bay == 0:
                last = axes[0][:, 1]
            cosine = min(1.0, max(-1.0, (unit * last).sum()))
            angles[tendon, bay] = math.acos(cosine)
            last = unit
    potential = 0.0
    for disk in range(count + 1):
        potential -= weights_n[disk] * (gravity * centres[disk]).sum()
    return bays, angles, potential


@numba.njit
def _taut(elongation_mm: float) -> float:
    """Positive part of an elongation, with a smooth knee."""
    return 0.5 * (elongation_mm + math.sqrt(elongation_mm * elongation_mm + _KNEE_MM * _KNEE_MM))


@numba.njit
def _slip(
    bays: Array,
    angles: Array,
    material: Array,
    stiffness: Array,
    friction: float,
    constant_n: float,
) -> Array:
    """Tensions (n + 1,) in N once a tendon has slipped as far as friction lets it.

    Bay 0 is the free part at the pulley. ``material`` (n + 1,), in mm, moves from bay to bay.
    """
    count = len(material)
    for _ in range(400):
        moved = 0.0
        for i in range(count - 1):
            ratio = math.exp(friction * (angles[i] + _BASE_ANGLE_RAD))
            for a, b in ((i, i + 1), (i + 1, i)):
                # Bay a pulls material out of b while T_a > ratio T_b + constant.
                t_a = stiffness[a] * _taut(bays[a] - material[a])
                t_b = stiffness[b] * _taut(bays[b] - material[b])
                excess = t_a - ratio * t_b - constant_n
                if excess > 1e-6:
                    step = excess / (stiffness[a] + ratio * stiffness[b])
                    material[a] += step
                    material[b] -= step
                    moved = max(moved, step)
        if moved < 1e-7:
            break
    tension = np.zeros(count)
    for i in range(count):
        tension[i] = stiffness[i] * _taut(bays[i] - material[i])
    return tension


@numba.njit
def _tendons(
    q: Array,
    geometry: tuple[Array, Array],
    radius_mm: float,
    turn: Array,
    weights_n: Array,
    gravity: Array,
    material: Array,
    stiffness: Array,
    friction: float,
    constant_n: float,
    ends: Array,
) -> tuple[Array, Array, Array]:
    """Generalised forces of tendons and weight (14,) in N mm, tensions, material after slip."""
    bays, angles, _ = _measures(q, geometry, radius_mm, turn, weights_n, gravity)
    moved, tension = material.copy(), np.zeros_like(material)
    for tendon in range(4):
        n = ends[tendon]
        lengths = np.concatenate((np.array([_FREE_MM]), bays[tendon, :n]))
        tension[tendon, : n + 1] = _slip(
            lengths, angles[tendon], moved[tendon, : n + 1], stiffness, friction, constant_n
        )
    forces = np.zeros(len(q))
    for k in range(len(q)):
        ahead, behind = q.copy(), q.copy()
        ahead[k] += 1e-6
        behind[k] -= 1e-6
        longer, _, higher = _measures(ahead, geometry, radius_mm, turn, weights_n, gravity)
        shorter, _, lower = _measures(behind, geometry, radius_mm, turn, weights_n, gravity)
        work = higher - lower
        for tendon in range(4):
            for bay in range(ends[tendon]):
                change = longer[tendon, bay] - shorter[tendon, bay]
                work += tension[tendon, bay + 1] * change
        forces[k] = work / 2e-6
    return forces, tension, moved


class StrainRobot(ccr_host.Plant):
    """The robot of a description's ``[twin]`` as two rods with assumed strains.

    Args:
        description: robot description.
    """

    def __init__(self, description: ccr_host.Description) -> None:
        twin = description.twin
        self._twin = twin
        self._time_us = 0
        disks = np.array(twin.flexures, dtype=float)
        self._geometry = (np.array(twin.segment_lengths_mm), disks)
        self._turn = np.radians(twin.bending_plane_turn_deg)
        count = int(disks.sum())
        masses_g = np.full(count + 1, twin.disk_mass_g)
        masses_g[[int(disks[0]), count]] += twin.marker_mass_g
        self._masses_kg = masses_g * 1e-3
        self._payload_from_us = 0 if twin.payload_start_s == 0 else None
        gravity = np.array(twin.gravity_m_s2)
        self._gravity = gravity / max(float(np.linalg.norm(gravity)), 1e-9)
        self._g = float(np.linalg.norm(gravity))
        first, second = (_stiffness(twin, segment) for segment in (0, 1))
        self._elastic = scipy.linalg.block_diag(first, second)
        ends = np.array([int(disks[0])] * 2 + [count] * 2)
        lengths = np.repeat(self._geometry[0] / disks, twin.flexures)
        all_mm = np.concatenate(([_FREE_MM], lengths))
        # A whole tendon of the mean length has the described stiffness, N/mm.
        mean_mm = _FREE_MM + self._geometry[0].sum()
        self._bay_stiffness = twin.tendon_stiffness_n_m * 1e-3 * mean_mm / all_mm
        self._ends = ends
        self._q, self._creep = np.zeros(14), np.zeros((2, 14))
        self._material = np.tile(all_mm, (4, 1))
        bays, _, _ = self._measured()
        self._material[:, 1:] = bays
        self._material[:, 0] += np.array(twin.slack_mm)
        self._wound_mm = np.zeros(4)
        self._servos = [_Servo(twin, motor) for motor in (0, 1)]
        self._pulses: deque[tuple[int, tuple[int, int]]] = deque()
        self._tension_n = np.zeros(4)
        self._jacobian: Array | None = None
        for _ in range(30):
            self._settle(_STEP_US * 1e-6)

    def set_pulses_half_us(self, pulses_half_us: tuple[int, int]) -> None:
        lag_us = round(self._twin.servo_lag_ms * 1000)
        self._pulses.append((self._time_us + lag_us, pulses_half_us))

    def start_path_clock(self, time_us: int) -> None:
        if self._twin.payload_start_s > 0:
            self._payload_from_us = time_us + round(self._twin.payload_start_s * 1e6)

    def advance_to(self, time_us: int) -> None:
        step_s = _STEP_US * 1e-6
        while self._time_us + _STEP_US <= time_us:
            self._time_us += _STEP_US
            while self._pulses and self._pulses[0][0] < self._time_us:
                pulses = self._pulses.popleft()[1]
                for servo, pulse in zip(self._servos, pulses, strict=True):
                    servo.pulse_us = pulse / 2
            moments_nm = (self._tension_n[[0, 2]] - self._tension_n[[1, 3]]) * (
                self._twin.pulley_radius_mm * -1e-3
            )
            for servo, moment_nm in zip(self._servos, moments_nm, strict=True):
                servo.advance(float(moment_nm), self._time_us * 1e-6, step_s)
            self._settle(step_s)

    def markers_mm(self) -> Array:
        centres, axes, _ = _holes(
            self._q, self._geometry, self._twin.tendon_radius_mm[0], self._turn
        )
        offset_mm = np.array(self._twin.marker_offset_mm) * (1, -1, 1)
        middle, last = self._twin.flexures[0], len(centres) - 1
        return np.array([centres[i] + axes[i] @ offset_mm for i in (0, middle, last)])

    def _measured(self) -> tuple[Array, Array, float]:
        measures: tuple[Array, Array, float] = _measures(
            self._q,
            self._geometry,
            self._twin.tendon_radius_mm[0],
            self._turn,
            self._weights_n(),
            self._gravity,
        )
        return measures

    def _weights_n(self) -> Array:
        weights_n = self._masses_kg * self._g
        if self._payload_from_us is not None and self._time_us >= self._payload_from_us:
            weights_n[-1] += self._twin.payload_g * 1e-3 * self._g
        return weights_n

    def _settle(self, step_s: float) -> None:
        """One implicit step: equilibrium of all forces with a drag against the change of strain."""
        twin = self._twin
        angles_rad = np.array([servo.output_rad for servo in self._servos])
        wound_mm = twin.pulley_radius_mm * np.repeat(angles_rad, 2) * (1, -1, 1, -1)
        material = self._material.copy()
        material[:, 0] -= wound_mm - self._wound_mm
        weights_n, rest = self._weights_n(), self._creep.sum(axis=0)
        stiffness, start = np.diag(self._elastic), self._q
        drag = stiffness * _RELAXATION_S / step_s

        def residual(q: Array) -> tuple[Array, Array, Array]:
            forces, tension, moved = _tendons(
                q,
                self._geometry,
                twin.tendon_radius_mm[0],
                self._turn,
                weights_n,
                self._gravity,
                material,
                self._bay_stiffness,
                twin.capstan_friction,
                twin.friction,
                self._ends,
            )
            elastic = self._elastic @ (q - rest)
            for segment, hardening in enumerate(twin.stiffening):
                bending = slice(segment * _MODES, segment * _MODES + 3)
                elastic[bending] *= 1 + hardening * (q[bending][0] / (math.pi / 2)) ** 2
            return forces + elastic + drag * (q - start), tension, moved

        scale, q = np.sqrt(stiffness), start
        found = residual(q)
        for attempt in range(60):
            if np.linalg.norm(found[0] / scale) < 1e-4:
                break
            if self._jacobian is None or attempt in (4, 12, 20, 30, 40, 50):
                self._jacobian = _slopes(lambda at: residual(at)[0], q, found[0])
            change = np.linalg.solve(self._jacobian, -found[0])
            for _ in range(6):
                trial = residual(q + change)
                if np.linalg.norm(trial[0] / scale) < np.linalg.norm(found[0] / scale):
                    break
                change = change / 2
                self._jacobian = None if attempt % 4 == 3 else self._jacobian
            q, found = q + change, trial
        if not np.isfinite(q).all():
            raise CcrError("the foreign plant found no equilibrium", "use milder [twin] keys")
        self._q, self._material = q, found[2]
        self._tension_n, self._wound_mm = found[1][:, 0], wound_mm
        for branch, (share, time_s) in enumerate(
            zip(twin.creep_share, twin.creep_time_s, strict=True)
        ):
            target = share * (q - self._creep.sum(axis=0))
            self._creep[branch] += (target - self._creep[branch]) * -math.expm1(-step_s / time_s)


def _slopes(function: Callable[[Array], Array], at: Array, value: Array) -> Array:
    """Forward differences, (n, n)."""
    slopes = np.zeros((len(at), len(at)))
    for k in range(len(at)):
        ahead = at.copy()
        ahead[k] += 1e-4
        slopes[:, k] = (function(ahead) - value) / 1e-4
    return slopes


def _stiffness(twin: Twin, segment: int) -> Array:
    """(7, 7) in N mm per unit of each mode, by quadrature over the arc length."""
    nodes, weights = np.polynomial.legendre.leggauss(8)
    weights = weights / 2
    bending = twin.bending_stiffness_nm_rad[segment] * 1e3
    profile = 1 - twin.stiffness_taper[segment] * (nodes + 1) / 2
    profile = profile * (weights / profile).sum()  # The same compliance as a whole.
    inside = np.array([np.ones(8), nodes, 0.5 * (3 * nodes**2 - 1)])
    matrix = np.zeros((7, 7))
    matrix[:3, :3] = bending * (inside * profile * weights) @ inside.T
    across = twin.sideways_stiffness_nm_rad[segment] * 1e3 or _RIGID * bending
    matrix[3:5, 3:5] = across * (inside[:2] * profile * weights) @ inside[:2].T
    matrix[5, 5] = twin.torsion_stiffness_nm_rad[segment] * 1e3 or _RIGID * bending
    axial_n_m = twin.axial_stiffness_n_m[segment] or _RIGID_N_M
    matrix[6, 6] = axial_n_m * 1e-3 * twin.segment_lengths_mm[segment] ** 2
    return matrix


class _Servo:
    """Deadband, droop, torque-limited speed, backlash, drift."""

    def __init__(self, twin: Twin, motor: int) -> None:
        self._twin, self._motor = twin, motor
        self.pulse_us = 0.0
        self._motor_rad = 0.0
        self.output_rad = 0.0

    def advance(self, moment_nm: float, time_s: float, step_s: float) -> None:
        twin, motor = self._twin, self._motor
        if self.pulse_us > 0:
            per_us = math.radians(90) / twin.servo_us_per_90_deg[motor]
            goal = (self.pulse_us - twin.servo_neutral_us[motor]) * per_us
            goal += math.radians(twin.servo_droop_deg_per_nm * moment_nm)
            drift = -math.expm1(-time_s / twin.servo_drift_time_s)
            goal += math.radians(twin.servo_drift_deg[motor] * drift)
            error = goal - self._motor_rad
            left = max(0.0, abs(error) - math.radians(twin.servo_deadband_deg))
            speed = math.radians(twin.servo_rate_deg_s)
            if twin.servo_stall_torque_nm is not None and error * moment_nm < 0:
                speed *= max(0.0, 1 - abs(moment_nm) / twin.servo_stall_torque_nm)
            self._motor_rad += math.copysign(min(left, speed * step_s), error)
        play = math.radians(twin.servo_backlash_deg) / 2
        # The load pushes the output to one end of the play.
        wanted = self.output_rad + math.copysign(play, moment_nm) if moment_nm else self.output_rad
        self.output_rad = min(max(wanted, self._motor_rad - play), self._motor_rad + play)
