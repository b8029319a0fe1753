"""The time axis that all charts share."""

from __future__ import annotations

import numpy as np

from ccr_host.view.charts import axis_end_s


def test_the_time_axis_ends_at_round_times_and_changes_seldom() -> None:
    times_s = np.arange(0.0, 86_400.0, 0.5)
    ends = [axis_end_s(time_s) for time_s in times_s]
    assert (np.array(ends) >= times_s).all()
    assert sorted({*ends})[:5] == [30.0, 45.0, 60.0, 90.0, 120.0]
    assert len({*ends}) < 30
    assert axis_end_s(60.0) == 60.0
