import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ccr_host.control.baselines import Broyden, KalmanJacobian, damped_inverse
from ccr_host.description.schema import Description

TRUE = np.array([[0.0, 80.0], [60.0, -10.0], [90.0, 25.0]])
ESTIMATORS = [Broyden, KalmanJacobian]


@pytest.mark.parametrize("estimator_type", ESTIMATORS)
def test_motions_of_a_linear_robot_teach_its_jacobian(estimator_type):
    estimator = estimator_type(Description())
    estimator.guess(np.array([[0.0, 110.0], [20.0, 20.0], [120.0, -10.0]]))
    rng = np.random.default_rng(3)
    for turn in rng.normal(scale=0.1, size=(60, 2)):
        estimator.correct(turn, TRUE @ turn)
    assert estimator.jacobian_mm_rad == pytest.approx(TRUE, abs=1.0)


@pytest.mark.parametrize("estimator_type", ESTIMATORS)
@given(
    turn=st.tuples(st.floats(-0.5, 0.5), st.floats(-0.5, 0.5)).filter(any),
    move=st.tuples(*[st.floats(-100.0, 100.0)] * 3),
)
def test_a_correction_explains_more_and_leaves_the_direction_across_alone(
    estimator_type, turn, move
):
    turn, move = np.array(turn), np.array(move)
    estimator = estimator_type(Description())
    estimator.guess(TRUE)
    estimator.correct(turn, move)
    unexplained_before = np.linalg.norm(move - TRUE @ turn)
    unexplained_after = np.linalg.norm(move - estimator.jacobian_mm_rad @ turn)
    assert unexplained_after <= unexplained_before + 1e-9
    across = np.array([-turn[1], turn[0]])
    assert estimator.jacobian_mm_rad @ across == pytest.approx(TRUE @ across, abs=1e-6)


@pytest.mark.parametrize("estimator_type", ESTIMATORS)
def test_one_wild_motion_is_forgotten_after_a_few_good_ones(estimator_type):
    estimator = estimator_type(Description())
    estimator.guess(TRUE)
    estimator.correct(np.array([0.03, 0.0]), np.array([80.0, -80.0, 80.0]))
    rng = np.random.default_rng(4)
    for turn in rng.normal(scale=0.1, size=(60, 2)):
        estimator.correct(turn, TRUE @ turn)
    assert estimator.jacobian_mm_rad == pytest.approx(TRUE, abs=5.0)


@given(st.lists(st.floats(-1e4, 1e4), min_size=6, max_size=6), st.floats(1.0, 100.0))
def test_the_damped_inverse_never_turns_further_than_half_over_its_damping(entries, damping):
    inverse = damped_inverse(np.array(entries).reshape(3, 2), damping)
    assert np.linalg.norm(inverse, 2) <= 0.5 / damping * (1.0 + 1e-6)


def test_without_damping_to_speak_of_it_is_the_pseudo_inverse():
    assert damped_inverse(TRUE, 1e-6) == pytest.approx(np.linalg.pinv(TRUE), abs=1e-9)
