import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from ccr_host.view.charts import peak_rows


@given(st.lists(st.floats(-1e6, 1e6), max_size=300), st.integers(1, 50))
def test_a_thinned_curve_keeps_its_peak_its_order_and_its_end(
    values: list[float], most: int
) -> None:
    curve = np.array(values)
    rows = peak_rows(curve, most)
    assert len(rows) <= min(len(curve), most + 1)
    assert (np.diff(rows) > 0).all()
    if values:
        assert rows[-1] == len(curve) - 1
        assert curve[rows].max() == curve.max()
    if len(curve) <= most:
        assert len(rows) == len(curve)
