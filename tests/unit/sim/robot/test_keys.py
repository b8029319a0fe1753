"""Every key of the twin has the expected physical effect on the robot."""

import numpy as np
import pytest
from scipy.integrate import trapezoid

from ccr_host.core.errors import CcrError, ConfigError
from ccr_host.description.robot import Robot
from ccr_host.description.simulation import Push, Twin
from ccr_host.sim.robot.mechanics import Mechanics
from ccr_host.sim.robot.robot import TwinRobot

X, Y, Z = 0, 1, 2

CHANGED = {
    "segments": (
        Robot().chain[0],
        Robot().chain[1].model_copy(update={"direction_deg": 10.0}),
    ),
    "flexures": (7, 5),
    "segment_lengths_mm": (60.0, 43.5),
    "tendon_radius_mm": (4.6, 4.6),
    "marker_offset_mm": (0.0, 0.0, 16.0),
    "pulley_radius_mm": 12.0,
    "bending_stiffness_nm_rad": (0.02, 0.021),
    "stiffness_taper": (0.1, 0.2),
    "stiffening": (0.1, 0.2),
    "bending_plane_turn_deg": (1.0, 2.0),
    "sideways_stiffness_nm_rad": (0.2, 0.3),
    "torsion_stiffness_nm_rad": (0.2, 0.3),
    "axial_stiffness_n_m": (1e4, 2e4),
    "joint_damping": 3e-4,
    "creep_share": (0.1, 0.0),
    "creep_time_s": (0.5, 60.0),
    "friction": 0.1,
    "capstan_friction": 0.1,
    "disk_mass_g": 0.9,
    "marker_mass_g": 3.1,
    "payload_g": 1.0,
    "payload_start_s": 0.5,
    "slack_mm": (1.0,) * 4,
    "tendon_stiffness_n_m": 4100.0,
    "tendon_force_max_n": 1.0,
    "servo_rate_deg_s": 200.0,
    "servo_deadband_deg": 0.5,
    "servo_stall_torque_nm": 0.3,
    "servo_droop_deg_per_nm": 10.0,
    "servo_backlash_deg": 0.5,
    "servo_lag_ms": 20.0,
    "servo_drift_deg": (0.0, 30.0),
    "servo_drift_time_s": 2.0,
    "servo_neutral_us": (1500.0, 1510.0),
    "servo_us_per_90_deg": (-1000.0, 1000.0),
    "gravity_m_s2": (0.0, 0.0, -9.7),
    "push": Push(force_n=(0, 0, 0.01), start_s=0.0, end_s=1.0),
    "time_step_ms": 0.4,
}


@pytest.mark.long
@pytest.mark.parametrize("key", sorted(Twin.model_fields.keys() - {"segments"}))
def test_no_key_is_without_effect(pulses_half_us, key):
    def swing_mm(twin: Twin):
        robot = TwinRobot(twin)
        robot.start_path_clock(0)
        robot.set_pulses_half_us(pulses_half_us(15, 25))
        robot.advance_to(100_000)
        return robot.tip_mm()

    usual = Twin(
        payload_g=0.5,
        creep_share=(0.5, 0.0),
        creep_time_s=0.1,
        servo_drift_deg=(0.0, 1.0),
        servo_drift_time_s=1.0,
    )
    changed = usual.model_copy(update={key: CHANGED[key]})
    assert np.linalg.norm(swing_mm(changed) - swing_mm(usual)) > 1e-3


def test_gravity_droops_and_its_sign_turns_the_droop(tip):
    assert tip(gravity_m_s2=9.81)[Z] < -10
    assert tip(gravity_m_s2=0.0)[Z] == pytest.approx(0, abs=1e-6)
    assert tip(gravity_m_s2=-9.81)[Z] > 10


def test_gravity_acts_in_any_direction(tip):
    # The second segment bends sideways and the first up and down: each gives way on its own.
    free = {"slack_mm": 50.0, "bending_stiffness_nm_rad": 0.4}
    aside = tip(gravity_m_s2=(9.81, 0.0, 0.0), **free)
    np.testing.assert_allclose(tip(gravity_m_s2=(-9.81, 0.0, 0.0), **free), aside * (-1, 1, 1))
    assert aside[X] > 0.05
    assert aside[Z] == pytest.approx(0, abs=1e-6)
    hanging = tip(gravity_m_s2=(0.0, -9.81, 0.0), marker_offset_mm=0.0, **free)
    np.testing.assert_allclose(hanging, (0, -102, 0), atol=1e-6)
    np.testing.assert_array_equal(tip(gravity_m_s2=(0.0, 0.0, -9.81)), tip(gravity_m_s2=9.81))


