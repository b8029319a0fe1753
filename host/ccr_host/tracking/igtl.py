"""Tracker `igtl://HOST:PORT`: OpenIGTLink servers such as PLUS and 3D Slicer, through pyigtl.

TRANSFORM messages become tools, POINT messages become single markers; both are in mm. pyigtl
receives in a thread of its own, which this module only looks at.

pyigtl 0.3 does not notice a server that goes away: `is_connected` stays true, a stale message comes
out as a new one, and it never connects again. So only time stamps count, and a client that brings
none is replaced.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Any, Protocol

import numpy as np

from ccr_host.tracking.clock_fit import ClockFit
from ccr_host.tracking.frame import FloatArray, MarkerFrame, Pose, StartsAndStops, TrackerHealth
from ccr_host.tracking.frame_count import FrameCount
from ccr_host.tracking.optional import import_optional
from ccr_host.tracking.quaternion import quaternion
from ccr_host.tracking.rotation import rotation_vector

DEFAULT_LATENCY_US = 60_000
"""Exposure to time stamp plus the fastest way here; our estimate, PLUS adds its own buffers."""
_Message = Any
"""Of pyigtl, which has no types."""

_SILENCE_US = 2_000_000
_RETRY_US = 1_000_000


class IgtlClient(Protocol):
    """The part of pyigtl's client that is used."""

    communication_thread_stop_requested: bool

    def get_latest_messages(self) -> Sequence[Any]:
        """Newest message of each device since the last call."""


ClientMaker = Callable[[], IgtlClient]


class IgtlTracker(StartsAndStops):
    """Markers from an OpenIGTLink server.

    A device name such as `M1ToTracker` gives the tool `M1`. Messages with one time stamp make up a
    frame, which is complete when a later one arrives or all expected tools are there.

    Args:
        host: of the server.
        port: of the server.
        expected_tools: a frame with all of them waits for nothing else.
        latency_us: from an exposure to the earliest arrival of its message.
        make_client: for tests.

    Raises:
        ConfigError: pyigtl is not installed.
    """

    def __init__(
        self,
        host: str,
        port: int,
        *,
        expected_tools: Sequence[str] = ("M1", "M2", "M3"),
        latency_us: int = DEFAULT_LATENCY_US,
        make_client: ClientMaker | None = None,
    ) -> None:
        self.name = f"igtl://{host}:{port}"
        self._make_client = make_client or _pyigtl_client(host, port)
        self._expected = frozenset(expected_tools)
        self._latency_us = latency_us
        self._client: IgtlClient | None = None
        self._frames = FrameCount()
        self._clients_made = 0
        self._running = False
        self._last_error = ""
        self._begin()

    def _begin(self) -> None:
        """Forget what belongs to one connection."""
        self._fit = ClockFit()
        self._silent_since_us: int | None = None
        self._tracking = False
        self._unstamped = False
        self._open_stamp_s = -math.inf
        self._published_stamp_s = -math.inf
        self._tools: dict[str, Pose] = {}
        self._points: list[FloatArray] = []
        self._arrived_us = 0

    @property
    def health(self) -> TrackerHealth:
        """How it is doing now."""
        if not self._running:
            state = "stopped"
        else:
            state = "tracking" if self._tracking else "waiting for messages"
        return TrackerHealth(
            state=state,
            tracking=self._tracking,
            rate_hz=self._frames.rate_hz if self._tracking else 0.0,
            frames=self._frames.count,
            reconnections=max(0, self._clients_made - 1),
            warnings=(_NO_STAMPS,) if self._unstamped else (),
            last_error=self._last_error,
        )

    def start(self) -> None:
        self._running = True

    def advance_to(self, time_us: int) -> None:
        """Take what has arrived; replace a client that has fallen silent."""
        if not self._running:
            return
        if self._client is None:
            self._client = self._make_client()
            self._clients_made += 1
            self._begin()
            self._silent_since_us = time_us
        messages = sorted(self._client.get_latest_messages(), key=lambda m: float(m.timestamp))
        for message in messages:
            self._take(message, time_us)
        self._watch(time_us)

    def newest_frame(self) -> MarkerFrame | None:
        """Newest frame, whatever its age; None before the first."""
        return self._frames.newest

    def stop(self) -> None:
        self._running = self._tracking = False
        self._let_go()

    def _take(self, message: _Message, time_us: int) -> None:
        stamp_s = float(message.timestamp)
        if not math.isfinite(stamp_s) or stamp_s <= 0:
            self._unstamped = True
            return
        if stamp_s <= self._published_stamp_s or stamp_s < self._open_stamp_s:
            return
        if stamp_s > self._open_stamp_s:
            self._publish()
            self._open_stamp_s = stamp_s
            self._arrived_us = time_us
        self._silent_since_us = time_us
        self._add(message)
        if self._expected and self._expected <= self._tools.keys():
            self._publish()

    def _add(self, message: _Message) -> None:
        if message.message_type == "TRANSFORM":
            matrix = np.asarray(message.matrix, dtype=np.float64)
            if matrix.shape == (4, 4) and np.isfinite(matrix).all():
                name = str(message.device_name).partition("To")[0]
                self._tools[name] = Pose(
                    matrix[:3, 3].copy(), quaternion(rotation_vector(matrix[:3, :3]))
                )
        elif message.message_type == "POINT":
            points_mm = np.asarray(message.positions, dtype=np.float64).reshape(-1, 3)
            if np.isfinite(points_mm).all():
                self._points.append(points_mm)

    def _publish(self) -> None:
        if not (self._tools or self._points):
            return
        stamp_us = round(self._open_stamp_s * 1e6)
        self._fit.see(stamp_us, self._arrived_us)
        points_mm = np.vstack(self._points) if self._points else None
        exposed_us = self._fit.host_us(stamp_us) - self._latency_us
        self._frames.add_poses(exposed_us, self._tools, points_mm)
        self._published_stamp_s = self._open_stamp_s
        self._tracking = True
        self._tools, self._points = {}, []

    def _watch(self, time_us: int) -> None:
        limit_us = _SILENCE_US if self._tracking else _SILENCE_US + _RETRY_US
        if self._silent_since_us is not None and time_us - self._silent_since_us > limit_us:
            self._last_error = (
                f"{self.name}: no new message for {limit_us / 1e6:g} s "
                "(start the server and let it send TRANSFORM or POINT messages)"
            )
            self._tracking = False
            self._let_go()

    def _let_go(self) -> None:
        if self._client is not None:
            # Not stop(), which waits for the thread.
            self._client.communication_thread_stop_requested = True
            self._client = None


_NO_STAMPS = "messages without time stamp are ignored; switch time stamps on in the server"


def _pyigtl_client(host: str, port: int) -> ClientMaker:
    pyigtl = import_optional("pyigtl", "igtl", "tracker igtl://")

    def make() -> IgtlClient:
        client: IgtlClient = pyigtl.OpenIGTLinkClient(host=host, port=port)
        return client

    return make
