"""The model's pose along the commands given: where it was at a past time, where it will come to."""

from __future__ import annotations

import numpy as np

from ccr_host.control.adaptive.model import PLAIN, StaticModel
from ccr_host.control.adaptive.motion import Rest, first_rest
from ccr_host.control.adaptive.parameters import Parameters
from ccr_host.control.adaptive.setpoint_history import SetpointHistory
from ccr_host.control.adaptive.statics import Drive


class PoseFollower:
    """Follows a history of setpoints; play and friction need every turn of them.

    Args:
        p: parameters, floats.
        history: of the setpoints.
        time_s: from when on to follow it.
        model: what computes the poses.
    """

    def __init__(
        self,
        p: Parameters,
        history: SetpointHistory,
        time_s: float,
        model: StaticModel = PLAIN,
    ) -> None:
        self._model = model
        self._history = history
        self._time_s = time_s
        self.rest: Rest = first_rest(p, history.at(time_s))

    def advance_to(self, p: Parameters, time_s: float) -> Rest:
        """The rest at a time, or the present one if that is later."""
        if time_s > self._time_s:
            for setpoint_rad in self._history.corners(self._time_s, time_s):
                self.rest = self._model.moved(p, self.rest, setpoint_rad)
            self._time_s = time_s
        return self.rest

    def hold_ahead(self, p: Parameters) -> Drive:
        """What will hold the robot once all commands are done."""
        rest = self.rest
        for setpoint_rad in self._history.corners(self._time_s, np.inf):
            rest = self._model.held_after(p, rest, setpoint_rad)
        return rest.drive
