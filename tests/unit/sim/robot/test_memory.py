"""Friction of the tendons in their holes, and creep of the flexures: effects with a memory."""

import numpy as np
import pytest

from ccr_host.description.simulation import Push, Twin
from ccr_host.sim.robot.mechanics import Mechanics
from ccr_host.sim.robot.mjcf import robot_mjcf
from ccr_host.sim.robot.robot import TwinRobot

X = 0
LEVEL = {"gravity_m_s2": 0.0, "slack_mm": 0.0, "joint_damping": 4e-3}
R_C_M, HALF_PITCH_M, R_P_M = 4.5e-3, 43.5e-3 / 5 / 2, 12.5e-3


def turned(mechanics: Mechanics, from_deg: float, to_deg: float, deg_s: float = 20.0) -> None:
    """Turn the second pulley at a constant rate, then wait until the structure rests."""
    steps = round(abs(to_deg - from_deg) / deg_s * 1e6 / mechanics.step_us)
    for angle_rad in np.radians(np.linspace(from_deg, to_deg, steps)):
        mechanics.pull([0.0, float(angle_rad)])
        mechanics.advance(1)
    mechanics.advance(round(0.3e6 / mechanics.step_us))


def tensions_n(mechanics: Mechanics) -> np.ndarray:
    """Tension of tendon 2 at the pulley and in each span of segment 2, from what it does there.

    In a span between holes at r_c and half a pitch from a flexure, the moment that bends it by the
    angle q is the tension times r_c cos(q/2) + half a pitch times sin(q/2).
    """
    q_rad = mechanics._joints[-5:]
    levers_m = R_C_M * np.cos(q_rad / 2) + HALF_PITCH_M * np.sin(q_rad / 2)
    at_pulley_n = -mechanics.pulley_moments_nm()[1] / R_P_M
    return np.append(at_pulley_n, 5 * 0.02 * q_rad / levers_m)


@pytest.mark.parametrize("coefficient", [0.23, 0.26])
def test_a_bend_of_60_deg_costs_a_tendon_a_quarter_of_its_tension(coefficient):
    """Measured on a two-disk robot: mu of 0.23 to 0.26, thus 23 % over 60 deg."""
    mechanics = Mechanics(Twin(capstan_friction=coefficient, **LEVEL), 0.0)
    turned(mechanics, 0.0, 28.5)
    bend_rad = mechanics._joints[-5:].sum()
    assert np.degrees(bend_rad) == pytest.approx(60, abs=5)
    at_pulley_n, *_, last_n = tensions_n(mechanics)
    # The last half flexure lies beyond the last hole in which the tendon turns.
    turned_rad = bend_rad - mechanics._joints[-1] / 2
    assert last_n / at_pulley_n == pytest.approx(np.exp(-coefficient * turned_rad), abs=0.01)
    assert 1 - (last_n / at_pulley_n) ** (np.radians(60) / turned_rad) == pytest.approx(
        0.23, abs=0.025
    )


def test_a_paid_out_tendon_keeps_more_tension_at_its_end_than_at_the_pulley():
    mechanics = Mechanics(Twin(capstan_friction=0.25, **LEVEL), 0.0)
    turned(mechanics, 0.0, 36.0)
    turned(mechanics, 36.0, 25.0)
    forces_n = tensions_n(mechanics)
    assert (np.diff(forces_n) > 0).all()


def test_without_capstan_friction_the_tendons_are_those_of_before():
    assert "pulley" not in robot_mjcf(Twin(capstan_friction=0.0))
    assert Mechanics(Twin(), 0.0)._memories == []


def gap_mm(coefficient: float, past_deg: float = 20.0) -> float:
    """Distance of the tip at the same angle, reached from above and from below."""
    mechanics = Mechanics(Twin(capstan_friction=coefficient, joint_damping=4e-3), 0.0)
    turned(mechanics, 0.0, 30.0 + past_deg)
    turned(mechanics, 30.0 + past_deg, 30.0)
    from_above_mm = mechanics.markers_mm()[2]
    turned(mechanics, 30.0, 30.0 - past_deg)
    turned(mechanics, 30.0 - past_deg, 30.0)
    return float(np.linalg.norm(mechanics.markers_mm()[2] - from_above_mm))