def test_tendons_shorten_a_compliant_backbone_by_their_force(posed):
    """Both tendons of a motor too short: they press on the backbone with all their force."""
    rigid, compliant = (
        posed(gravity_m_s2=0.0, tendon_force_max_n=5.0, **keys)
        for keys in ({}, {"axial_stiffness_n_m": (10_000.0, 5_000.0)})
    )
    for robot in (rigid, compliant):
        robot._mechanics._tendon_lengths_m[:] -= 0.01
        robot._mechanics.advance(4000)
    shortened_mm = rigid.markers_mm()[:, Y] - compliant.markers_mm()[:, Y]
    by_segment_mm = 4 * 5.0 / 10_000 * 1e3, 2 * 5.0 / 5_000 * 1e3
    assert -np.diff(shortened_mm) == pytest.approx(by_segment_mm, rel=1e-3)


def test_a_hanging_robot_stretches_by_its_weight(tip):
    hanging = {"gravity_m_s2": (0.0, -9.81, 0.0), "slack_mm": 50.0, "payload_g": 50.0}
    stretched_mm = tip(**hanging)[Y] - tip(axial_stiffness_n_m=200.0, **hanging)[Y]
    # Each flexure carries the disks from its own on; on average half those of its segment.
    carried_g = 50 + 3 + (5 + 1) / 2 * 0.8, 50 + 6 + ((6 + 1) / 2 + 5) * 0.8
    assert stretched_mm == pytest.approx(sum(carried_g) * 1e-3 * 9.81 / 200.0 * 1e3, rel=0.01)


def test_a_backbone_that_collapses_is_refused_in_one_line():
    with pytest.raises(ConfigError, match="backbone by half") as error:
        TwinRobot(Twin(gravity_m_s2=(0.0, 9.81, 0.0), axial_stiffness_n_m=1.0))
    assert "twin.axial_stiffness_n_m" in error.value.cure


@pytest.mark.parametrize("flexures", [(3, 7), (6, 5), (10, 10)])
def test_a_soft_backbone_may_give_way_by_a_tenth_however_many_flexures_it_has(flexures):
    robot = TwinRobot(Twin(flexures=flexures, axial_stiffness_n_m=2000.0, gravity_m_s2=0.0))
    for _ in range(20):
        robot._mechanics._tendon_lengths_m[:] -= 0.0005
        robot._mechanics.advance(100)
    shortened_mm = np.diff(robot.markers_mm()[:, Y])[0] + 58.5
    assert 0.1 * 58.5 < shortened_mm < 0.3 * 58.5


def test_the_tendons_load_the_pulley_that_winds_them_by_force_times_radius(posed):
    robot = posed(0, 25, gravity_m_s2=0.0)
    first, second = robot._mechanics.pulley_moments_nm()
    assert first == pytest.approx(0.0, abs=1e-6)
    wound_by_rad = robot.servo_angles_rad()[1] - 1.2 / 12.5
    assert -4000.0 * (12.5e-3) ** 2 * wound_by_rad < second < -0.01
    # The moment of the tendon about the bent flexures is that of their springs.
    bent_rad = robot._mechanics._joints[-5:].sum()
    lever_mm = 4.5 + 4.35 * bent_rad / 10  # see test_tendon_force_is_limited
    assert second == pytest.approx(-12.5 / lever_mm * 0.02 * bent_rad, rel=0.01)
    assert posed(0, -25, gravity_m_s2=0.0)._mechanics.pulley_moments_nm()[1] == pytest.approx(
        -second
    )


def test_the_work_of_a_servo_is_what_the_structure_and_its_tendons_store(posed):
    """The moment on the pulley is the slope of the energy: no effect loses any of it."""
    keys = {"gravity_m_s2": 0.0, "slack_mm": 0.0, "axial_stiffness_n_m": 8000.0}
    mechanics = posed(**keys)._mechanics
    angles_rad = np.linspace(0.0, 0.5, 26)
    moments_nm, energies_j = [], []
    for angle_rad in angles_rad:
        mechanics.pull([0.0, angle_rad])
        mechanics.advance(2000)
        moments_nm.append(mechanics.pulley_moments_nm()[1])
        springs_j = 0.5 * mechanics._model.jnt_stiffness @ mechanics._joints**2
        stretches_m = mechanics._forces_n / 4000.0
        energies_j.append(springs_j + 0.5 * 4000.0 * stretches_m @ stretches_m)
    work_j = -trapezoid(moments_nm, angles_rad)
    assert work_j == pytest.approx(energies_j[-1], rel=0.01)


