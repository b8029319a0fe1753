"""A few small moves that show whether the robot is the one that is described."""

from __future__ import annotations

from collections import deque

import numpy as np

from ccr_host.control.adaptive.excitation import tour
from ccr_host.control.adaptive.identification import ZEROS, FloatArray, Rests, Scaling, StaticsFit
from ccr_host.control.adaptive.rest_survey import RestSurvey
from ccr_host.control.adaptive.setpoint_history import SetpointHistory
from ccr_host.control.base import APPROACH_PERIOD_S, Command, Observation, Outcome
from ccr_host.description.schema import Description
from ccr_host.robot.workspace import MotorLimits

_REACH_RAD = np.radians(20.0)
"""Of each motor: past slack and a zero that is off, and half of what paths need."""
_STOPS = ((0.0, 0.0), (0.0, 1.0), (0.0, -1.0), (1.0, 0.0), (-1.0, 0.0))
"""Motor 1 last: falling through its slack sets the robot swinging."""
_REST_S = 0.8
_DELAY_S = 0.04
_ZERO_FREEDOM = 3.0
"""Zeros are looked for further away than they are believed to be: there are few rests."""


class Probe:
    """Leads the robot through the moves, as a controller leads it to its path.

    Args:
        description: of the robot.
    """

    def __init__(self, description: Description) -> None:
        self._scaling = Scaling.of(description).freed(ZEROS, _ZERO_FREEDOM)
        self._limits = MotorLimits.of(description.servo)
        self._setpoints: deque[FloatArray] | None = None
        self._fit: StaticsFit | None = None
        self._seen_us = -1

    def approach(self, observation: Observation) -> Command | None:
        """The next command; None once all is known."""
        now_s = observation.time_us * 1e-6
        if self._setpoints is None:
            self._begin(observation)
        assert self._setpoints is not None
        self._measure(observation)
        if self._setpoints:
            self._last_rad = self._setpoints.popleft()
            self._history.command(now_s, self._last_rad, APPROACH_PERIOD_S)
        elif self._fit is None:
            self._fit = StaticsFit(self._scaling, self.rests)
        elif not self._fit.improve():
            return None
        return Command(self._last_rad, np.zeros((0, 3)), Outcome.SOLVED, ramp_s=APPROACH_PERIOD_S)

    @property
    def rests(self) -> Rests:
        """Where the robot was seen at rest."""
        return self._survey.rests()

    @property
    def fit(self) -> StaticsFit | None:
        """Of the model to them; None before all is known."""
        return self._fit

    def _begin(self, observation: Observation) -> None:
        self._last_rad = observation.q_rad
        self._history = SetpointHistory(observation.q_rad)
        self._survey = RestSurvey(self._scaling, observation.q_rad)
        stops_rad = self._limits.clip(observation.q_rad + _REACH_RAD * np.array(_STOPS))
        self._setpoints = deque(tour(observation.q_rad, stops_rad, _REST_S, APPROACH_PERIOD_S))

    def _measure(self, observation: Observation) -> None:
        exposed_us = observation.time_us - observation.tip_age_us
        if observation.tip_mm is not None and exposed_us != self._seen_us:
            self._seen_us = exposed_us
            markers_mm = np.stack([observation.middle_mm, observation.tip_mm])
            self._survey.add(self._history, exposed_us * 1e-6 - _DELAY_S, markers_mm)
