"""The do-mpc package, which builds its problem on CasADi and solves it with IPOPT."""

from __future__ import annotations

import warnings
from typing import Any

import casadi
import numpy as np

from bench.peers.mpc.casadi_nlp import tip_of
from bench.peers.mpc.problem import Array, Formulation
from ccr_host.control.base import Observation

with warnings.catch_warnings():
    # One warning for each optional feature that is not installed.
    warnings.simplefilter("ignore")
    import do_mpc

QUIET = {"ipopt.print_level": 0, "ipopt.sb": "yes", "print_time": 0}


class DoMpc:
    """States: tip and angles; inputs: increments; targets vary in time."""

    def __init__(self, formulation: Formulation) -> None:
        self.formulation = formulation
        self._step = 1
        live, control = formulation.live_steps, formulation.control
        model = do_mpc.model.Model("discrete")
        tip = model.set_variable("_x", "tip", (3, 1))
        angles = model.set_variable("_x", "angles", (formulation.motors, 1))
        moves = model.set_variable("_u", "moves", (formulation.motors, 1))
        target = model.set_variable("_tvp", "target", (3, 1))
        q = casadi.SX.sym("q", formulation.motors)
        jacobian = casadi.Function("J", [q], [casadi.jacobian(tip_of(formulation, q), q)])
        model.set_rhs("tip", tip + jacobian(angles) @ moves)
        model.set_rhs("angles", angles + moves)
        model.setup()
        mpc = do_mpc.controller.MPC(model)
        mpc.settings.n_horizon = live
        mpc.settings.t_step = 1.0
        mpc.settings.store_full_solution = False
        mpc.settings.nlpsol_opts = QUIET
        error = tip - target
        # A stage cost applies to the state before its input; the last stage has the terminal cost.
        mpc.set_objective(
            mterm=control.position_weight * casadi.sumsqr(error),
            lterm=control.position_weight * casadi.sumsqr(error)
            + formulation.weights.effort * casadi.sumsqr(moves),
        )
        mpc.set_rterm(moves=0.0)
        mpc.bounds["lower", "_u", "moves"] = -control.step_bound_rad
        mpc.bounds["upper", "_u", "moves"] = control.step_bound_rad
        mpc.bounds["lower", "_x", "angles"] = formulation.limits.lower_rad
        mpc.bounds["upper", "_x", "angles"] = formulation.limits.upper_rad
        self._template = mpc.get_tvp_template()
        mpc.set_tvp_fun(self._targets)
        mpc.setup()
        self._mpc: Any = mpc
        self._started = False

    def _targets(self, _time: float) -> Any:
        targets = self.formulation.reference.target_mm
        for k in range(self.formulation.live_steps + 1):
            self._template["_tvp", k, "target"] = targets[max(0, self._step - 1 + k)]
        return self._template

    def step(self, observation: Observation) -> None:
        self._step = observation.step
        self._q_rad = observation.q_rad
        state = np.concatenate([observation.tip_mm, observation.q_rad])
        if not self._started:
            self._mpc.x0 = state
            self._mpc.set_initial_guess()
            self._started = True
        self._mpc.make_step(state)

    def plan(self) -> Array:
        live = self.formulation.live_steps
        moves = [self._mpc.opt_x_num["_u", k, 0].full().ravel() for k in range(live)]
        return self._q_rad + np.cumsum(moves, axis=0)
