"""``ccr-host monitor``: live data of tracker and board, without moving the robot."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from ccr_host.core.arrays import Array
from ccr_host.core.clock import Clock, RealClock, cpu_ns, wall_ns
from ccr_host.description.schema import Description
from ccr_host.link.client import Client
from ccr_host.link.transport import parse_device_uri
from ccr_host.run.open_rig import believed_rad, connect_board, session_number
from ccr_host.run.tracker_rig import TrackerRig
from ccr_host.tracking.markers.check import MarkerCheck
from ccr_host.tracking.tracker import Sample, TrackerHealth, WatchedTracker
from ccr_host.tracking.uri import parse_tracker_uri

_RATE_WINDOW_US = 2_000_000


@dataclass(frozen=True)
class LinkView:
    """State of the board and the link."""

    device: str
    state: str
    fault: str
    supply_v: float | None
    """Servo supply voltage; None if it is not measured."""
    report_age_ms: float | None
    crc_errors: int
    retries: int


@dataclass(frozen=True, eq=False)
class MonitorView:
    """Snapshot of tracker, board and this program."""

    tracker: str
    seconds: float
    """Time since the monitor was opened."""
    registered: bool
    """Whether positions are in the robot frame; otherwise they are in the camera frame."""
    health: TrackerHealth
    trouble: str
    sample: Sample | None
    age_ms: float | None
    """Age of the newest sample."""
    arrival_age_ms: float | None
    """Median time from exposure to arrival over the last two seconds."""
    rate_hz: float
    """Sample rate over the last two seconds."""
    samples: int
    cpu_share: float
    """CPU load of this program, as a fraction of one core."""
    link: LinkView | None

    @property
    def frames_without_tip(self) -> int:
        """Number of frames so far in which M1 or M3 was not identified with certainty."""
        return max(0, self.health.frames - self.samples)

    def summary(self) -> dict[str, Any]:
        markers = None if self.sample is None else _listed(self.sample.markers_mm)
        return {
            "tracker": self.tracker,
            "seconds": round(self.seconds, 3),
            "frame": "robot" if self.registered else "camera",
            "markers_mm": markers,
            "tip_mm": None if self.sample is None else self.sample.tip_mm.tolist(),
            "age_ms": self.age_ms,
            "arrival_age_ms": self.arrival_age_ms,
            "rate_hz": self.rate_hz,
            "samples": self.samples,
            "frames_without_tip": self.frames_without_tip,
            "trouble": self.trouble,
            "health": asdict(self.health),
            "cpu_share": round(self.cpu_share, 4),
            "link": None if self.link is None else asdict(self.link),
        }


class Monitor:
    """Counts samples as they arrive; attach it to the clock.

    ``board`` is its URI and a connected client, if there is one; ``check`` is for a robot near its
    rest pose.
    """

    def __init__(
        self,
        clock: Clock,
        tracker: WatchedTracker,
        board: tuple[str, Client] | None,
        check: MarkerCheck,
        *,
        registered: bool,
    ) -> None:
        self._check = check
        self._clock = clock
        self._tracker = tracker
        self._board = board
        self._registered = registered
        self._opened_us = clock.now_us()
        self._wall_ns, self._cpu_ns = wall_ns(), cpu_ns()
        self._samples = 0
        self._last: Sample | None = None
        self._arrivals: deque[tuple[int, int]] = deque()

    def advance_to(self, time_us: int) -> None:
        sample = self._tracker.newest()
        while self._arrivals and self._arrivals[0][0] <= time_us - _RATE_WINDOW_US:
            self._arrivals.popleft()
        if sample is None or (self._last and sample.exposed_us == self._last.exposed_us):
            return
        self._last = sample
        self._samples += 1
        self._arrivals.append((time_us, time_us - sample.exposed_us))

    def watch(self, duration_us: int) -> MonitorView:
        """Wait for ``duration_us``, then return a snapshot."""
        self._clock.sleep_until_us(self._clock.now_us() + duration_us)
        now_us = self._clock.now_us()
        ages_ms = [age_us / 1000 for _, age_us in self._arrivals]
        window_us = min(_RATE_WINDOW_US, max(1, now_us - self._opened_us))
        return MonitorView(
            tracker=self._tracker.name,
            seconds=(now_us - self._opened_us) * 1e-6,
            registered=self._registered,
            health=self._tracker.health,
            trouble=self._trouble(),
            sample=self._last,
            age_ms=None if self._last is None else (now_us - self._last.exposed_us) / 1000,
            arrival_age_ms=float(np.median(ages_ms)) if ages_ms else None,
            rate_hz=len(self._arrivals) * 1e6 / window_us,
            samples=self._samples,
            cpu_share=(cpu_ns() - self._cpu_ns) / max(1, wall_ns() - self._wall_ns),
            link=None if self._board is None else _link_view(*self._board),
        )

    def _trouble(self) -> str:
        trouble = self._tracker.trouble()
        wrong = None if self._last is None else self._check.trouble(self._last.markers_mm)
        return trouble if wrong is None else "; ".join(text for text in (trouble, *wrong) if text)


def _link_view(device: str, client: Client) -> LinkView:
    newest, statistics, age_us = client.telemetry, client.statistics, client.telemetry_age_us()
    return LinkView(
        device=device,
        state="no report yet" if newest is None else newest.report.state.name.lower(),
        fault="none" if newest is None else newest.report.fault.name.lower(),
        supply_v=newest.report.supply_dv / 10 if newest and newest.report.supply_dv else None,
        report_age_ms=None if age_us is None else age_us / 1000,
        crc_errors=statistics.crc_errors,
        retries=statistics.retries,
    )


@contextmanager
def open_monitor(
    tracker_text: str, device_text: str | None, description: Description, seed: int
) -> Iterator[Monitor]:
    """Start the tracker, and connect to the board if given; the board is not armed or configured.

    Raises:
        ConfigError: unknown URI, or the description lacks keys that the tracker needs.
        DeviceError: no board, or not one with our firmware.
        TrackerError: the camera cannot be opened.
    """
    session_seed, camera_seed = np.random.SeedSequence(seed).spawn(2)
    eyes = TrackerRig(parse_tracker_uri(tracker_text), description, camera_seed)
    device = None if device_text is None else parse_device_uri(device_text)
    clock = RealClock()
    registered, motors = description.registration is not None, description.robot.motors
    with ExitStack() as stack:
        client: Client | None = None
        if device is not None:
            transport = connect_board(device, eyes.scene, clock, description, stack)
        elif eyes.scene is not None:
            clock.attach(eyes.scene)
        stack.enter_context(eyes.running(clock))
        if device is not None:
            session = session_number(device, session_seed)
            client = stack.enter_context(Client(transport, clock, session, motors=motors))
            clock.attach(client)
            client.connect()
        tracker = eyes.tracker(
            clock,
            lambda: np.zeros(motors) if client is None else believed_rad(client, motors),
            in_camera_frame=not registered,
        )
        board = None if client is None else (str(device), client)
        check = MarkerCheck(description, in_robot_frame=registered)
        monitor = Monitor(clock, tracker, board, check, registered=registered)
        clock.attach(monitor)
        yield monitor


def _listed(markers_mm: Array) -> list[list[float] | None]:
    """Positions as a list, with None for lost markers."""
    return [None if np.isnan(row).any() else row.tolist() for row in markers_mm]
