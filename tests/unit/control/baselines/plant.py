"""A robot made of the kinematic model: setpoints in, delayed pictures out."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from ccr_host.control.base import APPROACH_PERIOD_S, Command, Observation
from ccr_host.control.registry import make_controller
from ccr_host.description.schema import Description
from ccr_host.robot.kinematics import ConstantCurvature
from ccr_host.robot.paths import load_path
from ccr_host.robot.reference import Reference
from ccr_host.robot.workspace import MotorLimits, Workspace

DESCRIPTION = Description()
LIMITS = MotorLimits.of(DESCRIPTION.servo)
BELIEVED = ConstantCurvature(DESCRIPTION.robot)
SLEW_RAD_S = np.radians(DESCRIPTION.servo.slew_deg_s[0])
AGE_US = 50_000

TipOf = Callable[[np.ndarray], np.ndarray | None]


@lru_cache
def reference_of(name: str, rate_hz: float) -> Reference:
    return load_path(name, rate_hz, Workspace(BELIEVED, LIMITS))


@dataclass(frozen=True)
class Step:
    """What a command was, and the pose that it led to."""

    command: Command
    before_rad: np.ndarray
    tip_mm: np.ndarray | None


class Bench:
    """One peer on a robot whose tip is ``tip_of`` its setpoint; a picture is a command old."""

    def __init__(self, name: str, reference: Reference) -> None:
        self.controller = make_controller(name, DESCRIPTION)
        self.reference = reference
        self.controller.start(reference)
        self.q_rad = self.seen_rad = np.zeros(2)
        self.time_us = 1_000_000

    def approach(self, tip_of: TipOf) -> Iterator[Step]:
        while True:
            command = self.controller.approach(self.observation(0, tip_of(self.seen_rad)))
            if command is None:
                return
            yield self._carried_out(command, tip_of, APPROACH_PERIOD_S)

    def follow(self, tip_of: TipOf, steps: range) -> Iterator[Step]:
        for step in steps:
            command = self.controller.step(self.observation(step, tip_of(self.seen_rad)))
            yield self._carried_out(command, tip_of, self.reference.period_s)

    def observation(self, step: int, tip_mm: np.ndarray | None) -> Observation:
        age_us = 0 if tip_mm is None else AGE_US
        return Observation(step, self.time_us, tip_mm, age_us, self.q_rad)

    def _carried_out(self, command: Command, tip_of: TipOf, period_s: float) -> Step:
        before_rad = self.q_rad
        is_slow = period_s * 1e6 > 2 * AGE_US
        self.seen_rad = command.q_rad if is_slow else before_rad
        self.q_rad = command.q_rad
        self.time_us += round(period_s * 1e6)
        return Step(command, before_rad, tip_of(command.q_rad))
