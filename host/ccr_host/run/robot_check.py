"""Whether the robot is the one that is described: before its path, and along it."""

from __future__ import annotations

from collections import deque

import numpy as np

from ccr_host.control.adaptive.control_law import AdaptiveStatics
from ccr_host.control.adaptive.identification import FloatArray, Rests, StaticsFit
from ccr_host.control.adaptive.misfit import MisfitError, is_misfit, misfit
from ccr_host.control.adaptive.motion import Rest, first_rest, moved
from ccr_host.control.adaptive.parameters import Parameters
from ccr_host.control.adaptive.probe import Probe
from ccr_host.control.adaptive.tip import markers_mm
from ccr_host.control.base import Controller
from ccr_host.description.schema import Description

_FEWEST_RESTS = 4
"""Where markers were hidden from more of them nothing can be said."""
_LOOK_PERIOD_US = 250_000
_UNEXPLAINED_MM = 25.0
"""Between tip and model: twice what loads, friction and a model that saw few rests leave."""
_FOR_US = 3_000_000
_KEPT = 12
"""Looks that tell the cause."""


class RobotCheck:
    """Judges the rests before the path, and the robot's answers along it.

    Args:
        description: of the robot.
        controller: one that begins with a tour of rests makes a probe unnecessary.
    """

    def __init__(self, description: Description, controller: Controller) -> None:
        self._description = description
        self._adaptive = controller if isinstance(controller, AdaptiveStatics) else None
        has_tour = self._adaptive is not None and not self._adaptive.is_identified
        self.probe = None if has_tour else Probe(description)
        self._model: Parameters | None = None
        self._told = "the markers were seen at too few rests: the robot's motion is not checked"
        self._rest: Rest | None = None
        self._looked_us = 0
        self._odd_since_us: int | None = None
        self._seen: deque[tuple[FloatArray, FloatArray]] = deque(maxlen=_KEPT)

    @property
    def told(self) -> str:
        """What the rests before the path have shown, for the log."""
        return self._told

    def judge_probe(self) -> Rests | None:
        """Rests of the probe that the description does not explain, None if it does."""
        return None if self.probe is None else self._judge(self.probe.rests, self.probe.fit)

    def judge_approach(self) -> Rests | None:
        """The same of those that the controller has fitted its model to, if it has."""
        adaptive = self._adaptive
        return None if adaptive is None else self._judge(adaptive.rests, adaptive.fit)

    def judge_step(
        self, time_us: int, q_rad: FloatArray, middle_mm: FloatArray, seen_mm: FloatArray
    ) -> Rests | None:
        """The same of what was seen along the path, once it has been odd for some seconds."""
        if self._model is None or time_us - self._looked_us < _LOOK_PERIOD_US:
            return None
        p, self._looked_us = self._model, time_us
        self._rest = first_rest(p, q_rad) if self._rest is None else moved(p, self._rest, q_rad)
        self._seen.append((q_rad, np.stack([middle_mm, seen_mm])))
        expected_mm = markers_mm(p, self._rest.theta_rad)[1]
        if np.linalg.norm(seen_mm - expected_mm) < _UNEXPLAINED_MM:
            self._odd_since_us = None
            return None
        if self._odd_since_us is None:
            self._odd_since_us = time_us
        if time_us - self._odd_since_us < _FOR_US:
            return None
        setpoints_rad, markers = (np.array(column) for column in zip(*self._seen, strict=True))
        return Rests(setpoints_rad[0], setpoints_rad, markers, np.ones(len(markers)))

    def cause_of(self, odd: Rests) -> MisfitError:
        """What is most likely wrong; takes seconds, for a robot that has been made safe."""
        return misfit(odd, self._description)

    def _judge(self, rests: Rests, fit: StaticsFit | None) -> Rests | None:
        if len(rests.count) < _FEWEST_RESTS:
            return None
        if fit is None:  # The rests were too odd to be fitted.
            return rests
        found = fit.result()
        self._model, self._rest = fit.scaling.parameters(found.score), None
        self._told = f"the robot was seen at {len(rests.count)} rests; {found.residual}"
        return rests if is_misfit(found, fit.scaling) else None
