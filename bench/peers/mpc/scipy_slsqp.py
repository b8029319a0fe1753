"""SciPy's SLSQP with gradients by finite differences, in place of MATLAB's fmincon."""

from __future__ import annotations

from scipy.optimize import minimize

from bench.peers.mpc.problem import ShiftedStart
from ccr_host.control.base import Observation


class Slsqp(ShiftedStart):
    """SLSQP with its default tolerances; bounds on the increments only, as in (15)."""

    def step(self, observation: Observation) -> None:
        problem = self.formulation.problem(observation)
        guess = self.guess()
        bound = self.formulation.control.step_bound_rad
        result = minimize(
            self.formulation.cost,
            guess,
            args=(problem,),
            method="SLSQP",
            bounds=[(-bound, bound)] * len(guess),
        )
        self.keep(problem, result.x)