def test_droop_of_a_stiff_slack_robot_is_inverse_to_its_stiffness(tip):
    free = {"slack_mm": 50.0}
    droop = tip(bending_stiffness_nm_rad=0.4, **free)[Z]
    assert tip(bending_stiffness_nm_rad=0.8, **free)[Z] == pytest.approx(droop / 2, rel=0.01)


def test_stiffness_of_each_segment_acts_on_that_segment(posed):
    robot, softer_second = (
        posed(slack_mm=50.0, bending_stiffness_nm_rad=(0.4, second)) for second in (0.4, 0.1)
    )
    # Gravity bends only segment 1; segment 2 bends sideways, so only its tendons show it.
    np.testing.assert_allclose(robot.tip_mm(), softer_second.tip_mm(), atol=1e-6)
    push = Push(force_n=(0.01, 0, 0), start_s=0, end_s=9)
    soft, stiff = (
        posed(slack_mm=50.0, bending_stiffness_nm_rad=(0.4, k), push=push) for k in (0.1, 0.4)
    )
    for pushed in (soft, stiff):
        pushed.start_path_clock(0)
        pushed.advance_to(2_000_000)
    assert soft.tip_mm()[X] == pytest.approx(4 * stiff.tip_mm()[X], rel=0.02)


def test_payload_droops_like_its_weight(tip):
    # Cantilever of a segment with uniform flexures, free tendons, small angles.
    stiff = {"slack_mm": 50.0, "bending_stiffness_nm_rad": 2.0, "gravity_m_s2": 9.81}
    added = tip(payload_g=20.0, **stiff)[Z] - tip(payload_g=0.0, **stiff)[Z]
    flexure_y = 58.5 / 6 * (np.arange(6) + 0.5)
    arms_m = (102 - flexure_y) * 1e-3
    compliance_m_n = np.sum(arms_m**2) / (6 * 2.0)
    assert added == pytest.approx(-compliance_m_n * 0.020 * 9.81 * 1e3, rel=0.01)


STIFF = {"slack_mm": 50.0, "bending_stiffness_nm_rad": 2.0}


def pushed_mm(axis: int, **keys) -> float:
    """Deflection of the tip along an axis under 0.05 N at the last disk, without gravity."""
    force_n = [0.0, 0.0, 0.0]
    force_n[axis] = 0.05
    mechanics = Mechanics(Twin(gravity_m_s2=0.0, joint_damping=0.05, **(STIFF | keys)), 0.0)
    mechanics.push((force_n[X], force_n[Y], force_n[Z]))
    mechanics.advance(round(1e6 / mechanics.step_us))
    return float(mechanics.backbone_mm()[-1, axis])


@pytest.mark.parametrize(
    ("stiffness", "axis", "from_mm", "to_mm"),
    [((0.2, 0.0), X, 43.5, 102.0), ((0.0, 0.2), Z, 0.0, 43.5)],
)
def test_a_segment_gives_way_across_its_bending_plane(stiffness, axis, from_mm, to_mm):
    """Cantilever: the moment of the force over the stiffness, along the segment, times its arm."""
    added_mm = pushed_mm(axis, sideways_stiffness_nm_rad=stiffness) - pushed_mm(axis)
    arms_m2 = (to_mm**3 - from_mm**3) / (3 * (to_mm - from_mm)) * 1e-6
    assert added_mm == pytest.approx(0.05 * arms_m2 / 0.2 * 1e3, rel=0.07)


def test_markers_off_the_backbone_twist_the_segments_by_their_weight(posed):
    robot = posed(gravity_m_s2=(9.81, 0, 0), torsion_stiffness_nm_rad=(0.02, 0.01), **STIFF)
    offsets_mm = robot.markers_mm() - robot.backbone_mm()[[0, 6, 11]]
    twists_rad = np.arcsin(offsets_mm[:, X] / 15.0)
    moment_nm = 3e-3 * 9.81 * 15e-3
    assert twists_rad == pytest.approx(
        [0.0, 2 * moment_nm / 0.02, 2 * moment_nm / 0.02 + moment_nm / 0.01], rel=0.01
    )


