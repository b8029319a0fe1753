"""Puts an emulated camera together."""

from __future__ import annotations

import numpy as np

from ccr_host.config import Tracker
from ccr_host.emulator.polaris.device import PolarisDevice
from ccr_host.emulator.polaris.faults import NO_FAULTS, PolarisFaults
from ccr_host.emulator.polaris.line import PolarisLine
from ccr_host.emulator.polaris.placement import Placement
from ccr_host.emulator.polaris.sensor import PositionSensor


def make_polaris(
    tracker: Tracker,
    seed: np.random.SeedSequence,
    *,
    faults: PolarisFaults = NO_FAULTS,
    paced: bool = True,
) -> PolarisLine:
    """An emulated Vicra with the noise, latency and misalignment of a robot description.

    Its rate is the Vicra's 20 Hz, whatever `tracker.rate_hz` says. `tracker.dropout` hides each
    marker with that probability.

    Args:
        tracker: the `tracker` section of the robot description.
        seed: of noise and faults.
        faults: what else goes wrong.
        paced: False where the bytes travel over TCP.
    """
    optics_seed, line_seed = seed.spawn(2)
    sensor = PositionSensor(
        np.random.default_rng(optics_seed),
        placement=Placement(rotation_deg=tracker.rotation_deg),
        noise_mm=tracker.noise_mm,
        latency_us=round(tracker.latency_ms * 1000),
        faults=faults,
    )
    return PolarisLine(PolarisDevice(sensor), np.random.default_rng(line_seed), paced=paced)
