"""The targets that a host has sent to a board, and what has become of them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ccr_host.core.arrays import Array
from ccr_host.core.errors import DeviceError
from ccr_host.core.wire import cdeg_to_rad, rad_to_cdeg
from ccr_host.link import messages as m
from ccr_host.link.board_config import BoardConfig
from ccr_host.link.device_errors import BoardFaultError, BoardStoppedError, LinkLossError
from ccr_host.link.messages import State

Angles = Sequence[float] | Array
"""One for each motor, rad."""

_LED_TO_REST_US = 5_000_000
"""A gap in the targets is the cause if the board leads the robot to rest within this time."""


class TargetLog:
    """Tracks the targets of a board: their answers, and until when they feed its link watchdog.

    They are never repeated, so some remain unanswered. They are kept by sequence number, so their
    number is bounded: it wraps after 256.
    """

    def __init__(self) -> None:
        self.fed_us = self.fed_until_us = 0
        """When the last target was sent, and when its validity ends."""
        self._gap_us, self._gap_end_us = 0, -_LED_TO_REST_US
        self.accepted_rad: Array | None = None
        """Newest target as the board has accepted it, shape (axes,)."""
        self._open_since_us: dict[int, int] = {}
        self._given_up = 0
        self.refusal: m.Nack | None = None
        """The newest refusal that has not been handled."""

    @property
    def awaits_answer(self) -> bool:
        return bool(self._open_since_us)

    def answered(self, sequence: int, reply: m.TargetReply) -> int | None:
        """Note an answer; returns the time at which its target was sent, None if unknown."""
        sent_us = self._open_since_us.pop(sequence, None)
        if sent_us is not None:
            self.accepted_rad = cdeg_to_rad(reply.target_cdeg)
        return sent_us

    def refused(self, sequence: int, refusal: m.Nack) -> None:
        """Keep a refusal until it is handled."""
        self._open_since_us.pop(sequence, None)
        self.refusal = refusal

    def unanswered(self, sent_before_us: int) -> int:
        """Number of unanswered targets that were sent before a time."""
        overdue = sum(sent_us < sent_before_us for sent_us in self._open_since_us.values())
        return self._given_up + overdue

    def feed(self, now_us: int, until_us: int, unanswered: int | None = None) -> None:
        """Note that the board follows a target until a time, and whether that came too late.

        ``unanswered`` is its sequence number if its answer is still to come.
        """
        if unanswered is not None:
            self._given_up += unanswered in self._open_since_us
            self._open_since_us[unanswered] = now_us
        if now_us > self.fed_until_us:
            self._gap_us, self._gap_end_us = now_us - self.fed_us, now_us
        self.fed_us, self.fed_until_us = now_us, until_us

    def loss(self, report: m.StateReport, now_us: int) -> DeviceError:
        """The error to raise for a board that no longer follows its targets."""
        latched = report.state is State.FAULT and report.fault is m.Fault.LINK_LOSS
        if not latched and report.state is not State.RELAXING:
            return latched_error(report)
        stalled, unfed_us = now_us > self.fed_until_us, now_us - self.fed_us
        if not stalled and now_us - self._gap_end_us < _LED_TO_REST_US:
            stalled, unfed_us = True, self._gap_us  # This target came too late.
        return LinkLossError(unfed_us, host_stalled=stalled, latched=latched)


def latched_error(report: m.StateReport) -> DeviceError:
    """The error of a board in a fault, or stopped."""
    return BoardStoppedError() if report.state is State.STOPPED else BoardFaultError(report.fault)


def on_wire(
    session: int, q_rad: Angles, ramp_ms: int, validity_ms: int, config: BoardConfig | None
) -> m.SetTarget:
    """A target for all axes of a board; those without a motor stay at their rest.

    Raises:
        ValueError: ramp or validity is out of range.
    """
    target_cdeg = rad_to_cdeg(np.minimum(np.maximum(q_rad, -np.pi), np.pi))
    unused_cdeg = config.limits.rest_cdeg[len(target_cdeg) :] if config else ()
    target = m.SetTarget(session, (*target_cdeg, *unused_cdeg), ramp_ms, validity_ms)
    if target.first_out_of_range() is not None:
        times = f"ramp of {ramp_ms} ms or validity of {validity_ms} ms"
        raise ValueError(f"{times} out of range")
    return target