def test_a_taut_tendon_beside_a_bent_segment_does_not_twist_it(posed):
    """The moment of a tendon is at right angles to the backbone at every point of a bent rod."""
    stiff, soft = (
        posed(35, 35, gravity_m_s2=0.0, torsion_stiffness_nm_rad=torsion).markers_mm()
        for torsion in ((0.0, 0.0), (0.05, 0.05))
    )
    np.testing.assert_allclose(soft, stiff, atol=0.3)


def test_a_softer_end_of_a_segment_bends_more_and_the_whole_as_much(posed):
    level = {"gravity_m_s2": 0.0, "slack_mm": 0.0}
    even, tapered = (
        posed(0, 20, stiffness_taper=taper, **level)._mechanics._joints[-5:] for taper in (0.0, 0.4)
    )
    assert even[0] == pytest.approx(even[-1], rel=1e-3)
    assert tapered[-1] / tapered[0] == pytest.approx((1 - 0.04) / (1 - 0.36), rel=0.06)
    assert tapered.sum() == pytest.approx(even.sum(), rel=0.01)


def test_a_segment_bent_by_90_deg_resists_more_by_its_stiffening(posed):
    def moment_over_angle_nm_rad(angle_deg: float) -> tuple[float, float]:
        robot = posed(0, angle_deg, stiffening=0.3, gravity_m_s2=0.0, slack_mm=0.0)
        bent_rad = robot._mechanics._joints[-5:].sum()
        lever_mm = 4.5 * np.cos(bent_rad / 10) + 4.35 * np.sin(bent_rad / 10)
        moment_nm = -robot._mechanics.pulley_moments_nm()[1] * lever_mm / 12.5
        return moment_nm / bent_rad, bent_rad

    straight_nm_rad, _ = moment_over_angle_nm_rad(4)
    bent_nm_rad, bent_rad = moment_over_angle_nm_rad(46)
    assert np.degrees(bent_rad) == pytest.approx(90, abs=5)
    assert straight_nm_rad == pytest.approx(0.02, rel=0.01)
    assert bent_nm_rad == pytest.approx(0.02 * (1 + 0.3 * (bent_rad / (np.pi / 2)) ** 2), rel=0.01)


def test_turned_flexures_bend_the_robot_out_of_its_plane(posed):
    level = {"gravity_m_s2": 0.0, "slack_mm": 0.0}
    x, _, z = posed(15, 0, bending_plane_turn_deg=(5.0, 0.0), **level).backbone_mm()[6]
    assert np.degrees(np.arctan2(x, z)) == pytest.approx(5.0)
    x, _, z = posed(0, 15, bending_plane_turn_deg=(0.0, 5.0), **level).backbone_mm()[11]
    assert np.degrees(np.arctan2(-z, x)) == pytest.approx(5.0)


@pytest.mark.parametrize("key", ["disk_mass_g", "marker_mass_g"])
def test_more_mass_droops_more(tip, key):
    mass = getattr(Twin(), key)
    assert tip(**{key: 2 * mass})[Z] < tip(**{key: mass})[Z] - 1.0


def test_payload_drops_the_tip_from_its_start_in_path_time(posed):
    robot = posed(payload_g=10.0, payload_start_s=1.0)
    robot.advance_to(5_000_000)
    unloaded = robot.tip_mm()
    robot.start_path_clock(5_000_000)
    robot.advance_to(6_000_000)
    np.testing.assert_allclose(robot.tip_mm(), unloaded, atol=1e-5)
    robot.advance_to(9_000_000)
    np.testing.assert_allclose(robot.tip_mm(), posed(payload_g=10.0).tip_mm(), atol=0.05)


@pytest.mark.parametrize("axis", [X, Z])
def test_push_moves_the_tip_along_its_force_during_its_span(posed, axis):
    force = [0.0, 0.0, 0.0]
    force[axis] = 0.05
    robot = posed(push=Push(force_n=tuple(force), start_s=1.0, end_s=3.0))
    rest = robot.tip_mm()
    robot.start_path_clock(0)
    robot.advance_to(1_000_000)
    np.testing.assert_allclose(robot.tip_mm(), rest, atol=1e-5)
    robot.advance_to(3_000_000)
    assert robot.tip_mm()[axis] - rest[axis] > 1.0
    robot.advance_to(6_000_000)
    np.testing.assert_allclose(robot.tip_mm(), rest, atol=0.05)


