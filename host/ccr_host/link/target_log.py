"""What became of the targets that were sent: they are never repeated, so some stay unanswered."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ccr_host.core.units import cdeg_to_rad
from ccr_host.link.messages import Nack, TargetReply


class TargetLog:
    """Targets by sequence number; bounded, as those wrap after 256."""

    def __init__(self) -> None:
        self.accepted_rad: NDArray[np.float64] | None = None
        """Newest target as the board has accepted it, shape (2,)."""
        self._open_since_us: dict[int, int] = {}
        self._given_up = 0
        self._refusal: Nack | None = None

    def sent(self, sequence: int, time_us: int) -> None:
        """Wait for an answer to a new target."""
        self._given_up += sequence in self._open_since_us
        self._open_since_us[sequence] = time_us

    @property
    def awaits_answer(self) -> bool:
        """Whether a target is unanswered."""
        return bool(self._open_since_us)

    def answered(self, sequence: int, reply: TargetReply) -> int | None:
        """Take an answer; gives the time at which its target was sent."""
        sent_us = self._open_since_us.pop(sequence, None)
        if sent_us is not None:
            self.accepted_rad = cdeg_to_rad(reply.target_cdeg)
        return sent_us

    def refused(self, sequence: int, refusal: Nack) -> None:
        """Keep a refusal until somebody asks for it."""
        self._open_since_us.pop(sequence, None)
        self._refusal = refusal

    def take_refusal(self) -> Nack | None:
        """Give a refusal away, if there was one."""
        refusal, self._refusal = self._refusal, None
        return refusal

    def unanswered(self, sent_before_us: int) -> int:
        """How many targets sent before a time have got no answer."""
        overdue = sum(sent_us < sent_before_us for sent_us in self._open_since_us.values())
        return self._given_up + overdue
