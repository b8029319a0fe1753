"""Tracker `igtl://HOST:PORT`: OpenIGTLink servers such as PLUS and 3D Slicer.

TRANSFORM messages become tools, POINT messages become single markers; both are in mm.

A server that hangs may repeat old messages. So only messages with a new time stamp count, and
stamps are remembered across connections.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from typing import Protocol

import numpy as np
import scipy

from ccr_host.core.addresses import joined
from ccr_host.core.arrays import Array
from ccr_host.core.errors import TrackerError
from ccr_host.tracking.sources.igtl_stream import POSE_TYPES, Message, igtl_opener
from ccr_host.tracking.sources.reopened import Connection, ReopenedCamera
from ccr_host.tracking.tracker import ClockFit, Pose, TrackerHealth

DEFAULT_LATENCY_US = 60_000
"""Time from exposure to stamp plus the fastest transmission, an estimate; PLUS adds buffers."""
SAME_EXPOSURE_S = 10e-3
"""Largest difference of the stamps in a frame: many servers stamp each transform when they send it,
a few milliseconds apart."""

_MOST_AHEAD_S = 0.3
"""Time by which a message may be faster than the fastest one so far: a step of the clock."""
_CLOCK_SET_S, _CLOCK_RATE = 0.3, 0.3
"""Stamps of another time that have gone on for this long, at the pace of the host's clock but for
this share, are those of a clock that was set."""
_ROTATION_TOLERANCE = 0.01
_STATUS_KEYS = "transformstatus", "toolstatus", "status"
_VALID_KEYS = "transformvalid", "toolvalid", "valid"
_FINE, _TRUE = ("OK", "TOOL_OK"), ("TRUE", "1")
_SILENCE_US = 2_000_000
_STAMPS_REMEMBERED = 4096
_SENDS_NOTHING = "check address and port (18944 is usual), and that the server has markers to send"
_HANGS = "see what the server sends, and whether it hangs"
_NO_STAMPS = "messages without time stamp are ignored; switch time stamps on in the server"


class Stream(Connection, Protocol):
    """A connection to a server; see `IgtlStream`."""

    is_silent: bool
    skipped_types: set[str]
    damaged: int

    def messages(self) -> list[Message]:
        """Poses and points that have arrived since the last call."""


class IgtlTracker(ReopenedCamera[Stream]):
    """Markers from an OpenIGTLink server.

    A device name such as `M1ToTracker` gives the tool `M1`. Messages whose stamps differ by no more
    than `SAME_EXPOSURE_S` make up a frame, which is complete when a later one arrives or all
    expected tools are known. A transform whose metadata say anything but OK (PLUS sends
    `TransformStatus` and `TransformValid`) gives no pose. Only ``expected_tools`` are used.
    ``latency_us`` is the time from an exposure to the earliest arrival of its message;
    ``open_stream`` is replaced in tests.

    Raises:
        ConfigError: pyigtl is not installed.
    """

    def __init__(
        self,
        host: str,
        port: int,
        *,
        expected_tools: Sequence[str],
        latency_us: int = DEFAULT_LATENCY_US,
        open_stream: Callable[[], Stream] | None = None,
    ) -> None:
        super().__init__(f"igtl://{joined(host, port)}", open_stream or igtl_opener(host, port))
        self._expected = tuple(expected_tools)
        self._latency_us = latency_us
        self._heard_us = 0
        self._tracking = False
        self._damaged = 0
        self._unstamped = False
        self._tool_names: set[str] = set()
        self._skipped_types: set[str] = set()
        self._statuses: dict[str, str] = {}
        self._stamps = _Stamps()
        self._fit = ClockFit()
        self._clear_frame()

    def _clear_frame(self) -> None:
        self._told: set[str] = set()
        self._tools: dict[str, Pose] = {}
        self._points: list[Array] = []
        self._stamp_s = math.nan
        self._arrived_us = 0

    @property
    def health(self) -> TrackerHealth:
        if not self._running:
            state = "stopped"
        else:
            state = "tracking" if self._tracking else "waiting for messages"
        damaged = 0 if self._connection is None else self._connection.damaged
        return TrackerHealth(
            state=state,
            tracking=self._tracking,
            rate_hz=self._frames.rate_hz if self._tracking else 0.0,
            frames=self._frames.count,
            damaged_replies=self._damaged + damaged,
            reconnections=self._reconnections,
            warnings=tuple(self._warnings()),
            last_error=self._last_error,
        )

    def _process(self, connection: Stream, time_us: int) -> None:
        messages = connection.messages()
        self._skipped_types |= connection.skipped_types
        for message in sorted(messages, key=lambda one: float(one.timestamp)):
            self._take(message, time_us)
        self._require_news(connection, time_us)

    def _open(self, time_us: int) -> Stream:
        stream = super()._open(time_us)
        self._heard_us = time_us
        self._stamps.begin_connection()
        return stream

    def _let_go(self) -> None:
        self._tracking = False
        self._clear_frame()
        if self._connection is not None:
            self._damaged += self._connection.damaged
        super()._let_go()

    def _require_news(self, stream: Stream, time_us: int) -> None:
        if time_us - self._heard_us <= _SILENCE_US:
            return
        cause, cure = (
            ("something listens there, but sends nothing", _SENDS_NOTHING)
            if stream.is_silent
            else (f"connected, but no new message of {' or '.join(self._expected)}", _HANGS)
        )
        raise TrackerError(f"{self.name}: {cause} for {_SILENCE_US / 1e6:g} s", cure)

    def _take(self, message: Message, time_us: int) -> None:
        device, stamp_s = str(message.device_name).strip(), float(message.timestamp)
        is_tool = message.message_type == "TRANSFORM"
        name = device.partition("To")[0] if is_tool else device
        if is_tool:
            self._tool_names.add(name)
            if name not in self._expected:
                return
        if not math.isfinite(stamp_s) or stamp_s <= 0:
            self._unstamped = True
            return
        if not self._stamps.is_new(device, stamp_s, time_us):
            return
        self._heard_us = time_us
        if self._stamps.has_restarted:
            self._fit = ClockFit()
        if name in self._told or stamp_s - self._stamp_s > SAME_EXPOSURE_S:
            self._publish()
        if not self._told:
            self._stamp_s, self._arrived_us = stamp_s, time_us
        self._told.add(name)
        self._add(message, name)
        if self._expected and self._told.issuperset(self._expected):
            self._publish()

    def _add(self, message: Message, name: str) -> None:
        if message.message_type == "POINT":
            points_mm = np.asarray(message.positions, dtype=np.float64).reshape(-1, 3)
            if np.isfinite(points_mm).all():
                self._points.append(points_mm)
            return
        self._statuses.pop(name, None)
        matrix = np.asarray(message.matrix, dtype=np.float64)
        if (status := _status(message)) is not None:
            self._statuses[name] = status
        elif matrix.shape == (4, 4) and np.isfinite(matrix).all():
            part = matrix[:3, :3]
            if np.abs(part @ part.T - np.eye(3)).max() > _ROTATION_TOLERANCE:
                self._statuses[name] = "no rotation: its matrix is scaled or sheared"
                return
            if np.linalg.det(part) <= 0:
                self._statuses[name] = "no rotation: its matrix is left-handed"
                return
            turn = scipy.spatial.transform.Rotation.from_matrix(part)
            self._tools[name] = Pose.of(matrix[:3, 3].copy(), turn)

    def _publish(self) -> None:
        stamp_us = round(self._stamp_s * 1e6)
        self._fit.see(stamp_us, self._arrived_us)
        points_mm = np.vstack(self._points) if self._points else None
        exposed_us = self._fit.host_us(stamp_us) - self._latency_us
        self._frames.add_poses(exposed_us, self._tools, points_mm)
        self._tracking = True
        self._clear_frame()

    def _warnings(self) -> Iterator[str]:
        if self._unstamped:
            yield _NO_STAMPS
        for name, status in sorted(self._statuses.items()):
            yield f"{name} is {status}"
        strange = self._tool_names.difference(self._expected)
        if strange and not self._tool_names.issuperset(self._expected):
            yield (
                f"the server sends {', '.join(sorted(self._tool_names)) or 'no names'}; "
                f"expected are {', '.join(self._expected)}, as in {self._expected[0]}ToTracker: "
                "rename them in the server"
            )
        if self._skipped_types and not self._frames.count and not self._tool_names:
            yield (
                f"the server sends {', '.join(sorted(self._skipped_types))}; "
                f"let it send {' or '.join(POSE_TYPES)}"
            )


class _Stamps:
    """Distinguishes new messages from repeated and late ones, also across connections."""

    def __init__(self) -> None:
        self._seen: dict[tuple[str, float], None] = {}
        self._newest_s = -math.inf
        self._least_s = math.inf
        """Least time of arrival minus stamp."""
        self._may_restart = False
        self._jumped: tuple[float, float] | None = None
        """Stamp and time of arrival of the first of the messages that have jumped in a row."""
        self.has_restarted = False
        """Whether the newest message showed that the server's clock was reset."""

    def begin_connection(self) -> None:
        """Note a new connection: the server, and so its clock, may be another one."""
        self._may_restart = True

    def is_new(self, device: str, stamp_s: float, time_us: int) -> bool:
        """Whether a message is new, and its stamp plausible.

        A stamp is not older than the newest by more than a frame, nor ahead of its time: one such
        stamp would make all following exposures seem old. Once others follow it at their pace, the
        server's clock has been set.
        """
        key, delay_s = (device, stamp_s), time_us * 1e-6 - stamp_s
        goes_back = stamp_s < self._newest_s - SAME_EXPOSURE_S
        is_ahead = delay_s < self._least_s - _MOST_AHEAD_S and math.isfinite(self._least_s)
        jumps = goes_back or is_ahead
        if key in self._seen:
            return False
        if not jumps:
            self._jumped = None
        elif not self._may_restart and not self._was_set(stamp_s, time_us * 1e-6):
            return False
        self.has_restarted = jumps
        self._may_restart = False
        self._least_s = delay_s if jumps else min(delay_s, self._least_s)
        self._newest_s = stamp_s if jumps else max(stamp_s, self._newest_s)
        self._seen[key] = None
        if len(self._seen) > _STAMPS_REMEMBERED:
            del self._seen[next(iter(self._seen))]
        return True

    def _was_set(self, stamp_s: float, time_s: float) -> bool:
        """Whether the server's clock was set some time ago: messages go on from there."""
        first_stamp_s, first_s = self._jumped = self._jumped or (stamp_s, time_s)
        passed_s, told_s = time_s - first_s, stamp_s - first_stamp_s
        if abs(told_s - passed_s) > _CLOCK_SET_S:
            self._jumped = stamp_s, time_s
        return passed_s >= _CLOCK_SET_S and abs(told_s - passed_s) <= _CLOCK_RATE * passed_s


def _status(message: Message) -> str | None:
    """What a server says of a transform that is not OK; None if it is, or nothing is said.

    Servers write the key of PLUS with or without the transform's name before it.
    """
    device = _letters(str(message.device_name))
    for key, value in message.metadata.items():
        what, told = _letters(key).removeprefix(device), value.strip()
        if what in _STATUS_KEYS and told.upper() not in _FINE:
            return f"{told or 'without a status'}, says the server"
        if what in _VALID_KEYS and told.upper() not in _TRUE:
            return f"not valid, says the server ({key} is {told!r})"
    return None


def _letters(text: str) -> str:
    return "".join(filter(str.isalnum, text)).lower()
