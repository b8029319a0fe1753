import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from ccr_host.run.summary import quantiles_us, statistics_of


def test_figures_of_a_worked_example() -> None:
    figures = statistics_of(np.array([[3.0, 4.0, 0.0], [0.0, 0.0, 1.0]]))
    assert figures["mean_error_mm"] == pytest.approx(3.0)
    assert figures["rmse_mm"] == pytest.approx(math.sqrt(13.0))
    assert figures["max_error_mm"] == pytest.approx(5.0)
    lateral_mm = figures["mean_lateral_error_mm"]
    assert lateral_mm == pytest.approx(2.0), "the component along the robot is left out"


@given(arrays(np.float64, st.tuples(st.integers(1, 30), st.just(3)), elements=st.floats(-50, 50)))
def test_figures_are_ordered(errors_mm: np.ndarray) -> None:
    mean_mm, rmse_mm, p95_mm, max_mm, lateral_mm = statistics_of(errors_mm).values()
    slack = 1e-9
    assert 0 <= lateral_mm <= mean_mm + slack
    assert mean_mm <= rmse_mm + slack
    assert rmse_mm <= max_mm + slack
    assert p95_mm <= max_mm + slack


def test_steps_without_a_measurement_do_not_count() -> None:
    known = np.array([[1.0, 0.0, 0.0], [np.nan, np.nan, np.nan], [3.0, 0.0, 0.0]])
    assert statistics_of(known)["mean_error_mm"] == 2.0


def test_nothing_measured_gives_no_figures() -> None:
    assert {*statistics_of(np.full((4, 3), np.nan)).values()} == {None}
    assert quantiles_us(np.array([])) == {"median": None, "p99": None, "max": None}
