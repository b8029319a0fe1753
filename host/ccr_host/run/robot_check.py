"""Whether the robot is the one that is described: before its path, and along it."""

from __future__ import annotations

from collections import deque

import numpy as np

from ccr_host.config import Description
from ccr_host.control.adaptive.controller import AdaptiveStatics
from ccr_host.control.adaptive.identification import FloatArray, Rests
from ccr_host.control.adaptive.misfit import MisfitError, is_misfit, misfit
from ccr_host.control.adaptive.motion import Rest, first_rest, moved
from ccr_host.control.adaptive.parameters import Parameters
from ccr_host.control.adaptive.probe import Probe
from ccr_host.control.adaptive.tip import tip_mm
from ccr_host.control.base import Controller

_LOOK_PERIOD_US = 250_000
_UNEXPLAINED_MM = 25.0
"""Between tip and model: twice what loads, friction and a model that saw few rests leave."""
_FOR_US = 3_000_000
_KEPT = 12
"""Looks that tell the cause."""


class RobotCheck:
    """Judges the probe's moves, the controller's own, and the robot's answers along the path.

    Args:
        description: of the robot.
    """

    def __init__(self, description: Description) -> None:
        self.probe = Probe(description)
        self._description = description
        self._model: Parameters | None = None
        self._rest: Rest | None = None
        self._looked_us = 0
        self._odd_since_us: int | None = None
        self._seen: deque[tuple[FloatArray, FloatArray]] = deque(maxlen=_KEPT)

    def judge_probe(self) -> Rests | None:
        """Rests that the description does not explain, None if it does."""
        self._model = self.probe.parameters
        return self.probe.rests if self.probe.found_misfit else None

    def judge_controller(self, controller: Controller) -> Rests | None:
        """The same of the rests that a controller has fitted its model to, if it has."""
        fitted = controller.identification if isinstance(controller, AdaptiveStatics) else None
        if fitted is None:
            return None
        scaling, fit = fitted.scaling, fitted.result()
        self._model, self._rest = scaling.parameters(fit.score), None
        return fitted.rests if is_misfit(fit, scaling) else None

    def judge_step(self, time_us: int, q_rad: FloatArray, seen_mm: FloatArray) -> Rests | None:
        """The same of what was seen along the path, once it has been odd for some seconds."""
        if self._model is None or time_us - self._looked_us < _LOOK_PERIOD_US:
            return None
        p, self._looked_us = self._model, time_us
        self._rest = first_rest(p, q_rad) if self._rest is None else moved(p, self._rest, q_rad)
        self._seen.append((q_rad, seen_mm))
        off_mm = float(np.linalg.norm(seen_mm - tip_mm(p, self._rest.theta_rad)))
        if off_mm < _UNEXPLAINED_MM:
            self._odd_since_us = None
            return None
        if self._odd_since_us is None:
            self._odd_since_us = time_us
        if time_us - self._odd_since_us < _FOR_US:
            return None
        setpoints_rad, tips_mm = (np.array(column) for column in zip(*self._seen, strict=True))
        return Rests(setpoints_rad[0], setpoints_rad, tips_mm, np.ones(len(tips_mm)))

    def cause_of(self, odd: Rests) -> MisfitError:
        """What is most likely wrong; takes seconds, for a robot that has been made safe."""
        return misfit(odd, self._description)
