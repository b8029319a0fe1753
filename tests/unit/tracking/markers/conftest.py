"""The twin's motion as a camera sees it, and a labeller to label it."""

from __future__ import annotations

import numpy as np
import pytest

from bench.labelling import FRAME_US, NOISE_MM, Motion, at_20_hz, closed_loop
from ccr_host.description.schema import Robot
from ccr_host.tracking.markers.labelling import Labeller


@pytest.fixture(scope="session")
def slow_motion() -> Motion:
    """The 8-shape with commands at 20 Hz."""
    return at_20_hz("8shape")


@pytest.fixture(scope="session")
def jerky_motion() -> Motion:
    """The 8-shape in a closed loop at 1 Hz: steps of up to 50 mm, and ringing."""
    return closed_loop("8shape")


class Camera:
    """Shows markers in the robot's frame, and lets tests hide and add points."""

    def __init__(self, labeller: Labeller, seed: int = 1) -> None:
        self.rng = np.random.default_rng(seed)
        self.labeller = labeller
        self.frame = 0

    def show(self, markers_mm, q_rad=(0.0, 0.0), hidden=(), extra=()):
        seen = [m for m in range(3) if m not in hidden]
        real = markers_mm[seen] + self.rng.normal(0.0, NOISE_MM, (len(seen), 3))
        points = np.concatenate([real, np.asarray(extra, dtype=float).reshape(-1, 3)])
        self.frame += 1
        return self.labeller.label(
            self.frame * FRAME_US, points[self.rng.permutation(len(points))], q_rad
        )

    def show_again(self, markers_mm, times, **keys):
        for _ in range(times):
            found = self.show(markers_mm, **keys)
        return found


@pytest.fixture
def camera() -> Camera:
    return Camera(Labeller(Robot(), np.eye(3)))


@pytest.fixture
def unregistered_camera() -> Camera:
    return Camera(Labeller(Robot()))


@pytest.fixture(scope="session")
def rest(slow_motion) -> np.ndarray:
    """(3, 3): the markers at the start of the 8-shape."""
    return slow_motion.markers_mm[39]


@pytest.fixture(scope="session")
def rest_q(slow_motion) -> np.ndarray:
    return slow_motion.q_rad[39]
