"""The twin's mechanics as MJCF (MuJoCo's model format).

Rigid disks on flexures, straight along -y at zero bending: a hinge each in a segment that bends in
a plane, two at a right angle in one that bends in any direction. Angles about the backbone count
from x towards z of (10); bending by a positive angle moves the tip in that direction. MJCF uses m,
kg, s, N.
"""

from __future__ import annotations

import math
from xml.etree import ElementTree as ET

import mujoco

from ccr_host.description.robot import tendons_of
from ccr_host.description.simulation import Twin
from ccr_host.robot.chain import exact_direction

Vector = tuple[float, float, float]

DISKS = "disk{}"
TIP = "tip"
MARKERS = "M{}"

_MM = 1e-3
_MS = 1e-3
_G = 1e-3
_DISK_RIM_MM = 1.5
"""Distance from a hole's centre to the edge of the disk; affects only the disk's inertia."""
_DISK_THICKNESS_MM = 2.0
_MARKER_RADIUS_MM = 5.75
"""NDI's passive spheres have a diameter of 11.5 mm."""
_ARMATURE_KG_M2 = 1e-8
"""Inertia of the flexure itself, about that of a 0.3 g piece 5 mm long."""
_RELAXATION_S = 2e-3
"""Damping over stiffness of the joints that do not bend. Their modes are too fast to be seen; from
half a time step on, MuJoCo's implicit damping keeps them stable at any stiffness."""
_FRICTION_ITERATIONS = "15"
"""The tip was 0.008 mm beside the exact solution in the one motion compared."""
_FRICTION_SOLREF = "0.001 1"
_FRICTION_SOLIMP = "0.9999 0.9999 0.001"
"""Nearly hard: MuJoCo's dry friction creeps, here by about 1 um/s at the tip (docs/twin.md)."""
_HALF_A_TURN = "0 180"
"""Degrees. Ranges do not limit the joints: `Mechanics` ends the simulation there."""
_ALONG_BACKBONE = (0.0, -1.0, 0.0)
_QUARTER_DEG = 90.0
_SPATIAL_TURNS_DEG = (0.0, 90.0, 45.0, 135.0)
"""Turn about the backbone of the first of two hinges, flexure by flexure. Bent by both, two hinges
also twist the robot, which those of the next flexure undo in the other order."""
_CUBED_BY_BOTH = 4 / 3
"""Two hinges that stiffen by their own angle alone resist 3/4 of what one would, as a mean over the
directions."""


def robot_model(twin: Twin) -> mujoco.MjModel:
    """The compiled model.

    MuJoCo would print its warnings, and write them to a file in the working folder.
    """
    mujoco.set_mju_user_warning(_ignore)
    return mujoco.MjModel.from_xml_string(robot_mjcf(twin))


def _ignore(_: str) -> None:
    """What makes a difference, `Mechanics` finds in the joints."""


def robot_mjcf(twin: Twin) -> str:
    """Model of the unloaded robot for MuJoCo.

    Sites ``M1`` to ``M{S+1}`` are the markers at the base and the end of each of S segments,
    ``disk0`` ... ``diskN`` the centres of the disks from base to tip. The massless body ``tip`` at
    the last centre carries the push and the payload. Actuator i pulls tendon i towards its control
    value, a length in m; MuJoCo computes the tendon lengths at zero bending, without slack.
    """
    root = ET.Element("mujoco", model="tendon-driven continuum robot")
    _add_options(root, twin)
    base = ET.SubElement(ET.SubElement(root, "worldbody"), "body", name="base")
    _add_disk_sites(base, twin, number=0, y_mm=0.0)
    _add_marker_site(base, twin, MARKERS.format(1), y_mm=0.0)
    _add_segments(base, twin)
    _add_tendons(root, twin)
    ET.indent(root)
    return ET.tostring(root, encoding="unicode")


def _add_options(root: ET.Element, twin: Twin) -> None:
    option = ET.SubElement(
        root,
        "option",
        timestep=_numbers(twin.time_step_ms * _MS),
        gravity=_numbers(*twin.gravity_m_s2),
        integrator="implicitfast",
        # For the friction of the tendons; the other solvers work on all joints.
        solver="PGS",
        iterations=_FRICTION_ITERATIONS,
    )
    # No contacts; instability is reported (mechanics.py), not hidden by an automatic reset. All
    # joints are of one island, which MuJoCo need not look for.
    flags = {"contact": "disable", "autoreset": "disable", "island": "disable"}
    if twin.friction == 0:
        flags["constraint"] = "disable"
    ET.SubElement(option, "flag", flags)


