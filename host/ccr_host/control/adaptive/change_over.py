"""Decides when a pair of tendons changes over, at which its servo jumps by twice the slack."""

from __future__ import annotations

import math
from collections.abc import Callable

from ccr_host.control.adaptive.static_model import Hold
from ccr_host.control.adaptive.statics import LEAST_CHANGE_OVER

Sides = tuple[float, ...]

_DWELL_S = 2.0
"""Time after a change-over in which the pair changes back only if it clearly has to: the segment
swings for 0.3 s, commands take 0.3 s to follow the estimate, and a load that was freed by mistake
settles within a second."""
_DWELL_CHANGE_OVER = 0.04
"""Moment, in k_1 per radian, by which the other tendon then must have to pull: 2 deg of bending, by
which the segment hangs in the slack if it was right to change back."""


class ChangeOver:
    """Holds poses with the tendon that has pulled so far, until the other one has to.

    Just after a pair has changed over the other one must clearly have to: an estimate that is
    disturbed by the jump must not cause the next one.
    """

    def __init__(self, motors: int) -> None:
        self.sides: Sides = (0.0,) * motors
        """The tendon of each pair that pulls: 1 or -1, 0 before the first pose."""
        self.changes = [0] * motors
        """Jumps of each servo through its slack."""
        self.reversals = 0
        """Jumps soon after another one of the same servo: it was sent through its slack in vain."""
        self._changed_s = [-math.inf] * motors

    def hold(self, hold_of: Callable[[Sides, Sides], Hold], time_s: float) -> Hold:
        """The setpoints that hold a pose.

        Args:
            hold_of: holds it, see ``StaticModel.hold``, by the sides that have pulled so far and
                the moments at which they change over.
            time_s: present time.
        """
        dwells = [time_s - changed_s < _DWELL_S for changed_s in self._changed_s]
        most = tuple(_DWELL_CHANGE_OVER if it else LEAST_CHANGE_OVER for it in dwells)
        hold = hold_of(self.sides, most)
        for motor, (side, before) in enumerate(zip(hold.sides, self.sides, strict=True)):
            if before not in (0.0, side):
                self.changes[motor] += 1
                self.reversals += dwells[motor]
                self._changed_s[motor] = time_s
        self.sides = hold.sides
        return hold
