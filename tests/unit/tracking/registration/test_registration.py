"""The fit and its judgement, on rest poses of the twin."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from ccr_host.description.schema import Robot
from ccr_host.robot.rests import Rests
from ccr_host.tracking.registration import RegistrationError, register
from tests.unit.tracking.registration.conftest import TURNS, poses_rad
from tests.unit.tracking.registration.hinged_chain import HingedChain

pytestmark = pytest.mark.long

NOISE_MM = 0.03
"""0.25 mm RMS averaged over 25 frames."""


def error_deg(registration, turn) -> np.ndarray:
    """(3,): about x, y and z of the robot."""
    error = Rotation.from_matrix(registration.camera_to_robot) * Rotation.from_rotvec(turn).inv()
    return error.as_rotvec(degrees=True)


def changed(rests, q=lambda q: q, markers=lambda m: m):
    return replace(rests, q_rad=q(rests.q_rad), markers_mm=markers(rests.markers_mm))


def picked(rests, which):
    """Some of them, by a slice or a list."""
    return replace(
        rests,
        q_rad=rests.q_rad[which],
        markers_mm=rests.markers_mm[which],
        count=rests.count[which],
    )


@pytest.mark.parametrize("turn", TURNS.values(), ids=TURNS)
def test_any_turn_of_the_camera_is_found_to_a_degree(seen, turn):
    found = register(seen(turn, NOISE_MM), Robot())
    about_x, *others = np.abs(error_deg(found, turn))
    assert about_x < min(1.0, 2.0 * found.uncertainty_deg[0])
    assert max(others) < 0.2
    assert found.scale == pytest.approx(1.0, abs=0.005)
    assert found.segment_1_mm == pytest.approx(58.5, abs=0.3)
    written = Rotation.from_rotvec(found.camera_to_robot_deg, degrees=True)
    np.testing.assert_allclose(written.as_matrix(), found.camera_to_robot, atol=1e-9)


@pytest.mark.parametrize(
    "twin",
    [
        {"slack_mm": 0.0},
        {"slack_mm": 2.0},
        {"bending_stiffness_nm_rad": 0.01},
        {"bending_stiffness_nm_rad": 0.03},
        {"marker_mass_g": 4.5, "disk_mass_g": 1.2},
        {"marker_mass_g": 1.5, "disk_mass_g": 0.4},
        {"gravity_m_s2": 0.0},
    ],
    ids=str,
)
def test_slack_and_sag_bias_the_rotation_by_no_more_than_stated(seen, twin):
    """A fit of (10) would be off by several degrees on each of these."""
    found = register(seen(TURNS["askew"], **twin), Robot())
    error = np.abs(error_deg(found, TURNS["askew"]))
    assert np.all(error < 3.0 * found.uncertainty_deg)
    assert error[0] < 0.6


def chain_rests(chain: HingedChain, turn=(0.0, 0.0, 0.0)) -> Rests:
    """The safe poses of a chain, as a camera turned by a rotation vector sees them."""
    rests = Rests(np.zeros(2), poses_rad(), np.zeros((len(poses_rad()), 3, 3)), np.ones(17))
    bending = 2.2 * rests.q_rad[:, 0]
    markers = [chain.markers_mm(*at) for at in zip(bending, rests.ways()[:, 0], strict=True)]
    aside = np.sin(2.6 * rests.q_rad[:, 1])
    for pose, sine in zip(markers, aside, strict=True):
        pose[2] = (
            pose[1] + 43.5 * np.array([sine, -np.sqrt(1.0 - sine**2), 0.0]) if sine else pose[2]
        )
    return replace(rests, markers_mm=np.array(markers) @ Rotation.from_rotvec(turn).as_matrix())


@pytest.mark.parametrize(
    "gravity", [-1j, 1j, 1.0 + 0j, 0j], ids=["below", "above", "along", "none"]
)
@pytest.mark.parametrize(("friction", "taper"), [(0.0, 0.3), (0.0, -0.3), (0.22, 0.13), (0.4, 0.0)])
def test_friction_of_the_tendons_and_taper_turn_the_frame_by_no_more_than_stated(
    friction, taper, gravity
):
    """A fit of the even arc is off by 6 deg, or takes them for markers on the other side."""
    found = register(
        chain_rests(HingedChain(friction, taper, 6, gravity), TURNS["askew"]),
        Robot(gravity_direction=(0.0, -gravity.real, gravity.imag) if gravity else (1.0, 0.0, 0.0)),
    )
    assert np.all(np.abs(error_deg(found, TURNS["askew"])) < 2.0 * found.uncertainty_deg)
    assert found.residual_mm < 0.1
    assert found.uncertainty_deg[0] < 0.8


def test_the_hysteresis_of_each_motor_is_told(seen):
    free = register(seen(TURNS["askew"]), Robot()).hysteresis_mm
    rubbing = register(seen(TURNS["askew"], friction=0.3), Robot()).hysteresis_mm
    assert np.all(free < 0.1)
    assert np.all(rubbing > 0.5)


@pytest.mark.parametrize(
    "twin",
    [
        {"friction": 0.3},
        {"axial_stiffness_n_m": 8000.0},
        {"servo_droop_deg_per_nm": 10.0, "servo_backlash_deg": 0.65, "servo_deadband_deg": 0.6},
        {"slack_mm": (1.8, 0.4, 0.6, 1.5)},
    ],
    ids=str,
)
def test_tendons_and_servos_as_they_are_turn_the_frame_by_no_more_than_stated(seen, twin):
    found = register(seen(TURNS["askew"], **twin), Robot())
    assert np.all(np.abs(error_deg(found, TURNS["askew"])) < 2.0 * found.uncertainty_deg)
    assert found.uncertainty_deg[0] < 1.0


def test_markers_on_the_backbone_do_not_tell_up_from_down(seen):
    flat = changed(seen(marker_offset_mm=0.0, gravity_m_s2=0.0))
    with pytest.raises(RegistrationError, match="do not tell up from down"):
        register(flat, Robot(marker_offset_mm=0.0))


def test_poses_that_do_not_repeat_are_refused_with_their_hysteresis(seen):
    def slipping(markers):
        slipped = markers.copy()
        slipped[3:9, 1] += (0.0, 0.0, 3.0)
        slipped[3:9, 2] += (0.0, 0.0, 3.0)
        return slipped

    poses = changed(seen(), markers=slipping)
    with pytest.raises(RegistrationError, match=r"does not repeat its shape.*approached from both"):
        register(poses, Robot())


def test_a_robot_that_hangs_upside_down_is_found_to_a_degree(seen):
    found = register(seen(TURNS["askew"], gravity_m_s2=-9.81), Robot())
    assert found.load < 0.0
    assert np.all(np.abs(error_deg(found, TURNS["askew"])) < 1.0)


@pytest.mark.filterwarnings("error")
def test_the_stated_uncertainty_covers_the_errors_made(seen):
    shares = []
    for seed in range(20):
        found = register(seen(TURNS["askew"], 0.05, seed), Robot())
        shares.append(error_deg(found, TURNS["askew"]) / found.uncertainty_deg)
    assert np.all(np.sqrt(np.mean(np.square(shares), axis=0)) < 1.3)


def test_errors_of_the_believed_angles_do_not_turn_the_frame(seen):
    poses = changed(seen(), q=lambda q: 0.7 * q)
    np.testing.assert_allclose(error_deg(register(poses, Robot()), (0, 0, 0)), 0.0, atol=0.4)


def test_a_camera_whose_frame_is_left_handed_looks_like_a_reversed_motor_2(seen):
    poses = changed(seen(), markers=lambda m: m * np.array([-1.0, 1.0, 1.0]))
    assert register(poses, Robot()).reversed_motors == (2,)


@pytest.mark.parametrize(
    ("motors", "sign"), [((), (1, 1)), ((1,), (-1, 1)), ((2,), (1, -1)), ((1, 2), (-1, -1))]
)
def test_motors_that_turn_the_wrong_way_are_named_and_turn_no_frame(seen, motors, sign):
    poses = changed(seen(TURNS["askew"]), q=lambda q: q * np.array(sign))
    found = register(poses, Robot())
    assert found.reversed_motors == motors
    np.testing.assert_allclose(error_deg(found, TURNS["askew"]), 0.0, atol=0.4)


@pytest.mark.parametrize("zeros_us", [(89.0, -89.0), (-89.0, 89.0), (0.0, 111.0)], ids=str)
def test_zeros_of_the_servos_bias_the_rotation_by_no_more_than_stated(seen, zeros_us):
    """Where segment 2 is bent its weight moves M3 out of its plane: 1.8 deg about z if trusted."""
    twin = {"servo_neutral_us": tuple(1500.0 + zero for zero in zeros_us)}
    found = register(seen(TURNS["askew"], **twin), Robot())
    assert np.all(np.abs(error_deg(found, TURNS["askew"])) < 2.0 * found.uncertainty_deg)


def test_too_few_poses_are_refused(seen):
    with pytest.raises(RegistrationError, match="only 4 poses"):
        register(picked(seen(), np.s_[:4]), Robot())


def test_a_swing_too_small_is_refused(seen):
    rests = seen()
    near = np.flatnonzero(np.abs(rests.q_rad[:, 0]) < np.radians(15.0))
    with pytest.raises(RegistrationError, match="swung by"):
        register(picked(rests, [*near, *near]), Robot())


def test_a_segment_2_that_stays_is_refused(seen):
    poses = changed(seen(), markers=np.copy)
    poses.markers_mm[-4:] = poses.markers_mm[0]
    with pytest.raises(RegistrationError, match="segment 2 moved M3"):
        register(poses, Robot())


def test_a_motor_2_that_was_never_turned_is_refused(seen):
    with pytest.raises(RegistrationError, match="never turned"):
        register(picked(seen(), np.s_[:-4]), Robot())


def test_a_camera_out_of_scale_is_refused(seen):
    poses = changed(seen(), markers=lambda m: m * 1.05)
    with pytest.raises(RegistrationError, match=r"segment \d measures|off any shape"):
        register(poses, Robot())


def test_a_base_that_moved_is_refused(seen):
    poses = changed(seen(), markers=np.copy)
    poses.markers_mm[5:] += (0.0, 2.0, 0.0)
    with pytest.raises(RegistrationError, match="M1 moved"):
        register(poses, Robot())


def test_exchanged_markers_are_refused(seen):
    for order in ((0, 2, 1), (2, 1, 0), (1, 0, 2)):
        poses = changed(seen(), markers=lambda m, order=order: m[:, list(order)])
        with pytest.raises(RegistrationError):
            register(poses, Robot())


def test_noise_far_above_any_cameras_is_refused(seen):
    with pytest.raises(RegistrationError):
        register(seen(noise_mm=2.0), Robot())