def test_push_waits_for_the_path_clock(posed):
    robot = posed(push=Push(force_n=(0.1, 0, 0), start_s=0.0, end_s=9.0))
    rest = robot.tip_mm()
    robot.advance_to(2_000_000)
    np.testing.assert_allclose(robot.tip_mm(), rest, atol=1e-5)


def test_slack_is_wound_up_before_the_robot_bends(tip):
    # 12.5 mm pulley: 1 mm of slack is 4.58 deg.
    slack = {"gravity_m_s2": 0.0, "slack_mm": 1.0}
    assert tip(0, 4.4, **slack)[X] == pytest.approx(0, abs=1e-6)
    assert tip(0, 6.0, **slack)[X] > 0.5
    assert tip(0, 4.4, gravity_m_s2=0.0, slack_mm=0.0)[X] > 2


def test_softer_tendons_bend_the_robot_less(tip):
    stiff, soft = (tip(0, 25, tendon_stiffness_n_m=k)[X] for k in (8000.0, 1000.0))
    assert soft < stiff - 3


def test_tendon_force_is_limited(tip):
    # 1 N on 4.5 mm bends a segment of 0.02 N m/rad by 0.225 rad; the straight tendon between two
    # disks lies further inside than its holes by half a pitch (4.35 mm) times the half angle.
    bending_rad = 4.5e-3 / (0.02 / 1.0 - 4.35e-3 / 10)
    free = {"gravity_m_s2": 0.0, "slack_mm": 0.0}
    x, y, _ = tip(0, 40, tendon_force_max_n=1.0, **free)
    assert 2 * np.arctan2(x, -(y + 58.5)) == pytest.approx(bending_rad, rel=0.002)


@pytest.mark.parametrize(("key", "larger"), [("pulley_radius_mm", 15.0), ("tendon_radius_mm", 3.5)])
def test_transmission_ratio_bends_more(tip, key, larger):
    rest = {"slack_mm": 0.0}
    assert tip(0, 15, **{key: larger}, **rest)[X] > 1.1 * tip(0, 15, **rest)[X]


def test_segment_lengths_make_the_robot_longer(tip):
    np.testing.assert_allclose(
        tip(segment_lengths_mm=(70.0, 50.0), gravity_m_s2=0.0), (0, -120, 0), atol=1e-6
    )


@pytest.mark.long
def test_stuck_tendons_leave_the_tip_on_either_side(posed, pulses_half_us):
    def gap_mm(friction: float) -> float:
        robot = posed(friction=friction)
        tips = []
        for second, past_deg in ((1, 30), (2, 10), (3, -10), (4, 10)):
            robot.set_pulses_half_us(pulses_half_us(0, past_deg))
            robot.advance_to(second * 2_000_000)
            tips.append(robot.tip_mm()[X])
        from_above, from_below = tips[1], tips[3]
        return from_above - from_below

    assert abs(gap_mm(0.0)) < 0.05
    assert gap_mm(0.2) > 0.3
    assert gap_mm(0.4) > 1.5 * gap_mm(0.2)


def test_friction_holds_a_small_push_without_creep(posed):
    robot = posed(friction=0.5, push=Push(force_n=(0, 0, 0.03), start_s=0, end_s=99))
    robot.start_path_clock(0)
    robot.advance_to(1_000_000)
    after_1_s = robot.tip_mm()
    robot.advance_to(5_000_000)
    assert np.linalg.norm(robot.tip_mm() - after_1_s) < 0.02


def test_friction_does_not_move_the_start(tip):
    np.testing.assert_allclose(tip(friction=0.5), tip(friction=0.0), atol=1e-4)


def test_damping_calms_the_ringing_after_a_move(pulses_half_us):
    def ringing_mm(damping: float) -> float:
        robot = TwinRobot(Twin(joint_damping=damping))
        robot.set_pulses_half_us(pulses_half_us(15, 15))
        heights = []
        for time_us in range(1_000_000, 1_500_000, 10_000):
            robot.advance_to(time_us)
            heights.append(robot.tip_mm()[Z])
        return float(np.ptp(heights))

    assert ringing_mm(2e-3) < 0.3 * ringing_mm(1e-4)


