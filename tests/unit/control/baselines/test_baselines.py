"""What every peer keeps to, whatever it sees."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ccr_host.control.base import Approaching, Controller, Observation, Outcome
from ccr_host.control.registry import baseline_names, controller_names, make_controller
from ccr_host.core.errors import ConfigError
from ccr_host.robot.kinematics import ConstantCurvature
from tests.unit.control.baselines.plant import (
    BELIEVED,
    DESCRIPTION,
    LIMITS,
    SLEW_RAD_S,
    Bench,
    reference_of,
)

PEERS = baseline_names()

anything = st.floats(allow_nan=True, allow_infinity=True)
near = st.floats(-120.0, 120.0)
tips = st.none() | st.tuples(near, near, near) | st.tuples(anything, anything, anything)
observations = st.tuples(
    tips,
    st.integers(-1_000_000, 3_000_000),
    st.none() | st.tuples(anything, anything),
)


@pytest.mark.long
@pytest.mark.parametrize("name", PEERS)
@given(seen=st.lists(observations, min_size=1, max_size=12), is_slow=st.booleans())
@settings(max_examples=40, deadline=None)
def test_commands_stay_finite_within_limits_and_slew_whatever_is_observed(name, seen, is_slow):
    reference = reference_of("star", 1.0) if is_slow else reference_of("ellipse", 20.0)
    controller = make_controller(name, DESCRIPTION)
    last_rad = controller.start(reference).q_rad
    most_rad = SLEW_RAD_S * reference.period_s + 1e-9
    time_us = 0
    for step, (tip, age_us, accepted) in enumerate(seen, 1):
        tip_mm = None if tip is None else np.array(tip)
        q_rad = last_rad if accepted is None else np.array(accepted)
        time_us += round(reference.period_s * 1e6)
        command = controller.step(Observation(step, time_us, tip_mm, age_us, q_rad))
        assert np.isfinite(command.q_rad).all()
        assert (LIMITS.clip(command.q_rad) == command.q_rad).all()
        if accepted is None:
            assert np.abs(command.q_rad - last_rad).max() <= most_rad
        last_rad = command.q_rad


@pytest.mark.long
@pytest.mark.parametrize("name", PEERS)
@pytest.mark.parametrize("rate_hz", [1.0, 5.0, 20.0])
def test_on_a_robot_that_turns_a_tenth_less_than_believed_feedback_halves_the_error(name, rate_hz):
    geometry = DESCRIPTION.robot
    pulley_mm = 0.9 * geometry.pulley_radius_mm
    true = ConstantCurvature(geometry.model_copy(update={"pulley_radius_mm": pulley_mm}))
    reference = reference_of("8shape", rate_hz)
    bench = Bench(name, reference)
    list(bench.approach(true.tip_mm))
    shown = range(min(len(reference), 400))
    steps = bench.follow(true.tip_mm, shown)
    errors = [np.linalg.norm(step.tip_mm - reference.target_mm[i]) for i, step in enumerate(steps)]
    unseen_mm = true.tip_mm(reference.q_rad[shown]) - reference.target_mm[shown]
    uncorrected = np.linalg.norm(unseen_mm, axis=1)
    assert np.mean(errors) < 0.5 * np.mean(uncorrected)
    assert np.max(errors) < np.max(uncorrected)


@pytest.mark.parametrize("name", PEERS)
def test_the_approach_ends_at_the_first_point_however_far_the_robot_sags(name):
    reference = reference_of("8shape", 1.0)
    bench = Bench(name, reference)

    def sagging(q_rad):
        return BELIEVED.tip_mm(q_rad - np.radians([6.0, -4.0]))

    assert isinstance(bench.controller, Approaching)
    *_, last = bench.approach(sagging)
    assert np.linalg.norm(last.tip_mm - reference.target_mm[0]) < 0.1


@pytest.mark.long
@pytest.mark.parametrize("name", PEERS)
def test_a_tip_held_fast_winds_nothing_up(name):
    reference = reference_of("8shape", 20.0)
    bench = Bench(name, reference)
    list(bench.approach(BELIEVED.tip_mm))
    stuck_mm = reference.target_mm[0] + np.array([10.0, 0.0, -10.0])
    list(bench.follow(lambda _: stuck_mm, range(200)))
    *_, last = bench.follow(BELIEVED.tip_mm, range(200, 300))
    assert np.linalg.norm(last.tip_mm - reference.target_mm[299]) < 1.0


@pytest.mark.long
@pytest.mark.parametrize("name", PEERS)
def test_without_markers_it_coasts_along_the_path(name):
    reference = reference_of("8shape", 20.0)
    bench = Bench(name, reference)
    list(bench.approach(BELIEVED.tip_mm))
    list(bench.follow(BELIEVED.tip_mm, range(100)))
    *_, last = bench.follow(lambda _: None, range(100, 140))
    assert last.command.outcome is Outcome.COASTED
    tip_mm = BELIEVED.tip_mm(last.command.q_rad)
    travelled_mm = np.linalg.norm(reference.target_mm[139] - reference.target_mm[99])
    assert np.linalg.norm(tip_mm - reference.target_mm[139]) < 0.3 * travelled_mm


@pytest.mark.parametrize("name", PEERS)
def test_a_picture_seen_twice_changes_nothing_more(name):
    """A control rate above the camera's shows the same exposure again."""
    reference = reference_of("8shape", 20.0)
    once, twice = Bench(name, reference), Bench(name, reference)
    off_mm = reference.target_mm[0] + 3.0
    for bench, seen_again in ((once, False), (twice, True)):
        bench.controller.step(Observation(0, 1_000_000, off_mm, 0, bench.q_rad))
        again = off_mm if seen_again else None
        after = Observation(1, 1_050_000, again, 50_000, bench.q_rad)
        bench.q_rad = bench.controller.step(after).q_rad
    assert twice.q_rad == pytest.approx(once.q_rad, abs=1e-12)


def test_names_make_controllers_of_that_name_and_are_no_default():
    for name in PEERS:
        controller = make_controller(name, DESCRIPTION)
        typed: Controller = controller
        assert typed.name == name
    assert not set(PEERS) & set(controller_names())
    with pytest.raises(ConfigError, match="kalman-jacobian"):
        make_controller("pid", DESCRIPTION)