def _add_segments(base: ET.Element, twin: Twin) -> None:
    """Chain the disks of all segments, each flexure half a pitch before its disk."""
    parent, number, half_pitch_before_mm = base, 0, 0.0
    for segment, flexures in enumerate(twin.flexures):
        half_pitch_mm = twin.segment_lengths_mm[segment] / flexures / 2
        for flexure in range(flexures):
            number += 1
            body = ET.SubElement(
                parent,
                "body",
                name=DISKS.format(number),
                pos=_millimetres(0.0, -half_pitch_before_mm - half_pitch_mm, 0.0),
            )
            _add_flexure(body, twin, segment, flexure)
            _add_disk(body, twin, segment, y_mm=-half_pitch_mm)
            _add_disk_sites(body, twin, number, y_mm=-half_pitch_mm)
            parent, half_pitch_before_mm = body, half_pitch_mm
        _add_marker(parent, twin, MARKERS.format(segment + 2), y_mm=-half_pitch_mm)
    _add_tip(parent, y_mm=-half_pitch_before_mm)


def _add_tip(last_disk: ET.Element, y_mm: float) -> None:
    tip = ET.SubElement(last_disk, "body", name=TIP, pos=_millimetres(0.0, y_mm, 0.0))
    # Without this, MuJoCo places the centre of mass elsewhere.
    ET.SubElement(tip, "inertial", pos="0 0 0", mass="0", diaginertia="0 0 0")


def _add_flexure(body: ET.Element, twin: Twin, segment: int, number: int) -> None:
    """Joints of flexure ``number``, from 0, of a segment.

    Springs in series: n flexures of stiffness n k form a segment of stiffness k. It twists by
    halves before and after it bends: a taut tendon beside it would twist a hinge on one side only.
    """
    flexures = twin.flexures[segment]
    is_planar = twin.segments[segment].bends == "plane"
    direction_deg = twin.segments[segment].direction_deg - twin.bending_plane_turn_deg[segment]
    share, torsion = _shares(flexures)[number] / flexures, 0.0
    if share > 0:
        stands_for_mm = share * twin.segment_lengths_mm[segment]
        axial = twin.axial_stiffness_n_m[segment] / share
        torsion = 2.0 * twin.torsion_stiffness_nm_rad[segment] / share
        _add_joint(body, "slide", _ALONG_BACKBONE, axial, _millimetres(0.0, stands_for_mm / 2))
        _add_joint(body, "hinge", _ALONG_BACKBONE, torsion, _HALF_A_TURN)
        if is_planar:
            sideways = twin.sideways_stiffness_nm_rad[segment] / share
            axis = _bending_axis(direction_deg + _QUARTER_DEG)
            _add_joint(body, "hinge", axis, sideways, _HALF_A_TURN)
    bending = _bending_stiffness_nm_rad(twin, segment)[number]
    per_rad2 = twin.stiffening[segment] * (flexures / (math.pi / 2)) ** 2
    if is_planar:
        _add_bending_joint(body, twin, direction_deg, bending, per_rad2)
    else:
        direction_deg += _SPATIAL_TURNS_DEG[number % len(_SPATIAL_TURNS_DEG)]
        for turned_deg in (direction_deg, direction_deg + _QUARTER_DEG):
            _add_bending_joint(body, twin, turned_deg, bending, _CUBED_BY_BOTH * per_rad2)
    _add_joint(body, "hinge", _ALONG_BACKBONE, torsion, _HALF_A_TURN)


def _add_bending_joint(
    body: ET.Element, twin: Twin, direction_deg: float, stiffness: float, per_rad2: float
) -> None:
    """A hinge of some stiffness, which grows with the square of its angle."""
    joint = ET.SubElement(
        body,
        "joint",
        type="hinge",
        axis=_numbers(*_bending_axis(direction_deg)),
        stiffness=_numbers(stiffness),
        damping=_numbers(twin.joint_damping),
        armature=_numbers(_ARMATURE_KG_M2),
        limited="false",
        range=_HALF_A_TURN,
    )
    if per_rad2 > 0:
        joint.set("stiffness", _numbers(stiffness, 0.0, stiffness * per_rad2))


def _add_joint(
    body: ET.Element, kind: str, axis: Vector, stiffness: float, meaningful: str
) -> None:
    """A joint beside the bending one, unless its stiffness is 0."""
    if stiffness > 0:
        damping = stiffness * _RELAXATION_S
        ET.SubElement(
            body,
            "joint",
            type=kind,
            axis=_numbers(*axis),
            stiffness=_numbers(stiffness),
            damping=_numbers(damping),
            limited="false",
            range=meaningful,
        )