@pytest.mark.long
def test_the_same_angle_from_above_and_from_below_leaves_the_tip_apart():
    without_mm, weak_mm, strong_mm, short_mm = (
        gap_mm(0.0), gap_mm(0.2), gap_mm(0.4), gap_mm(0.4, past_deg=0.5)
    )  # fmt: skip
    assert without_mm < 0.002
    assert weak_mm > 0.1
    assert strong_mm > 1.5 * weak_mm
    assert short_mm < 0.5 * strong_mm, "a short way back is mostly elastic"


def test_friction_does_not_move_the_start_and_stuck_tendons_do_not_creep(tip, posed):
    np.testing.assert_allclose(tip(capstan_friction=0.4), tip(), atol=1e-4)
    robot = posed(10, 20, capstan_friction=0.4)
    there_mm = robot.tip_mm()
    robot.advance_to(10_000_000)
    np.testing.assert_allclose(robot.tip_mm(), there_mm, atol=1e-3)


def test_the_holes_remember_however_often_the_state_is_read(pulses_half_us):
    def driven(chunk_us: int) -> bytes:
        robot = TwinRobot(Twin(capstan_friction=0.3, creep_share=0.2, creep_time_s=0.5))
        for k in range(2):
            robot.set_pulses_half_us(pulses_half_us(15 - 20 * k, 40 * k))
            for time_us in range(k * 250_000 + chunk_us, (k + 1) * 250_000 + 1, chunk_us):
                robot.advance_to(time_us)
                robot.markers_mm()
        return robot.markers_mm().tobytes()

    assert driven(250_000) == driven(2_500)


def creep_mm(**keys) -> tuple[float, float, float]:
    """Deflection of a free robot 0.3 s and 5 s after a push, and 5 s after its end."""
    push = Push(force_n=(0.02, 0.0, 0.0), start_s=0.0, end_s=5.0)
    robot = TwinRobot(Twin(slack_mm=50.0, gravity_m_s2=0.0, push=push, joint_damping=4e-3, **keys))
    robot.start_path_clock(0)
    places_mm = []
    for time_us in (300_000, 5_000_000, 10_000_000):
        robot.advance_to(time_us)
        places_mm.append(float(robot.tip_mm()[X]))
    return places_mm[0], places_mm[1], places_mm[2]


def test_a_load_creeps_by_its_share_in_five_time_constants_and_recovers():
    stiff = {"bending_stiffness_nm_rad": 0.1}
    _, free_mm, _ = creep_mm(**stiff)
    at_first_mm, at_last_mm, after_mm = creep_mm(
        creep_share=0.3, creep_time_s=1.0, **stiff, time_step_ms=0.5
    )
    # At a constant load the time constant is longer by the share: 1.3 s.
    gone = np.exp(-0.3 / 1.3), np.exp(-5.0 / 1.3)
    for deflection_mm, left in zip((at_first_mm, at_last_mm), gone, strict=True):
        assert deflection_mm == pytest.approx(free_mm * (1 - 0.3 / 1.3 * left), rel=0.01)
    assert at_last_mm / (free_mm / 1.3) - 1 == pytest.approx(0.3, rel=0.05)
    assert abs(after_mm) < 0.02 * free_mm


def test_two_branches_creep_one_after_the_other():
    stiff = {"bending_stiffness_nm_rad": 0.1}
    fast_mm, slow_mm = (
        np.diff(creep_mm(creep_share=share, creep_time_s=(0.2, 4.0), **stiff)[:2])[0]
        for share in ((0.3, 0.0), (0.0, 0.3))
    )
    both_mm = np.diff(creep_mm(creep_share=(0.3, 0.3), creep_time_s=(0.2, 4.0), **stiff)[:2])[0]
    assert 0 < fast_mm < slow_mm < both_mm


def test_creep_does_not_move_the_start(tip):
    np.testing.assert_allclose(tip(creep_share=(0.3, 0.2)), tip(), atol=1e-3)
