"""A Polaris as a raw tracker: keeps a session alive and turns its replies into frames."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from ccr_host.core.clock import NEVER_US, ForeseesArrivals
from ccr_host.core.errors import TrackerError
from ccr_host.tracking.sources.ndi.port import Port, PortOpener
from ccr_host.tracking.sources.ndi.replies import (
    VICRA,
    MeasurementVolume,
    SystemStatus,
    TxReply,
    system_warnings,
)
from ccr_host.tracking.sources.ndi.script import Conversation, Reply
from ccr_host.tracking.sources.ndi.session import SessionLog, Tool, farewell, session
from ccr_host.tracking.sources.reopened import ReopenedCamera
from ccr_host.tracking.tracker import (
    ClockFit,
    ForeignPeerError,
    FrameCount,
    MarkerFrame,
    Pose,
    TrackerHealth,
)

COUNTER_HZ = 60
"""Rate of every Polaris' frame counter, independent of its rate of new data."""


def _counted_us(frame_number: int) -> int:
    return round(frame_number * 1_000_000 / COUNTER_HZ)


POLL_AGAIN_US = 2_000
"""Pause after a poll that found nothing new."""
_AIM_US = 1_000
"""Delay after the time at which a frame is known to be available: one slice of the clock."""
_PROBE_AIM_US = -1_500
_FRAMES_BETWEEN_PROBES = 16
"""Every 16th poll is a probe: its frame is 12 ms older, but it tracks the drift of the quartzes."""
_POLLS_KEPT = 8


class PollPace:
    """Learns the rate of new frames from their numbers, and their phase by probing."""

    def __init__(self) -> None:
        self._steps: deque[int] = deque(maxlen=_POLLS_KEPT)
        self._responses_us: deque[int] = deque(maxlen=_POLLS_KEPT)
        self._asked_us: int | None = None
        self._probing = True
        self._since_probe = 0

    @property
    def frame_step(self) -> int | None:
        """Counts from one frame to the next; None before the second frame."""
        return min(self._steps, default=None)

    def after_step(self, counts: int) -> None:
        """Note the number of counts from the last frame to a new one."""
        self._steps.append(counts)

    def pause_after_nothing_us(self, now_us: int) -> int:
        """Pause until the next poll after one that found nothing new."""
        if self._steps:
            self._probing = False
        return self._pause(now_us, POLL_AGAIN_US)

    def pause_after_frame_us(self, now_us: int, seen_us: int, next_available_us: int) -> int:
        """Pause until the next poll after one that found a frame.

        A probe that succeeds is followed by another one. The reply had arrived at ``now_us``, and
        the camera selected the frame for it at ``seen_us``; the next one will be available at
        ``next_available_us`` at the latest.
        """
        if self._asked_us is not None:
            self._responses_us.append(max(0, seen_us - self._asked_us))
        self._since_probe += 1
        if self._since_probe >= _FRAMES_BETWEEN_PROBES:
            self._probing = True
        aim_us = _PROBE_AIM_US if self._probing else _AIM_US
        if self._probing:
            self._since_probe = 0
        due_us = next_available_us + aim_us - min(self._responses_us, default=0)
        return self._pause(now_us, max(due_us - now_us, POLL_AGAIN_US))

    def _pause(self, now_us: int, pause_us: int) -> int:
        self._asked_us = now_us + pause_us
        return pause_us


DEFAULT_LATENCY_US = 40_000
"""Time from an exposure to its data being available: the least of the estimated 40 to 100 ms."""

_RESYNCHRONISE_US = 1_000_000
_NOTHING_NEW_US = 3_000_000
"""Time of good replies without a new frame, after which the camera is started again."""
_COUNTER_SLACK = 2 * COUNTER_HZ
"""Counts by which a frame number may be ahead of the elapsed time."""
_BITS_PER_BYTE = 10


