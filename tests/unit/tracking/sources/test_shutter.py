"""Jitter, blur and outliers of the simulated cameras: the twin's own and the emulated Polaris."""

from collections.abc import Callable

import numpy as np
import pytest

from ccr_host.core.errors import ConfigError
from ccr_host.description import schema
from ccr_host.description.simulation import Tracker
from ccr_host.sim.polaris.sensor import Placement, PositionSensor
from ccr_host.tracking.sources.twin import Camera

MARKERS_MM = np.array([(0.0, 0.0, 15.0), (1.0, -58.0, 12.0), (20.0, -90.0, 10.0)])
Motion = Callable[[float], float]
"""Displacement of M3 along x, mm, over time, s."""


def twins(tracker: Tracker) -> Camera:
    return Camera(tracker, np.random.default_rng(1))


def polaris(tracker: Tracker) -> PositionSensor:
    at_robot = Placement(base_mm=(0.0, 0.0, 0.0))
    sensor = PositionSensor(np.random.default_rng(1), tracker, placement=at_robot)
    sensor.illuminated = True
    return sensor


CAMERAS = pytest.mark.parametrize("make", [twins, polaris])


def pictures(make, exposures: int, motion: Motion = lambda _: 0.0, **keys) -> np.ndarray:
    """Errors of the pictures of markers of which M3 moves, (exposures, 3, 3), without dropout."""
    camera = make(Tracker(**({"noise_mm": 0.0, "latency_ms": 0.0} | keys)))
    seen, last, time_us = [], None, 0
    while len(seen) < exposures:
        assert camera.next_exposure_us >= time_us
        time_us = camera.next_exposure_us
        here_mm = MARKERS_MM.copy()
        here_mm[2, 0] += motion(time_us * 1e-6)
        camera.expose(time_us, here_mm)
        sample = camera.newest(10**12)
        if sample is not last:
            last = sample
            seen.append(sample.markers_mm - MARKERS_MM)
    return np.array(seen)


@CAMERAS
def test_an_outlier_is_one_marker_seen_at_that_distance_in_that_share_of_the_exposures(make):
    off_mm = np.linalg.norm(pictures(make, 4000, outliers=0.1, outlier_mm=5.0), axis=2)
    hit = off_mm > 1e-6
    assert hit.any(axis=1).mean() == pytest.approx(0.1, abs=0.015)
    assert hit.sum(axis=1).max() == 1
    assert hit.sum(axis=0).min() > 80
    np.testing.assert_allclose(off_mm[hit], 5.0)


@CAMERAS
def test_a_longer_exposure_smears_a_vibration_and_leaves_a_steady_motion(make):
    def steady(time_s: float) -> float:
        return 100 * time_s

    stated_s = np.arange(1, 40) / 20
    moved_mm = pictures(make, 40, steady, exposure_ms=30.0)[1:, 2, 0]
    np.testing.assert_allclose(moved_mm, 100 * stated_s, atol=1e-3)

    def amplitude_mm(exposure_ms: float) -> float:
        seen = pictures(make, 80, lambda t: np.cos(2 * np.pi * 31 * t), exposure_ms=exposure_ms)
        return float(np.abs(seen[1:, 2, 0]).max())

    assert amplitude_mm(0.0) > 0.99
    assert amplitude_mm(16.0) == pytest.approx(np.sinc(31 * 0.016), rel=0.05)
    assert amplitude_mm(32.3) < 0.02


@CAMERAS
def test_jitter_shows_a_moving_marker_where_it_was_at_another_time(make):
    late_mm = pictures(make, 2000, lambda t: 100 * t, frame_jitter_ms=3.0)[1:, 2, 0]
    error_mm = late_mm - 100 * np.arange(1, 2000) / 20
    assert error_mm.std() == pytest.approx(0.3, rel=0.05)
    assert abs(error_mm.mean()) < 0.03
    still = pictures(make, 50, frame_jitter_ms=3.0)
    np.testing.assert_allclose(still, 0, atol=1e-9)


@CAMERAS
def test_exposures_keep_their_order_whatever_the_jitter(make):
    pictures(make, 300, frame_jitter_ms=1000.0, exposure_ms=20.0)


def test_the_faults_leave_noise_and_dropout_of_a_seed_as_they_are():
    def samples(**keys):
        camera = Camera(Tracker(noise_mm=1.0, dropout=0.3, **keys), np.random.default_rng(2))
        found = {}
        while len(found) < 200:
            camera.expose(camera.next_exposure_us, MARKERS_MM)
            sample = camera.newest(10**12)
            if sample is not None:
                found[sample.exposed_us] = sample.markers_mm
        return found

    plain, faulty = samples(), samples(outliers=0.2, frame_jitter_ms=3.0, exposure_ms=10.0)
    assert plain.keys() == faulty.keys()
    same = [np.allclose(plain[time_us], faulty[time_us]) for time_us in plain]
    assert 0.7 < np.mean(same) < 0.9


def test_no_sample_is_announced_before_its_exposure_has_ended():
    camera = Camera(Tracker(latency_ms=0.0, exposure_ms=40.0), np.random.default_rng(1))
    while camera.newest(camera.next_arrival_us) is None:
        assert camera.next_arrival_us >= camera.next_exposure_us
        camera.expose(camera.next_exposure_us, MARKERS_MM)
    assert camera.newest(0).exposed_us == 0


def test_an_exposure_longer_than_the_period_is_refused():
    with pytest.raises(ConfigError, match=r"exposure_ms = 60 is longer than the period of 50 ms"):
        schema.load(None, ["tracker.exposure_ms=60"])