def test_damping_does_not_move_the_rest(tip):
    np.testing.assert_allclose(tip(joint_damping=1e-3), tip(joint_damping=2e-2), atol=0.01)


def test_servo_rate_sets_when_the_shaft_arrives(pulses_half_us):
    robot = TwinRobot(Twin(servo_rate_deg_s=90.0))
    robot.set_pulses_half_us(pulses_half_us(45, -18))
    robot.advance_to(100_000)
    np.testing.assert_allclose(np.degrees(robot.servo_angles_rad()), (9, -9), atol=1e-9)
    robot.advance_to(600_000)
    np.testing.assert_allclose(np.degrees(robot.servo_angles_rad()), (45, -18), atol=1e-9)


def test_servo_deadband_leaves_the_shaft_short(pulses_half_us):
    robot = TwinRobot(Twin(servo_deadband_deg=2.0))
    robot.set_pulses_half_us(pulses_half_us(18, 1.8))
    robot.advance_to(500_000)
    np.testing.assert_allclose(np.degrees(robot.servo_angles_rad()), (16, 0), atol=1e-9)


PULLED = {"slack_mm": 0.0, "gravity_m_s2": 0.0}
"""A robot that pulls at its servos as soon as they turn."""


def shaft_deg(robot: TwinRobot) -> float:
    return float(np.degrees(robot.servo_angles_rad()[1]))


def test_the_bent_robot_pulls_its_servos_back(posed):
    """Bent to both sides alike; a straight one without slack does not pull at all."""
    droop_deg = {
        angle_deg: angle_deg - shaft_deg(posed(0, angle_deg, servo_droop_deg_per_nm=20, **PULLED))
        for angle_deg in (-20, 0, 20)
    }
    assert droop_deg[0] == 0.0
    assert droop_deg[20] == pytest.approx(-droop_deg[-20], rel=1e-3)
    # Flexures of 0.02 N m/rad in series with one tendon of 4000 N/m on 4.5 mm, seen by the pulley.
    bending, tendon = 0.02, 4000 * 4.5e-3**2
    stiffness_nm_rad = (12.5 / 4.5) ** 2 * bending * tendon / (bending + tendon)
    moment_nm = stiffness_nm_rad * np.radians(20 - droop_deg[20])
    assert droop_deg[20] == pytest.approx(20 * moment_nm, rel=0.1)


def test_droop_bends_the_robot_less(tip):
    assert tip(0, 25, servo_droop_deg_per_nm=20.0)[X] < tip(0, 25)[X] - 0.5


def test_backlash_under_load_lies_on_the_side_of_the_robot_whatever_the_approach(
    posed, pulses_half_us
):
    robot = posed(0, 30, servo_backlash_deg=1.0, **PULLED)
    for second, angle_deg in ((3, 20), (4, -20), (5, 20)):
        robot.set_pulses_half_us(pulses_half_us(0, angle_deg))
        robot.advance_to(second * 1_000_000)
        assert shaft_deg(robot) == pytest.approx(np.sign(angle_deg) * 19.5, abs=0.05)


def test_backlash_leaves_a_robot_with_slack_tendons_on_either_side(posed, pulses_half_us):
    reached = []
    for first_deg in (2.0, -2.0):
        robot = posed(0, first_deg, servo_backlash_deg=1.0, gravity_m_s2=0.0)
        robot.set_pulses_half_us(pulses_half_us(0, 0))
        robot.advance_to(3_000_000)
        reached.append(shaft_deg(robot))
    assert reached == pytest.approx([0.5, -0.5], abs=0.05)


def test_a_loaded_servo_is_slower_the_more_so_the_weaker_it_is(posed, pulses_half_us):
    def turned_deg(**keys) -> float:
        robot = posed(0, 10, **PULLED, **keys)
        robot.set_pulses_half_us(pulses_half_us(0, 60))
        robot.advance_to(2_100_000)
        return shaft_deg(robot)

    assert turned_deg(servo_stall_torque_nm=0.1) < turned_deg(servo_stall_torque_nm=0.3) - 2
    assert turned_deg(servo_stall_torque_nm=0.3) < turned_deg() - 2


