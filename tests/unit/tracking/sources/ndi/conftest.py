"""A driver and an emulated camera in virtual time."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import pytest

from ccr_host.core.clock import VirtualClock
from ccr_host.description.simulation import Tracker
from ccr_host.sim.polaris.line import PolarisLine, make_polaris
from ccr_host.sim.polaris.sensor import NO_FAULTS, PolarisFaults
from ccr_host.tracking.sources.ndi.driver import NdiSettings, NdiTracker
from ccr_host.tracking.tracker import MarkerFrame
from tests.exposer import Exposer

MARKERS_MM = np.array([(0.0, 0.0, 15.0), (1.0, -58.0, 12.0), (20.0, -90.0, 10.0)])


@dataclass
class Bench:
    """Camera, line, driver and clock."""

    clock: VirtualClock
    line: PolarisLine
    tracker: NdiTracker

    def run_ms(self, duration_ms: int) -> list[MarkerFrame]:
        """Let time pass; return the new frames."""
        frames: list[MarkerFrame] = []
        last = self.tracker.newest_frame()
        for _ in range(duration_ms):
            self.clock.sleep_until_us(self.clock.now_us() + 1000)
            newest = self.tracker.newest_frame()
            if newest is not None and newest is not last:
                frames.append(newest)
                last = newest
        return frames

    def run_until_tracking(self, limit_ms: int = 20_000) -> None:
        """Until the start-up is over and the markers are lit."""
        for _ in range(limit_ms):
            self.clock.sleep_until_us(self.clock.now_us() + 1000)
            newest = self.tracker.newest_frame()
            if self.tracker.health.tracking and newest is not None and newest.frame_number > 6:
                return
        raise AssertionError(self.tracker.health)


@pytest.fixture
def bench() -> Callable[..., Bench]:
    def build(
        faults: PolarisFaults = NO_FAULTS,
        *,
        paced: bool = True,
        motion: Callable[[int], np.ndarray] = lambda _time_us: MARKERS_MM,
        settings: NdiSettings | None = None,
        seed: int = 1,
        **tracker_keys: object,
    ) -> Bench:
        keys = {"noise_mm": 0.0} | tracker_keys
        line = make_polaris(
            Tracker(**keys), np.random.SeedSequence(seed), faults=faults, paced=paced
        )
        clock = VirtualClock()
        clock.attach(Exposer(line.device.sensor, motion))
        clock.attach(line)
        tracker = NdiTracker("ndi-emulator:", lambda: line, settings)
        clock.attach(tracker)
        tracker.start()
        return Bench(clock, line, tracker)

    return build
