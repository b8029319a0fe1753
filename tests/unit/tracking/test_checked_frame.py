"""Frames of trackers that users wrote."""

import math

import numpy as np
import pytest

from ccr_host.tracking.tracker import MarkerFrame, Pose, checked_frame

UNTURNED = np.array([1.0, 0.0, 0.0, 0.0])


@pytest.mark.parametrize("nowhere", [math.nan, math.inf, -math.inf, 1e300])
def test_what_is_nowhere_counts_as_not_seen(nowhere: float) -> None:
    there, gone = np.array([1.0, 2.0, 3.0]), np.array([1.0, nowhere, 3.0])
    tools = {"M1": Pose(there, UNTURNED), "M3": Pose(gone, UNTURNED)}
    frame = checked_frame(
        MarkerFrame(5, 1, np.stack([gone, there]), np.array([True, False]), tools)
    )
    assert list(frame.tools) == ["M1"]
    np.testing.assert_array_equal(frame.points_mm, [there])
    assert frame.out_of_volume.tolist() == [False]


@pytest.mark.parametrize("where", ["points", "position", "quaternion"])
def test_complex_numbers_are_refused(where: str) -> None:
    numbers = {"points": np.ones((1, 3)), "position": np.ones(3), "quaternion": UNTURNED}
    numbers[where] = numbers[where] * 1j
    tools = {"M1": Pose(numbers["position"], numbers["quaternion"])}
    with pytest.raises(TypeError, match=r"Cannot cast .* from dtype.'complex128'"):
        checked_frame(MarkerFrame(5, 1, numbers["points"], np.array([False]), tools))