def test_a_servo_follows_after_its_lag(pulses_half_us):
    prompt, late = TwinRobot(Twin()), TwinRobot(Twin(servo_lag_ms=30.0))
    for robot in (prompt, late):
        robot.set_pulses_half_us(pulses_half_us(0, 30))
    prompt.advance_to(50_000)
    late.advance_to(30_000)
    assert shaft_deg(late) == 0.0
    late.advance_to(80_000)
    assert shaft_deg(late) == pytest.approx(shaft_deg(prompt)) == pytest.approx(15.0)


def test_warming_servos_drift_while_their_pulses_stay(pulses_half_us):
    robot = TwinRobot(Twin(servo_drift_deg=(0.0, 2.0), servo_drift_time_s=2.0))
    robot.set_pulses_half_us(pulses_half_us(0, 9))
    robot.advance_to(2_000_000)
    np.testing.assert_allclose(
        np.degrees(robot.servo_angles_rad()), (0, 9 + 2 * (1 - np.exp(-1))), atol=0.01
    )


def test_loaded_servos_do_not_depend_on_how_often_the_robot_is_read(pulses_half_us):
    effects = {
        "servo_droop_deg_per_nm": 10.0,
        "servo_backlash_deg": 0.6,
        "servo_stall_torque_nm": 0.9,
        "servo_lag_ms": 5.0,
        "servo_drift_deg": (1.0, -1.0),
    }
    tips = []
    for chunk_us in (100_000, 2_500):
        robot = TwinRobot(Twin(**effects))
        for k in range(4):
            robot.set_pulses_half_us(pulses_half_us(10 * k, 30 - 20 * k))
            for time_us in range(k * 100_000, (k + 1) * 100_000, chunk_us):
                robot.advance_to(time_us + chunk_us)
        tips.append(robot.tip_mm())
    assert tips[0].tobytes() == tips[1].tobytes()


def test_more_flexures_keep_the_segment_as_stiff(tip):
    free = {"slack_mm": 50.0, "bending_stiffness_nm_rad": 0.4}
    # Half the disk mass on twice the disks: the same weight, spread as evenly.
    coarse = tip(flexures=(10, 8), disk_mass_g=0.8, **free)[Z]
    fine = tip(flexures=(20, 16), disk_mass_g=0.4, **free)[Z]
    assert fine == pytest.approx(coarse, rel=0.03)


def test_time_step_hardly_moves_the_motion(pulses_half_us):
    def swing_mm(step_ms: float):
        robot = TwinRobot(Twin(time_step_ms=step_ms))
        robot.set_pulses_half_us(pulses_half_us(10, 10))
        robot.advance_to(100_000)
        return robot.tip_mm()

    np.testing.assert_allclose(swing_mm(0.5), swing_mm(0.1), atol=0.6)
    assert not np.array_equal(swing_mm(0.5), swing_mm(0.1))


@pytest.mark.long
@pytest.mark.parametrize(
    "keys",
    [
        {"time_step_ms": 2.0},
        {"tendon_stiffness_n_m": 100_000.0, "time_step_ms": 2.0},
        {"bending_stiffness_nm_rad": 0.2},
        {"flexures": (15, 12)},
        {"disk_mass_g": 0.1, "marker_mass_g": 0.1},
        {"joint_damping": 1e-5},
    ],
)
def test_step_shrinks_where_the_structure_needs_it(pulses_half_us, keys):
    robot = TwinRobot(Twin(**keys))
    for k, angles_deg in enumerate([(20, 40), (-20, -40), (0, 60), (15, 0)]):
        robot.set_pulses_half_us(pulses_half_us(*angles_deg))
        robot.advance_to((k + 1) * 500_000)
    assert np.linalg.norm(robot.tip_mm()) < 110


def test_unstable_structure_is_reported_with_cause_and_cure(pulses_half_us, capfd, tmp_path):
    robot = TwinRobot(Twin(joint_damping=0.0))
    with pytest.raises(CcrError) as error:
        for k in range(200):
            robot.set_pulses_half_us(pulses_half_us(30 * (-1) ** k, 80 * (-1) ** (k // 2)))
            robot.advance_to((k + 1) * 250_000)
    assert "unstable" in error.value.cause
    assert "twin.joint_damping" in error.value.cure
    assert capfd.readouterr().err == ""


def test_structure_beyond_any_step_is_refused():
    with pytest.raises(ConfigError, match="time steps") as error:
        TwinRobot(Twin(bending_stiffness_nm_rad=(100.0, 100.0)))
    assert "twin.tendon_stiffness_n_m" in error.value.cure