def _shares(flexures: int) -> list[int]:
    """Number of flexures for which the other joints of each flexure stand.

    The middle one of three stands for all of them, which halves the time; the end of a segment then
    gives way to a force by 6 % less.
    """
    threes = [0, 3, 0] * (flexures // 3)
    if flexures % 3 == 1:
        middle = 3 * (flexures // 6)
        return [*threes[:middle], 1, *threes[middle:]]
    return [1, *threes, 1] if flexures % 3 else threes


def _bending_stiffness_nm_rad(twin: Twin, segment: int) -> list[float]:
    """Stiffness of each flexure, which falls linearly along the segment."""
    flexures = twin.flexures[segment]
    whole = twin.bending_stiffness_nm_rad[segment]
    shares = [
        1.0 - twin.stiffness_taper[segment] * (number + 0.5) / flexures
        for number in range(flexures)
    ]
    in_series = sum(1.0 / share for share in shares)
    return [whole * in_series * share for share in shares]


def _bending_axis(direction_deg: float) -> Vector:
    """Axis about which a positive angle bends towards a direction."""
    cosine, sine = exact_direction(math.radians(direction_deg))
    return 0.0 - sine, 0.0, cosine


def _add_disk(body: ET.Element, twin: Twin, segment: int, y_mm: float) -> None:
    radius_mm = twin.tendon_radius_mm[segment] + _DISK_RIM_MM
    ET.SubElement(
        body,
        "geom",
        type="cylinder",
        size=_millimetres(radius_mm, _DISK_THICKNESS_MM / 2),
        pos=_millimetres(0.0, y_mm, 0.0),
        euler="90 0 0",
        mass=_numbers(twin.disk_mass_g * _G),
    )


def _add_disk_sites(body: ET.Element, twin: Twin, number: int, y_mm: float) -> None:
    ET.SubElement(body, "site", name=DISKS.format(number), pos=_millimetres(0.0, y_mm, 0.0))
    for name, (x_mm, z_mm) in _holes(twin, number).items():
        ET.SubElement(body, "site", name=name, pos=_millimetres(x_mm, y_mm, z_mm))


def _holes(twin: Twin, disk: int) -> dict[str, tuple[float, float]]:
    """Place of each hole of a disk across the backbone, x and z in mm.

    Where segments of different holes meet, a tendon that runs on changes over within the disk.
    """
    holes = {}
    for number, (last, tendon) in enumerate(tendons_of(twin.segments)):
        for span, (radius_mm, clocking_deg) in enumerate(_spans(twin, last)):
            if span in (disk - 1, disk):
                cosine, sine = exact_direction(math.radians(tendon.angle_deg + clocking_deg))
                name = _hole(number, disk, radius_mm, clocking_deg)
                holes[name] = radius_mm * cosine, radius_mm * sine
    return holes


def _add_marker(body: ET.Element, twin: Twin, name: str, y_mm: float) -> None:
    ET.SubElement(
        body,
        "geom",
        type="sphere",
        size=_millimetres(_MARKER_RADIUS_MM),
        pos=_marker_place(twin, y_mm),
        mass=_numbers(twin.marker_mass_g * _G),
    )
    _add_marker_site(body, twin, name, y_mm)


def _add_marker_site(body: ET.Element, twin: Twin, name: str, y_mm: float) -> None:
    ET.SubElement(body, "site", name=name, pos=_marker_place(twin, y_mm))


def _marker_place(twin: Twin, y_mm: float) -> str:
    along_x_mm, along_y_mm, along_z_mm = twin.marker_offset_mm
    return _millimetres(along_x_mm, y_mm + along_y_mm, along_z_mm)


def _add_tendons(root: ET.Element, twin: Twin) -> None:
    """Tendons from the base to the last disks of their segments."""
    tendons = ET.SubElement(root, "tendon")
    actuators = ET.SubElement(root, "actuator")
    for number, (last, _) in enumerate(tendons_of(twin.segments)):
        name = f"tendon{number + 1}"
        spatial = ET.SubElement(tendons, "spatial", name=name)
        if twin.friction > 0:
            spatial.set("frictionloss", _numbers(twin.friction))
            spatial.set("solreffriction", _FRICTION_SOLREF)
            spatial.set("solimpfriction", _FRICTION_SOLIMP)
        before = None
        for span, place in enumerate(_spans(twin, last)):
            start, end = (_hole(number, disk, *place) for disk in (span, span + 1))
            if twin.capstan_friction > 0:
                # A branch, whose share of the force `memory` sets.
                ET.SubElement(spatial, "pulley", divisor="1")
                before = None
            if start != before:
                ET.SubElement(spatial, "site", site=start)
            ET.SubElement(spatial, "site", site=end)
            before = end
        ET.SubElement(
            actuators,
            "position",
            name=name,
            tendon=name,
            kp=_numbers(twin.tendon_stiffness_n_m),
            forcerange=_numbers(-twin.tendon_force_max_n, 0.0),
        )


def _spans(twin: Twin, last: int) -> list[tuple[float, float]]:
    """Distance from the backbone in mm and clocking in deg of each span of a tendon.

    Args:
        twin: the robot.
        last: number, from 0, of the segment with which the tendon ends.
    """
    clocking_deg = [segment.clocking_deg for segment in twin.segments]
    passed = zip(twin.tendon_radius_mm, clocking_deg, twin.flexures[: last + 1], strict=False)
    return [(radius, clocking) for radius, clocking, spans in passed for _ in range(spans)]


def _hole(tendon: int, disk: int, radius_mm: float, clocking_deg: float) -> str:
    return f"tendon{tendon + 1}_disk{disk}_{radius_mm:.12g}mm{clocking_deg:.12g}deg"


def _millimetres(*lengths_mm: float) -> str:
    return _numbers(*(length * _MM for length in lengths_mm))


def _numbers(*values: float) -> str:
    return " ".join(f"{value:.12g}" for value in values)
