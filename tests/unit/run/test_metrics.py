import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from ccr_host.run.summary import ErrorFigures, quantiles_us


def test_figures_of_a_worked_example() -> None:
    figures = ErrorFigures.of(np.array([[3.0, 4.0, 0.0], [0.0, 0.0, 1.0]]))
    assert figures is not None
    assert figures.mean_mm == pytest.approx(3.0)
    assert figures.rmse_mm == pytest.approx(math.sqrt(13.0))
    assert figures.max_mm == pytest.approx(5.0)
    assert figures.mean_lateral_mm == pytest.approx(2.0), (
        "the component along the robot is left out"
    )


@given(arrays(np.float64, st.tuples(st.integers(1, 30), st.just(3)), elements=st.floats(-50, 50)))
def test_figures_are_ordered(errors_mm: np.ndarray) -> None:
    figures = ErrorFigures.of(errors_mm)
    assert figures is not None
    slack = 1e-9
    assert 0 <= figures.mean_lateral_mm <= figures.mean_mm + slack
    assert figures.mean_mm <= figures.rmse_mm + slack
    assert figures.rmse_mm <= figures.max_mm + slack
    assert figures.p95_mm <= figures.max_mm + slack


def test_steps_without_a_measurement_do_not_count() -> None:
    known = np.array([[1.0, 0.0, 0.0], [np.nan, np.nan, np.nan], [3.0, 0.0, 0.0]])
    figures = ErrorFigures.of(known)
    assert figures is not None
    assert figures.mean_mm == 2.0


def test_nothing_measured_gives_no_figures() -> None:
    assert ErrorFigures.of(np.full((4, 3), np.nan)) is None
    assert quantiles_us(np.array([])) == {"median": None, "p99": None, "max": None}
