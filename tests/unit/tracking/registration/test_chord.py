import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.integrate import solve_bvp

from ccr_host.robot.arc import arc_derivatives
from ccr_host.tracking.registration import chord

BENDINGS = np.linspace(-2.0, 2.0, 9)


def test_without_load_it_is_the_unit_arc():
    np.testing.assert_allclose(chord(BENDINGS, 0.0), arc_derivatives(BENDINGS)[0], atol=4e-4)


@pytest.mark.parametrize("load", [-0.5, 0.3, 1.0])
@pytest.mark.parametrize("bending", [-1.5, 0.0, 0.7, 2.0])
def test_it_solves_the_equation_of_the_loaded_arc(load, bending):
    """theta'' = w cos(theta), theta(0) = 0, theta(1) given; x' = cos, y' = sin."""

    def slopes(_s, y):
        return np.array([y[1], load * np.cos(y[0]), np.cos(y[0]), np.sin(y[0])])

    def ends(start, end):
        return np.array([start[0], end[0] - bending, start[2], start[3]])

    along = np.linspace(0.0, 1.0, 20)
    guess = np.array([bending * along, 0 * along + bending, along, 0 * along])
    solution = solve_bvp(slopes, ends, along, guess, tol=1e-8).y[:, -1]
    found = chord(np.array([bending]), load)[0]
    assert abs(found - complex(solution[2], solution[3])) < 5e-4


@given(st.floats(-2.5, 2.5), st.floats(-1.0, 1.0))
def test_turned_over_it_bends_the_other_way(bending, load):
    one, other = chord(np.array([bending]), load)[0], chord(np.array([-bending]), -load)[0]
    assert abs(one - other.conjugate()) < 1e-12