@dataclass(frozen=True)
class NdiSettings:
    """Settings that a lab can choose."""

    tools: Sequence[Tool] = ()
    """Rigid bodies; without any, a dummy tool lights the illuminators for single spheres."""
    latency_us: int = DEFAULT_LATENCY_US
    """Time from an exposure to its data being available in the device."""
    volume: MeasurementVolume = VICRA
    """The measurement volume; points outside are marked."""


class NdiTracker(ReopenedCamera[Port]):
    """Driver of one camera.

    A camera that falls silent, is reset or unplugged is restarted each time; `health` reports it.
    """

    def __init__(
        self, name: str, open_port: PortOpener, settings: NdiSettings | None = None
    ) -> None:
        super().__init__(name, open_port)
        self._settings = settings or NdiSettings()
        self._arrivals: ForeseesArrivals | None = None
        self._conversation: Conversation | None = None
        self._log = SessionLog()
        self._maker = _FrameMaker(self._settings, self._frames)
        self._damaged_before = 0

    @property
    def health(self) -> TrackerHealth:
        maker, log = self._maker, self._log
        return TrackerHealth(
            state=log.doing,
            tracking=log.tracking,
            rate_hz=self._frames.rate_hz if log.tracking else 0.0,
            frames=self._frames.count,
            lost_frames=maker.lost,
            damaged_replies=self._damaged_before + log.damaged_replies,
            reconnections=self._reconnections,
            odd_frame_numbers=maker.odd_numbers,
            warnings=tuple(self._warnings()),
            last_error=self._last_error,
        )

    def _warnings(self) -> Iterator[str]:
        yield from self._log.warnings
        yield from system_warnings(self._maker.system_status)
        if count := self._maker.odd_numbers:
            yield f"the camera's frame counter has jumped, {count} times so far; tracking goes on"

    def _open(self, time_us: int) -> Port:
        """Open the port; the session begins when the clock advances."""
        port = super()._open(time_us)
        # Found out here: a look takes longer than all else in a turn.
        self._arrivals = port if isinstance(port, ForeseesArrivals) else None
        self._damaged_before += self._log.damaged_replies
        self._log = log = SessionLog()
        self._maker.begin_session(log, has_baud=port.has_baud)
        tools, take = self._settings.tools, self._maker.take
        self._conversation = Conversation(port, lambda line: session(line, tools, log, take))
        return port

    def _process(self, connection: Port, time_us: int) -> None:
        assert self._conversation is not None
        try:
            self._conversation.advance_to(time_us)
        except ForeignPeerError as error:
            if connection.has_baud or self._frames.count:  # perhaps it only has another rate
                raise TrackerError(error.cause, error.cure) from None
            raise ForeignPeerError(f"{self.name}: {error.cause}", error.cure) from None

    @property
    def next_turn_us(self) -> int:
        """Time of the next arrival or deadline; 0, which is past, on a port that cannot tell."""
        if not self._running:
            return NEVER_US
        if self._conversation is None:
            return self._retry_us
        if self._arrivals is None:
            return 0
        return min(self._conversation.next_turn_us, self._arrivals.next_arrival_us)

    def stop(self) -> None:
        """End tracking and close the port."""
        if self._connection is not None:
            try:
                self._connection.write(farewell())
            except TrackerError as error:
                self._last_error = str(error)
        super().stop()
        self._log = SessionLog("stopped")

    def _let_go(self) -> None:
        self._log.doing = "trying again"
        self._log.tracking = False
        self._conversation = None
        super()._let_go()  # a cable that was pulled comes back as another device


