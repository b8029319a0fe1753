"""The twin of a robot of any segments, motors and tendons."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import trapezoid
from scipy.spatial.transform import Rotation

from ccr_host.description.schema import Description, load
from ccr_host.robot.kinematics import ConstantCurvature
from ccr_host.sim.robot.equilibrium import Equilibrium
from ccr_host.sim.robot.mechanics import Mechanics
from ccr_host.sim.robot.memory import CapstanFriction

X, Y, Z = 0, 1, 2
BACKBONE = np.array([0.0, -1.0, 0.0])
IDEAL = {
    "gravity_m_s2": 0.0,
    "slack_mm": 0.0,
    "bending_stiffness_nm_rad": 0.002,
    "tendon_stiffness_n_m": 200_000.0,
}
"""Tendons that hardly stretch against a structure that hardly resists: at a tenth of this stiffness
their stretch moves the tip by up to 0.3 mm, which can hide the error of few flexures."""
EVERYTHING = (
    *("twin.capstan_friction=0.15", "twin.friction=0.1", "twin.creep_share=0.05"),
    *("twin.stiffness_taper=0.1", "twin.stiffening=0.2", "twin.torsion_stiffness_nm_rad=0.1"),
    *("twin.axial_stiffness_n_m=16_000.0", "twin.joint_damping=1.2e-3"),
)


def segment(first_motor: int, angle_deg: float = 0.0, *, of: str, **keys: Any) -> dict[str, Any]:
    """A segment with a pair of tendons per plane, or three tendons with a motor of their own."""
    if of == "three":
        tendons = [
            {"angle_deg": (angle_deg + 120 * n) % 360, "motor": first_motor + n} for n in range(3)
        ]
    else:
        tendons = [
            {
                "angle_deg": (angle_deg + 90 * n + turn) % 360,
                "motor": first_motor + n,
                "winding": winding,
            }
            for n in range(2 if of == "pairs" else 1)
            for turn, winding in ((0, 1), (180, -1))
        ]
    usual = {"length_mm": 50.0, "tendon_radius_mm": 4.5, "tendons": tendons}
    plane = {"bends": "plane", "direction_deg": angle_deg} if of == "pair" else {}
    return usual | plane | keys


def described(*segments: dict[str, Any], **twin: Any) -> Description:
    return Description.model_validate(
        {"robot": {"segments": segments, "marker_offset_mm": 0.0}, "twin": twin}
    )


@st.composite
def robots(draw: st.DrawFn) -> list[dict[str, Any]]:
    segments, motor = [], 1
    for _ in range(draw(st.integers(1, 3))):
        of = draw(st.sampled_from(["pair", "pairs", "three"]))
        made = segment(
            motor,
            draw(st.floats(-180, 180)),
            of=of,
            length_mm=draw(st.floats(30, 80)),
            tendon_radius_mm=draw(st.floats(3, 6)),
        )
        segments.append(made)
        motor = 1 + max(tendon["motor"] for tendon in made["tendons"])
    return segments


def motor_angles_rad(description: Description, bending_rad: np.ndarray) -> np.ndarray:
    """Angles at which no tendon is shorter or longer than a bending needs."""
    matrix = ConstantCurvature(description.robot).bending_rad(np.eye(description.robot.motors)).T
    return np.linalg.pinv(matrix) @ bending_rad


def off_model_mm(segments: list[dict[str, Any]], flexures: int, bending_rad: np.ndarray) -> float:
    description = described(*segments, flexures=[flexures] * len(segments), **IDEAL)
    q_rad = motor_angles_rad(description, bending_rad)
    tip_mm = Equilibrium(description.twin).tip_mm(q_rad)
    return float(np.linalg.norm(tip_mm - ConstantCurvature(description.robot).tip_mm(q_rad)))


@pytest.mark.long
@given(robots(), st.integers(0, 2**32 - 1))
@settings(max_examples=15)
def test_without_weight_slack_and_friction_the_tip_approaches_constant_curvature(segments, seed):
    freedoms = sum(1 if part.get("bends") == "plane" else 2 for part in segments)
    bending_rad = np.random.default_rng(seed).uniform(-0.7, 0.7, freedoms)
    length_mm = sum(part["length_mm"] for part in segments)
    coarse_mm, fine_mm = (off_model_mm(segments, n, bending_rad) for n in (4, 12))
    assert fine_mm < 0.45 * coarse_mm + 0.05
    assert fine_mm < 0.025 * length_mm


def test_the_holes_of_the_twin_are_clocked_as_in_the_controllers_model():
    clocked, straight = (
        [segment(1, of="three"), segment(4, of="three", clocking_deg=deg)] for deg in (20.0, 0.0)
    )
    bending_rad = np.array([0.6, -0.3, 0.5, 0.4])
    twin, wrong_model = (described(*r, flexures=[12, 12], **IDEAL) for r in (clocked, straight))
    q_rad = motor_angles_rad(wrong_model, bending_rad)
    tip_mm = Equilibrium(twin.twin).tip_mm(q_rad)
    off_mm = [
        np.linalg.norm(tip_mm - ConstantCurvature(d.robot).tip_mm(q_rad))
        for d in (twin, wrong_model)
    ]
    assert off_mm[0] < 0.1 * off_mm[1]


ROBOTS = {
    "planar": [segment(1, 90, of="pair"), segment(2, 0, of="pair")],
    "pairs": [segment(1, of="pairs"), segment(3, 45, of="pairs", tendon_radius_mm=3.0)],
    "three": [segment(1, 90, of="three"), segment(4, 50, of="three", length_mm=40.0)],
    "mixed": [segment(1, 30, of="pair"), segment(2, 20, of="three"), segment(5, of="pairs")],
}


def turned(segments: list[dict[str, Any]], by_deg: float) -> list[dict[str, Any]]:
    return [
        part
        | {
            "direction_deg": part.get("direction_deg", 0.0) + by_deg,
            "tendons": [
                t | {"angle_deg": (t["angle_deg"] + by_deg) % 360} for t in part["tendons"]
            ],
        }
        for part in segments
    ]


@pytest.mark.parametrize("segments", ROBOTS.values(), ids=ROBOTS)
def test_a_robot_turned_about_its_backbone_bends_as_before_turned(segments):
    keys = {"gravity_m_s2": 0.0, "stiffening": 1.0, "torsion_stiffness_nm_rad": 0.1}
    # Angles count from x towards z, against the right-hand rule about the backbone along -y.
    turn = Rotation.from_rotvec(np.radians(37.0) * BACKBONE)
    usual = described(*segments, **keys)
    freedoms = len(ConstantCurvature(usual.robot).bending_rad(np.zeros(usual.robot.motors)))
    q_rad = motor_angles_rad(usual, np.full(freedoms, 0.5))
    tips_mm = [
        Equilibrium(described(*parts, **keys).twin).tip_mm(q_rad)
        for parts in (segments, turned(segments, 37.0))
    ]
    assert tips_mm[1] == pytest.approx(turn.apply(tips_mm[0]), abs=1e-3)


@pytest.mark.parametrize(("stiffening", "alike"), [(0.0, 0.002), (0.2, 0.015)])
def test_a_spatial_segment_bends_alike_in_all_directions(stiffening, alike):
    """Two hinges are no joint in all directions: over a segment, stiffness and twist even out."""
    keys = {"gravity_m_s2": 0.0, "stiffening": stiffening, "flexures": [8], "slack_mm": 0.0}
    along_mm = []
    for angle_deg in np.arange(0.0, 90.0, 15.0):
        twin = described(segment(1, angle_deg, of="pairs"), **keys).twin
        tip_mm = Equilibrium(twin).tip_mm([0.5, 0.0])
        turn = Rotation.from_rotvec(-np.radians(angle_deg) * BACKBONE)
        forwards_mm, _, aside_mm = turn.apply(tip_mm)
        assert aside_mm == pytest.approx(0.0, abs=30 * alike)
        along_mm.append(forwards_mm)
    assert along_mm == pytest.approx([along_mm[0]] * 6, rel=alike)


@pytest.mark.parametrize("of", ["pairs", "three"])
def test_a_spatial_segment_sags_to_where_its_weight_pulls_it(of):
    def sagged_mm(*gravity: float) -> np.ndarray:
        twin = described(segment(1, of=of), gravity_m_s2=gravity, slack_mm=50.0).twin
        return Equilibrium(twin).tip_mm(np.zeros(len(twin.servo_neutral_us)))

    down_mm = sagged_mm(0.0, 0.0, -9.81)
    assert down_mm[Z] < -1.0
    assert down_mm[X] == pytest.approx(0.0, abs=1e-6)
    for turn_deg in (30, 90, 225):
        turn = Rotation.from_euler("y", turn_deg, degrees=True)
        there_mm = sagged_mm(*turn.apply([0.0, 0.0, -9.81]))
        assert there_mm == pytest.approx(turn.apply(down_mm), abs=0.02)


def test_a_motor_may_wind_several_tendons_either_way():
    """One motor bends two segments against each other: an S whose end is straight again."""
    pair = segment(1, 90, of="pair")
    other = segment(1, 270, of="pair", direction_deg=90.0, tendon_radius_mm=9.0)
    twin = described(pair, other, flexures=[12, 12], **IDEAL).twin
    mechanics = Mechanics(twin, 0.0)
    for q_rad in np.linspace(0.0, 0.2, 41):
        mechanics.pull([q_rad])
        mechanics.advance(50)
    mechanics.advance(2000)
    base, *_, before, tip = mechanics.backbone_mm()
    assert (tip - before)[Z] / (tip - before)[Y] == pytest.approx(0.0, abs=0.05)
    assert abs((tip - base)[Z]) > 5.0


@pytest.mark.long
@pytest.mark.parametrize("name", ["two-spatial", "three-spatial"])
def test_the_work_of_all_servos_is_what_structure_and_tendons_store(name):
    """The moment on each pulley is the slope of the energy by its angle."""
    lossless = ("twin.friction=0", "twin.creep_share=0", "twin.joint_damping=4e-3")
    twin = load(name, ["twin.gravity_m_s2=0", "twin.slack_mm=0", *lossless]).twin
    mechanics = Mechanics(twin, 0.0)
    goal_rad = np.random.default_rng(3).uniform(-0.3, 0.5, len(twin.servo_neutral_us))
    shares = np.linspace(0.0, 1.0, 26)
    powers_nm, energies_j = [], []
    for share in shares:
        mechanics.pull(share * goal_rad)
        mechanics.advance(2000)
        powers_nm.append(mechanics.pulley_moments_nm() @ goal_rad)
        springs_j = 0.5 * mechanics._model.jnt_stiffness @ mechanics._joints**2
        stretches_m = mechanics._forces_n / twin.tendon_stiffness_n_m
        energies_j.append(springs_j + 0.5 * twin.tendon_stiffness_n_m * stretches_m @ stretches_m)
    assert -trapezoid(powers_nm, shares) == pytest.approx(energies_j[-1], rel=0.01)


@pytest.mark.parametrize("angle_deg", [0.0, 45.0])
def test_a_tendon_loses_tension_by_the_angle_that_both_hinges_turn_it(angle_deg):
    twin = described(
        segment(1, angle_deg, of="pairs"),
        capstan_friction=0.3, gravity_m_s2=0.0, slack_mm=0.0, joint_damping=4e-3,
    ).twin  # fmt: skip
    mechanics = Mechanics(twin, 0.0)
    for q_rad in np.linspace(0.0, 0.5, 3000):
        mechanics.pull([q_rad, 0.0])
        mechanics.advance(1)
    friction = mechanics._memories[0][1]
    assert isinstance(friction, CapstanFriction)
    turned_by_rad = np.arccos(mechanics._data.site_xmat[mechanics._disks[-1]][4])
    last = friction._divisors[friction._pulleys[friction._tendon == 0]][-1]
    # The last half flexure lies beyond the last hole in which the tendon turns.
    assert np.log(last) == pytest.approx(0.3 * turned_by_rad * 11 / 12, rel=0.03)


@pytest.mark.long
@pytest.mark.parametrize("name", ["single", "two-spatial", "three-spatial"])
def test_any_robot_with_every_effect_is_moved_and_then_comes_to_rest(name):
    twin = load(name, EVERYTHING).twin
    mechanics = Mechanics(twin, 0.0)
    steps = round(10_000 / mechanics.step_us)
    rng = np.random.default_rng(1)
    here_rad = np.zeros(len(twin.servo_neutral_us))
    for there_rad in rng.uniform(-1.0, 1.0, (3, len(here_rad))):
        for share in np.linspace(0, 1, 15):
            mechanics.pull(here_rad + share * (there_rad - here_rad))
            mechanics.advance(steps)
        here_rad = there_rad
    peaks = []
    for _ in range(3):
        mechanics.advance(20 * steps)
        peaks.append(np.abs(mechanics._data.qvel).max())
    assert np.isfinite(mechanics.markers_mm()).all()
    assert len(mechanics.markers_mm()) == len(twin.segments) + 1
    assert peaks[-1] < 0.5 * peaks[0] + 1e-3
