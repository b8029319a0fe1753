"""A robot that is mounted in another way than the paper's is identified and led as well as it."""

from functools import cache

import numpy as np
import pytest

from ccr_host.control.adaptive.compiled import CompiledModel
from ccr_host.control.adaptive.identification import StaticsFit
from ccr_host.control.adaptive.parameters import COUNT, Scaling
from ccr_host.description import schema
from ccr_host.robot.rests import Rests
from ccr_host.robot.workspace import MotorLimits
from ccr_host.run.execute import execute_quietly
from ccr_host.run.observer import true_errors_mm
from ccr_host.run.options import RunOptions
from ccr_host.sim.robot.equilibrium import Equilibrium

USUAL, UPSIDE_DOWN, ON_ITS_SIDE, HANGING = "[0,0,-1]", "[0,0,2]", "[1,0,0]", "[0,-1,0]"
ASKEW = "[0.6,-0.6,0.5]"
REGISTERED = (
    "registration.camera_to_robot_deg=[0,0,0]",
    "registration.uncertainty_deg=[0.28,0.07,0.14]",
)


def _gravity(direction: str) -> str:
    return f"robot.gravity_direction={direction}"


@pytest.mark.long
@pytest.mark.parametrize("direction", [USUAL, UPSIDE_DOWN, ON_ITS_SIDE, HANGING, ASKEW])
def test_the_model_explains_the_twin_whichever_way_gravity_pulls(
    compiled: CompiledModel, direction: str
) -> None:
    description = schema.load(None, [_gravity(direction)])
    scaling, equilibrium = Scaling.of(description), Equilibrium(description.twin)
    stops_rad = compiled.tour_rad(
        scaling.parameters(np.zeros(COUNT)), MotorLimits.of(description.servo)
    )
    vectors_mm = np.full((len(stops_rad), 2, 3), np.nan)
    vectors_mm[:, 1] = [equilibrium.tip_mm(stop_rad) for stop_rad in stops_rad]
    rests = Rests.of_vectors(stops_rad, stops_rad, vectors_mm, np.full(len(stops_rad), 6.0))
    assert StaticsFit(scaling, rests, compiled).finish().rms_mm < 0.2


@cache
def _error_mm(direction: str) -> float:
    overrides = (_gravity(direction), *REGISTERED, "control.solver=compiled")
    result = execute_quietly(RunOptions(path="8shape", overrides=overrides))
    errors_mm = true_errors_mm(result.records)
    assert errors_mm is not None
    return float(np.linalg.norm(errors_mm, axis=1).mean())


@pytest.mark.long
@pytest.mark.parametrize("direction", [UPSIDE_DOWN, pytest.param(HANGING, marks=pytest.mark.slow)])
def test_a_robot_mounted_in_another_way_follows_as_well(direction: str) -> None:
    assert _error_mm(direction) < 1.2 * _error_mm(USUAL)
