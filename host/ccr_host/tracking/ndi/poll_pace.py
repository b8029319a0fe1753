"""When to ask for the next frame: late enough to find it, early enough not to let it age.

A poll that finds nothing new costs the wire time of a whole reply, 10 ms. So polls are aimed at
when frames have been seen before, and only now and then one comes earlier, to find out whether
frames are available earlier than they have been looked for.
"""

from __future__ import annotations

from collections import deque

POLL_AGAIN_US = 2_000
"""After a poll that found nothing new."""
_AIM_US = 1_000
"""After the earliest time at which a frame is known to be available: one slice of the clock."""
_PROBE_AIM_US = -1_500
_FRAMES_BETWEEN_PROBES = 16
"""Costs a sixteenth of the frames 12 ms of age; follows the drift of two quartzes easily."""
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
        """Counts from one frame to the next; None before there were two."""
        return min(self._steps, default=None)

    def after_step(self, counts: int) -> None:
        """Take note of how many counts a new frame is after the last one."""
        self._steps.append(counts)

    def pause_after_nothing_us(self, now_us: int) -> int:
        """Until the next poll, where the last one found nothing new."""
        if self._steps:
            self._probing = False
        return self._pause(now_us, POLL_AGAIN_US)

    def pause_after_frame_us(self, now_us: int, seen_us: int, next_available_us: int) -> int:
        """Until the next poll, where the last one found a frame.

        A probe that succeeds is followed by another one.

        Args:
            now_us: when the reply had arrived.
            seen_us: when the camera took the frame for it.
            next_available_us: when the next frame will be available at the latest.
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
