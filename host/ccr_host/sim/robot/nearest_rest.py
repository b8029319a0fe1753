"""The rest poses of a twin, of any number of motors, whose tips are nearest to targets."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

from ccr_host.core.errors import CcrError
from ccr_host.description.simulation import Twin
from ccr_host.sim.robot.equilibrium import Equilibrium

Array = NDArray[np.float64]

_PROBE_RAD = 1e-3
_WITHIN = 1e-9
"""Least distance from the limits, rad: a search begins between them."""
_ROUNDS, _GAINED_MM = 10, 1e-3
_ROUNDING_MM = 1e-6
_REACHED_MM = 0.02
_ELSEWHERE_RAD = 0.5
"""A guess this near to what was found would lead there as well."""
_EFFORT_MM_N = 0.02
"""Weight of the tendons' forces beside the distance: 1 mm costs as much as 50 N. It decides where
many motor angles are as good; tendons that pull against each other would buckle the backbone."""


class NearestRest:
    """Follows targets with the tip of a twin at rest.

    Between two tendons that are slack a motor moves nothing, and no derivative tells on which side
    of this play it should be. So motors are turned to where they begin to pull, to the better side,
    in turns with Gauss-Newton steps. What is found is a minimum, not always the least one.

    Args:
        twin: the ``twin`` section of the robot description.
        lower_rad: lower limits of the shafts, (n,).
        upper_rad: upper limits of the shafts, (n,).
    """

    def __init__(self, twin: Twin, lower_rad: Array, upper_rad: Array) -> None:
        self._equilibrium = Equilibrium(twin)
        self._lower_rad, self._upper_rad = lower_rad, upper_rad
        self.motor_rad: Array = np.clip(np.zeros(len(lower_rad)), lower_rad, upper_rad)
        """Motor angles of the last pose, (n,), at which the next search starts."""

    def distance_mm(self, target_mm: Array, guess_rad: Array | None = None) -> float:
        """Go to the rest pose nearest to a target, and return its distance.

        Args:
            target_mm: desired tip, (3,).
            guess_rad: motor angles, (n,), from which to search as well if the tip does not reach
                the target from the last pose and another pose is there.

        Raises:
            CcrError: the twin has no rest pose there.
        """
        distance_mm, motor_rad = self._descended(self.motor_rad, target_mm)
        if guess_rad is not None and distance_mm > _REACHED_MM:
            guess_rad = np.clip(guess_rad, self._lower_rad, self._upper_rad)
            if (abs(guess_rad - motor_rad) > _ELSEWHERE_RAD).any():
                other_mm, other_rad = self._descended(guess_rad, target_mm)
                if other_mm < distance_mm:
                    distance_mm, motor_rad = other_mm, other_rad
        self.motor_rad = motor_rad
        return distance_mm

    def _descended(self, motor_rad: Array, target_mm: Array) -> tuple[float, Array]:
        """Distance of a target, mm, and motor angles of the minimum that is found from some."""
        motor_rad = np.clip(motor_rad, self._lower_rad + _WITHIN, self._upper_rad - _WITHIN)
        distance_mm = np.inf
        for _ in range(_ROUNDS):
            motor_rad = self._taken_up(motor_rad, target_mm)
            found = least_squares(
                self._cost_mm,
                motor_rad,
                self._cost_slope_mm_rad,
                bounds=(self._lower_rad, self._upper_rad),
                ftol=1e-4,
                xtol=1e-5,
                gtol=1e-2,
                max_nfev=30,
                args=(target_mm,),
            )
            before_mm, distance_mm = distance_mm, float(np.linalg.norm(found.fun[:3]))
            motor_rad = found.x
            if distance_mm > before_mm - _GAINED_MM:
                break
        return distance_mm, motor_rad

    def _taken_up(self, motor_rad: Array, target_mm: Array) -> Array:
        """Turn motors whose tendons are slack to where they pull, if that brings the tip nearer."""
        distance_mm = float(np.linalg.norm(self._equilibrium.tip_mm(motor_rad) - target_mm))
        for motor in range(len(motor_rad)):
            self._equilibrium.tip_mm(motor_rad)
            better_rad = motor_rad
            for play_rad in self._equilibrium.play_rad(motor):
                trial_rad = motor_rad.copy()
                trial_rad[motor] += play_rad + np.copysign(_PROBE_RAD, play_rad)
                if self._lower_rad[motor] < trial_rad[motor] < self._upper_rad[motor]:
                    trial_mm = np.linalg.norm(self._equilibrium.tip_mm(trial_rad) - target_mm)
                    if trial_mm < distance_mm - _ROUNDING_MM:
                        better_rad, distance_mm = trial_rad, float(trial_mm)
            motor_rad = better_rad
        return motor_rad

    def _cost_mm(self, motor_rad: Array, target_mm: Array) -> Array:
        """The tip off its target, then the weighted forces of the tendons.

        Not a number where there is no rest: the search then takes a shorter step.
        """
        start = self._equilibrium.pose
        try:
            off_mm = self._equilibrium.tip_mm(motor_rad) - target_mm
        except CcrError:
            self._equilibrium.pose = start
            return np.full(3 + len(self._equilibrium.forces_n), np.nan)
        return np.concatenate([off_mm, _EFFORT_MM_N * self._equilibrium.forces_n])

    def _cost_slope_mm_rad(self, motor_rad: Array, target_mm: Array) -> Array:
        here_mm = self._cost_mm(motor_rad, target_mm)
        here, columns = self._equilibrium.pose, []
        for motor, angle_rad in enumerate(motor_rad):
            probe_rad = np.zeros(len(motor_rad))
            is_below = angle_rad < self._upper_rad[motor] - _PROBE_RAD
            probe_rad[motor] = _PROBE_RAD if is_below else -_PROBE_RAD
            there_mm = self._cost_mm(motor_rad + probe_rad, target_mm)
            columns.append((there_mm - here_mm) / probe_rad[motor])
            self._equilibrium.pose = here
        slope: Array = np.nan_to_num(np.array(columns).T)
        return slope


def nearest_rests(
    twin: Twin, lower_rad: Array, upper_rad: Array, targets_mm: Array, guesses_rad: Array
) -> tuple[Array, Array]:
    """The rest pose nearest to each target, found from the one before or from a guess.

    Args:
        twin: the ``twin`` section of the robot description.
        lower_rad: lower limits of the shafts, (n,).
        upper_rad: upper limits of the shafts, (n,).
        targets_mm: desired tips, (N, 3).
        guesses_rad: motor angles, (N, n).

    Returns:
        Motor angles, (N, n), and distances from the targets in mm, (N,).

    Raises:
        CcrError: the twin has no rest pose on the way.
    """
    nearest = NearestRest(twin, lower_rad, upper_rad)
    nearest.distance_mm(targets_mm[0], guesses_rad[0])
    found = [
        (nearest.distance_mm(target_mm, guess_rad), nearest.motor_rad)
        for target_mm, guess_rad in zip(targets_mm, guesses_rad, strict=True)
    ]
    distances_mm, motors_rad = zip(*found, strict=True)
    return np.array(motors_rad), np.array(distances_mm)
