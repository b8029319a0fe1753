"""The measurements of the emulated optics."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from ccr_host.description.simulation import Tracker, Twin
from ccr_host.sim.polaris.sensor import (
    BitOrder,
    Placement,
    PolarisFaults,
    PositionSensor,
    StrayList,
    format_tx,
)
from ccr_host.sim.robot.robot import TwinRobot
from ccr_host.sim.robot.scene import TwinScene
from ccr_host.tracking.sources.ndi.replies import VICRA
from ccr_host.tracking.sources.twin import Camera

MARKERS_MM = np.array([(0.0, 0.0, 15.0), (1.0, -58.0, 12.0), (20.0, -90.0, 10.0)])


def sensor(
    faults: PolarisFaults | None = None, placement: Placement | None = None, **keys
) -> PositionSensor:
    tracker = Tracker(**({"latency_ms": 0.0, "noise_mm": 0.0} | keys))
    device = PositionSensor(
        np.random.default_rng(1), tracker, placement=placement, faults=faults or PolarisFaults()
    )
    device.illuminated = True
    return device


def test_camera_turned_sees_what_the_twins_camera_sees():
    rotation_deg = (3.0, -20.0, 45.0)
    twin = Camera(
        Tracker(noise_mm=0, latency_ms=0, rotation_deg=rotation_deg), np.random.default_rng()
    )
    twin.expose(0, MARKERS_MM)
    device = sensor(placement=Placement(rotation_deg, (0, 0, 0)))
    device.expose(0, MARKERS_MM)
    np.testing.assert_allclose(device.newest(0).markers_mm, twin.newest(0).markers_mm, atol=1e-12)


def test_quaternion_of_the_placement_agrees_with_scipy():
    placement = Placement((3.0, -20.0, 45.0))
    expected = Rotation.from_rotvec((3.0, -20.0, 45.0), degrees=True).inv()
    w, x, y, z = placement.quaternion()
    assert (Rotation.from_quat((x, y, z, w)) * expected.inv()).magnitude() < 1e-12


@pytest.mark.long
def test_noise_is_the_rms_length_of_the_error_of_the_tip():
    device, errors = sensor(noise_mm=0.4), []
    truth = MARKERS_MM[2] - MARKERS_MM[0]
    for _ in range(8_000):
        time_us = device.next_exposure_us
        device.expose(time_us, MARKERS_MM)
        markers_mm = device.newest(time_us).markers_mm
        errors.append(markers_mm[2] - markers_mm[0] - truth)
    assert np.sqrt((np.array(errors) ** 2).sum(axis=1).mean()) == pytest.approx(0.4, rel=0.02)


def test_dark_exposures_show_nothing_not_even_phantoms():
    device = sensor(PolarisFaults(phantoms=3))
    device.illuminated = False
    device.expose(0, MARKERS_MM)
    image = device.newest(0)
    assert not image.visible.any()
    assert len(image.phantoms_mm) == 0


def test_frozen_exposures_repeat_the_last_frame():
    device = sensor(PolarisFaults(frozen=0.3))
    counts = []
    for _ in range(5000):
        time_us = device.next_exposure_us
        device.expose(time_us, MARKERS_MM)
        image = device.newest(time_us)
        counts.append(image.count if image else -1)
    assert np.mean(np.diff(counts) == 0) == pytest.approx(0.3, abs=0.03)


@pytest.mark.long
def test_exposures_are_at_20_hz_without_drift():
    device = sensor()
    for _ in range(6000):
        device.expose(device.next_exposure_us, MARKERS_MM)
    assert device.next_exposure_us == 300_000_000


@pytest.mark.parametrize(
    ("point_mm", "inside"),
    [
        ((0, 0, -557), True),
        ((0, 0, -556.9), False),
        ((0, 0, -1336), True),
        ((0, 0, -1336.1), False),
        ((196, 246, -557), True),
        ((196.1, 0, -557), False),
        ((0, -246.1, -557), False),
        ((443.5, 469, -1336), True),
        ((319.7, 357.4, -946.5), True),
        ((319.8, 0, -946.5), False),
        ((0, 357.6, -946.5), False),
    ],
)
def test_volume_of_the_vicra(point_mm, inside):
    assert VICRA.contains(point_mm).tolist() == [inside]


@pytest.mark.parametrize(
    ("order", "digits"),
    [(BitOrder.FIRST_IS_HIGHEST, "11"), (BitOrder.FIRST_IS_LOWEST, "01")],
)
def test_bit_orders_differ_where_the_dispute_is(order, digits):
    strays = StrayList(np.zeros((5, 3)), np.array([False, True, True, True, True]))
    text = format_tx(0x1800, [], strays, 0, order)
    first_digits = {"11": "10", "01": "01"}[digits]
    assert text[4:6] == first_digits


def test_frames_of_a_seed_are_repeatable():
    images = []
    for _ in range(2):
        device = sensor(PolarisFaults(shuffle=True, phantoms=3, occlusion=0.2), noise_mm=0.25)
        device.expose(0, MARKERS_MM)
        images.append(device.newest(0))
    np.testing.assert_array_equal(images[0].markers_mm, images[1].markers_mm)
    np.testing.assert_array_equal(images[0].phantoms_mm, images[1].phantoms_mm)
    np.testing.assert_array_equal(images[0].ranks, images[1].ranks)


def test_scene_of_the_twin_exposes_the_sensor_at_exact_times():
    device = sensor(latency_ms=40.0)
    robot = TwinRobot(Twin())
    robot.set_pulses_half_us((3000 + 800, 3000 - 800))
    scene = TwinScene(robot, device)
    other = TwinRobot(Twin())
    other.set_pulses_half_us((3000 + 800, 3000 - 800))
    for time_us in (33_000, 66_000, 190_000):
        scene.advance_to(time_us)
    image = device.newest(190_000)
    assert image.count == 9
    other.advance_to(150_000)
    np.testing.assert_allclose(
        image.markers_mm, Placement().to_camera(other.markers_mm()), atol=1e-9
    )
