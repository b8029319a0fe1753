"""Collects the samples of the markers during a run, and handles the lack of fresh ones."""

from __future__ import annotations

from collections import deque

import numpy as np

from ccr_host.core.arrays import Array
from ccr_host.core.errors import TrackerError
from ccr_host.description.schema import Description
from ccr_host.run.rig import MOST_ARRIVED, Rig
from ccr_host.tracking.markers.check import MarkerCheck
from ccr_host.tracking.tracker import Sample

_FIRST_SAMPLE_TIMEOUT_US = 5_000_000
_SAMPLE_POLL_US = 10_000
_FOLLOWS_US = 500_000
"""Time for which the robot may still follow a command: lag and latency."""
_SETPOINTS_KEPT = 64
_LOOK_PERIOD_US = 100_000
"""Interval between looks that is tolerated even if the control period is shorter."""


class MarkerWatch:
    """Decides what follows a missing sample: coast on the model, hold the pose, give up.

    Only time in which the host was looking counts: while the host itself was stopped, the markers
    were not lost.
    """

    def __init__(
        self, rig: Rig, description: Description, period_us: int, check: MarkerCheck | None
    ) -> None:
        control = description.control
        self._rig = rig
        self._check = check
        self._stale_us = control.stale_after_ms * 1000
        self._coast_us = control.coast_s * 1e6
        self._hold_us = control.hold_s * 1e6
        self._longest_look_away_us = 2 * max(period_us, _LOOK_PERIOD_US)
        self._last_seen_us = self._looked_us = 0
        self._newest: Sample | None = None
        self.untaken: deque[Sample] = deque(maxlen=MOST_ARRIVED)
        """Measurements that can be the robot's, oldest first; the loop empties it."""
        self.setpoints: deque[tuple[int, Array]] = deque(maxlen=_SETPOINTS_KEPT)
        """Times and setpoints of the last steps; the loop fills it."""
        self._fresh_us = -1

    def wait_for_markers(self) -> None:
        """Wait for markers that can be the robot's.

        Raises:
            TrackerError: there are none in time.
        """
        clock = self._rig.clock
        for _ in range(_FIRST_SAMPLE_TIMEOUT_US // _SAMPLE_POLL_US):
            if self.fresh_sample(clock.now_us()) is not None:
                return
            clock.sleep_until_us(clock.now_us() + _SAMPLE_POLL_US)
        raise self._lost(_FIRST_SAMPLE_TIMEOUT_US)

    def start(self) -> None:
        """Note that the robot moves, and count lost markers and collect samples from now on."""
        if self._check is not None:
            self._check.robot_moves()
        now_us = self._rig.clock.now_us()
        self.fresh_sample(now_us)
        self._last_seen_us = self._looked_us = now_us
        self.untaken.clear()

    def fresh_sample(self, now_us: int) -> Sample | None:
        """Newest measurement that can be the robot's; None if it is stale.

        Looks once per instant of the clock.

        Raises:
            TrackerError: the markers are swapped, or belong to another robot.
        """
        if now_us != self._fresh_us:
            self._fresh_us = now_us
            away_us, self._looked_us = now_us - self._looked_us, now_us
            if away_us > self._longest_look_away_us:
                self._last_seen_us += away_us
            swung_rad = self._swung_rad if self.setpoints else None
            for sample in self._rig.tracker.arrived():
                if self._check is None or self._check.accepts(sample, swung_rad):
                    self._newest = sample
                    self._last_seen_us = max(self._last_seen_us, sample.exposed_us)
                    self.untaken.append(sample)
        newest = self._newest
        return None if newest is None or now_us - newest.exposed_us > self._stale_us else newest

    def _swung_rad(self) -> Array:
        """How far setpoints went to and fro in the last steps, (n,)."""
        newest_us, _ = self.setpoints[-1]
        recent = [q_rad for at_us, q_rad in self.setpoints if newest_us - at_us < _FOLLOWS_US]
        changes_rad = np.diff(recent, axis=0)
        swung_rad: Array = np.abs(changes_rad).sum(axis=0) - np.abs(changes_rad.sum(axis=0))
        return swung_rad

    def look(self, now_us: int) -> tuple[Sample | None, bool]:
        """Newest measurement or None, and whether the pose must be held.

        Raises:
            TrackerError: the markers were lost for too long.
        """
        sample = self.fresh_sample(now_us)
        if sample is not None:
            return sample, False
        lost_us = now_us - self._last_seen_us
        if lost_us > self._coast_us + self._hold_us:
            raise self._lost(lost_us)
        return None, lost_us > self._coast_us

    def _lost(self, lost_us: int) -> TrackerError:
        trouble = self._rig.tracker.trouble()
        return TrackerError(
            f"no markers from {self._rig.tracker.name} for {lost_us / 1e6:.1f} s that were "
            f"younger than {self._stale_us // 1000} ms" + (f": {trouble}" if trouble else ""),
            "check line of sight and the camera's volume; "
            "for a slow tracker raise control.stale_after_ms",
        )
