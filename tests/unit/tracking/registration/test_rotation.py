import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from ccr_host.tracking.rotation import rotation_matrix, rotation_vector

VECTORS = st.tuples(*[st.floats(-4.0, 4.0)] * 3).map(np.array)


@given(VECTORS)
def test_matrix_is_that_of_scipy(vector):
    expected = Rotation.from_rotvec(vector).as_matrix()
    np.testing.assert_allclose(rotation_matrix(vector), expected, atol=1e-12)


@given(VECTORS)
def test_vector_gives_the_matrix_back(vector):
    matrix = rotation_matrix(vector)
    shortest = rotation_vector(matrix)
    assert np.linalg.norm(shortest) <= np.pi + 1e-9
    np.testing.assert_allclose(rotation_matrix(shortest), matrix, atol=1e-9)


@pytest.mark.parametrize("axis", [(1, 0, 0), (0, 1, 0), (0, 0, 1), (1, 1, 1), (1, -2, 0.5)])
def test_half_turns_are_told_apart(axis):
    half_turn = np.pi * np.array(axis, dtype=float) / np.linalg.norm(axis)
    matrix = rotation_matrix(half_turn)
    np.testing.assert_allclose(rotation_matrix(rotation_vector(matrix)), matrix, atol=1e-9)