class _FrameMaker:
    """Converts TX replies to frames: no repeats, exposure times, volume check, pace of polls."""

    def __init__(self, settings: NdiSettings, made: FrameCount) -> None:
        self._settings = settings
        self._made = made
        self.lost = 0
        self.odd_numbers = 0
        self.system_status = SystemStatus(0)

    def begin_session(self, log: SessionLog, *, has_baud: bool) -> None:
        """Restart, as the device counts from 0 again."""
        self._log = log
        self._has_baud = has_baud
        self._clock = ClockFit()
        self._last_number: int | None = None
        self._last_us = 0
        self._news_us: int | None = None
        """When the last new frame arrived, or the first reply."""
        self._odd: tuple[int, int] | None = None
        """First of the numbers that do not follow the last one, and its time of arrival."""
        self._pace = PollPace()

    def take(self, reply: TxReply, source: Reply) -> int:
        """Make a frame if the reply has a new one; return the pause until the next poll, us.

        Number 0 is not a frame: TSTART has just set the counter, without an exposure.
        """
        self.system_status = reply.system_status
        number = reply.frame
        if not number or not self._is_next(number, source.arrived_us):
            self._require_news(reply, source.arrived_us)
            return self._pace.pause_after_nothing_us(source.arrived_us)
        seen_us = source.arrived_us - self._wire_us(source.length)
        self._clock.see(_counted_us(number), seen_us)
        available_us = self._clock.host_us(_counted_us(number))
        exposed_us = available_us - self._settings.latency_us
        self._made.add(
            MarkerFrame(
                exposed_us=self._made.not_before_last(exposed_us),
                frame_number=number,
                points_mm=reply.strays_mm,
                out_of_volume=~self._settings.volume.contains(reply.strays_mm),
                tools=self._tools(reply),
            )
        )
        self._count(number)
        self._last_us = self._news_us = source.arrived_us
        step = self._pace.frame_step
        if step is None:
            return POLL_AGAIN_US
        next_us = self._clock.host_us(_counted_us(number + step))
        return self._pace.pause_after_frame_us(source.arrived_us, seen_us, next_us)

    def _require_news(self, reply: TxReply, now_us: int) -> None:
        """Raise a TrackerError if the camera has answered for seconds without a new frame."""
        if self._news_us is None:
            self._news_us = now_us
        if now_us - self._news_us > _NOTHING_NEW_US:
            has_number = reply.frame is not None
            why = "their numbers do not count up" if has_number else "it has forgotten its tools"
            raise TrackerError(
                f"the camera answers, but shows no new frames for {_NOTHING_NEW_US / 1e6:g} s: "
                f"{why}",
                "it is started again; if that happens often, power it off and on",
            )

    def _is_next(self, number: int, now_us: int) -> bool:
        """Whether a number is that of a new frame.

        A number that is inconsistent with the last one and the elapsed time is rejected: it may be
        damage that no check sum shows, and all following frames would seem old. Once such numbers
        have counted up for a second, the counter has changed, and they are accepted.
        """
        if self._last_number is None:
            return True
        ahead = number - self._last_number
        if ahead == 0:
            return False
        passed = (now_us - self._last_us) * COUNTER_HZ // 1_000_000
        if 0 < ahead <= 2 * passed + _COUNTER_SLACK:
            self._odd = None
            return True
        if self._odd is None or number < self._odd[0]:
            self.odd_numbers += 1
            self._odd = number, now_us
        first, since_us = self._odd
        if number == first or now_us - since_us < _RESYNCHRONISE_US:
            return False
        self.begin_session(self._log, has_baud=self._has_baud)
        return True

    def _tools(self, reply: TxReply) -> dict[str, Pose]:
        names = self._log.handles or {}
        return {
            names[tool.handle]: tool.pose
            for tool in reply.tools
            if tool.pose is not None and names.get(tool.handle)
        }

    def _count(self, number: int) -> None:
        if self._last_number is not None:
            counts = number - self._last_number
            self._pace.after_step(counts)
            self.lost += counts // (self._pace.frame_step or counts) - 1
        self._last_number = number

    def _wire_us(self, length: int) -> int:
        return length * _BITS_PER_BYTE * 1_000_000 // self._log.baud if self._has_baud else 0
