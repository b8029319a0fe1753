import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from ccr_host.description.simulation import Tracker
from ccr_host.tracking.sources.twin import Camera

MARKERS_MM = np.array([(0.0, 0.0, 15.0), (1.0, -58.0, 12.0), (20.0, -90.0, 10.0)])


def run(camera: Camera, exposures: int) -> list:
    """Expose and read as soon as the sample can be there."""
    samples = []
    for _ in range(exposures):
        time_us = camera.next_exposure_us
        camera.expose(time_us, MARKERS_MM)
        sample = camera.newest(time_us)
        if sample is not None and sample.exposed_us == time_us:
            samples.append(sample)
    return samples


def camera(seed: int = 1, **keys) -> Camera:
    quiet = {"noise_mm": 0.0, "latency_ms": 0.0}
    return Camera(Tracker(**(quiet | keys)), np.random.default_rng(seed))


def test_noise_is_the_rms_length_of_the_error_of_the_tip():
    tips = np.array([s.tip_mm for s in run(camera(noise_mm=0.4), 20_000)])
    errors = tips - (MARKERS_MM[2] - MARKERS_MM[0])
    assert np.sqrt((errors**2).sum(axis=1).mean()) == pytest.approx(0.4, rel=0.02)
    np.testing.assert_allclose(errors.mean(axis=0), 0, atol=0.01)
    # Isotropic: three uncorrelated coordinates of equal size.
    np.testing.assert_allclose(np.cov(errors.T), np.eye(3) * 0.4**2 / 3, atol=0.002)


def test_noise_of_the_markers_is_independent():
    errors = np.array([s.markers_mm - MARKERS_MM for s in run(camera(noise_mm=1.0), 20_000)])
    np.testing.assert_allclose(np.cov(errors.reshape(-1, 9).T), np.eye(9) / 6, atol=0.01)


def test_quiet_camera_sees_the_truth():
    (sample,) = run(camera(), 1)
    np.testing.assert_array_equal(sample.markers_mm, MARKERS_MM)
    np.testing.assert_array_equal(sample.tip_mm, (20, -90, -5))


@pytest.mark.parametrize("rate_hz", [20.0, 60.0, 7.3])
def test_exposures_keep_the_rate_without_drift(rate_hz):
    device = camera(rate_hz=rate_hz)
    times_us = [sample.exposed_us for sample in run(device, 1001)]
    assert times_us[0] == 0
    assert times_us[1000] == round(1000 * 1e6 / rate_hz)
    assert np.ptp(np.diff(times_us)) <= 1


def test_sample_arrives_after_exactly_the_latency():
    device = camera(latency_ms=40.0)
    device.expose(0, MARKERS_MM)
    device.expose(50_000, MARKERS_MM)
    assert device.newest(39_999) is None
    assert device.newest(40_000).exposed_us == 0
    assert device.newest(89_999).exposed_us == 0
    assert device.newest(90_000).exposed_us == 50_000


def test_late_reader_gets_the_newest_of_several_samples():
    device = camera(latency_ms=120.0)
    for time_us in (0, 50_000, 100_000, 150_000):
        device.expose(time_us, MARKERS_MM)
    assert device.newest(230_000).exposed_us == 100_000


def test_dropout_is_the_share_of_exposures_without_a_sample():
    assert len(run(camera(dropout=0.3), 10_000)) / 10_000 == pytest.approx(0.7, abs=0.015)


def test_noise_of_an_exposure_does_not_depend_on_dropout_or_reading():
    steady = {s.exposed_us: s for s in run(camera(noise_mm=1.0), 200)}
    patchy = run(camera(noise_mm=1.0, dropout=0.5), 200)
    assert 0 < len(patchy) < 200
    for sample in patchy:
        np.testing.assert_array_equal(sample.markers_mm, steady[sample.exposed_us].markers_mm)


def test_camera_turned_about_z_sees_x_as_minus_y():
    (sample,) = run(camera(rotation_deg=(0.0, 0.0, 90.0)), 1)
    np.testing.assert_allclose(sample.tip_mm, (-90, -20, -5), atol=1e-12)


def test_rotation_vector_agrees_with_scipy():
    (sample,) = run(camera(rotation_deg=(3.0, -20.0, 45.0)), 1)
    turn = Rotation.from_rotvec((3.0, -20.0, 45.0), degrees=True)
    np.testing.assert_allclose(sample.markers_mm, turn.inv().apply(MARKERS_MM), atol=1e-12)


def test_misalignment_of_3_deg_moves_the_tip_as_far_as_the_rotation_says():
    (sample,) = run(camera(rotation_deg=(3.0, 0.0, 0.0)), 1)
    _, y, z = MARKERS_MM[2] - MARKERS_MM[0]
    moved = np.linalg.norm(sample.tip_mm - (20, -90, -5))
    assert moved == pytest.approx(2 * np.sin(np.radians(1.5)) * np.hypot(y, z))
