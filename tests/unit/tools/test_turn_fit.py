"""The camera of a robot of any kind is found from rests of the model that `identify` fits."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from ccr_host.control.adaptive.misfit import MisfitError
from ccr_host.description import schema
from ccr_host.robot.chain import PAPER_FRAME
from ccr_host.robot.rest_model import Markers
from ccr_host.robot.rests import Rests
from ccr_host.robot.workspace import MotorLimits
from ccr_host.run.observer import Observers
from ccr_host.run.open_rig import open_rig
from ccr_host.run.options import RigOptions
from ccr_host.tools.chain_fit import ChainModel
from ccr_host.tools.turn_fit import TurnError, fit_turn, measure_turn, turn_stops_rad

NAMES = "single", "two-spatial", "three-spatial"
NOISE_MM = 0.05
"""Of a mean of thirty exposures."""


def rests_of(name: str, seed: int, led=lambda q: q, camera=None) -> Rests:
    """Rests of a robot whose parameters deviate from the described ones as their priors say."""
    rng = np.random.default_rng(seed)
    description = schema.load(name)
    robot = description.robot
    q_rad = turn_stops_rad(MotorLimits.of(description.servo))
    offset_mm = np.array([0.0, robot.marker_offset_mm, 0.0])
    markers = Markers(tuple(range(len(robot.chain))), offset_mm, are_from_base=True)
    model = ChainModel(robot.chain, robot.pulley_radius_mm * led(q_rad), markers)
    score = np.clip(rng.normal(0.0, 0.7, len(model.unknowns)), -1.5, 1.5)
    score[[unknown.kind == "turn" for unknown in model.unknowns]] = 0.0
    seen_mm = model.predicted_mm(score, np.arange(len(q_rad))) @ PAPER_FRAME.T
    seen_mm = seen_mm + rng.normal(0.0, NOISE_MM, seen_mm.shape)
    rests = Rests.of_vectors(q_rad[0], q_rad, seen_mm, np.full(len(q_rad), 30.0))
    turn = Rotation.random(random_state=seed) if camera is None else camera
    return rests.turned(turn.as_matrix().T)


@pytest.mark.long
@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("seed", [1, 2, 3])
def test_the_turn_is_found_as_exactly_as_stated(name: str, seed: int) -> None:
    found = fit_turn(rests_of(name, seed), schema.load(name))
    true = Rotation.random(random_state=seed).as_matrix()
    off_deg = Rotation.from_matrix(found.camera_to_robot @ true.T).as_rotvec(degrees=True)
    assert (np.abs(off_deg) < 3.0 * found.uncertainty_deg).all()
    assert np.abs(off_deg).max() < 4.0
    assert found.residual_mm < 1.0


@pytest.mark.long
def test_a_reversed_and_two_exchanged_motors_are_named() -> None:
    description = schema.load("two-spatial")
    level = Rotation.identity()
    signs = np.array([1.0, 1.0, -1.0, 1.0])
    with pytest.raises(MisfitError, match="motor 3 reversed"):
        fit_turn(rests_of("two-spatial", 1, lambda q: q * signs, level), description)
    with pytest.raises(MisfitError, match="motors 1 and 3 are exchanged"):
        fit_turn(rests_of("two-spatial", 1, lambda q: q[:, [2, 1, 0, 3]], level), description)


@pytest.mark.long
def test_few_rests_and_a_robot_that_is_held_give_no_turn() -> None:
    description, rests = schema.load("two-spatial"), rests_of("two-spatial", 1)
    few = replace(
        rests, q_rad=rests.q_rad[:4], markers_mm=rests.markers_mm[:4], count=rests.count[:4]
    )
    with pytest.raises(TurnError, match="4 poses only"):
        fit_turn(few, description)
    held = replace(rests, markers_mm=np.repeat(rests.markers_mm[:1], len(rests.q_rad), axis=0))
    with pytest.raises((TurnError, MisfitError)):
        fit_turn(held, description)


@pytest.mark.parametrize("name", NAMES)
def test_stops_move_each_motor_alone_and_stay_within_its_limits(name: str) -> None:
    limits = MotorLimits.of(schema.load(name).servo)
    stops_rad = turn_stops_rad(limits)
    assert (stops_rad >= limits.lower_rad).all()
    assert (stops_rad <= limits.upper_rad).all()
    alone = stops_rad[np.count_nonzero(stops_rad, axis=1) == 1]
    motors = len(limits.lower_rad)
    assert {tuple(row) for row in np.sign(alone)} >= {tuple(row) for row in np.eye(motors)}


@pytest.mark.long
@pytest.mark.parametrize(
    ("name", "tracker"), [("single", "twin:"), ("two-spatial", "ndi-emulator:")]
)
def test_a_camera_that_stands_anyhow_is_found_on_the_twin(name: str, tracker: str) -> None:
    overrides = ("tracker.rotation_deg=[10,-40,25]",)
    options = RigOptions(robot=name, tracker=tracker, overrides=overrides)
    description = options.description()
    with open_rig(options, description, Observers(), in_camera_frame=True) as rig:
        found = measure_turn(rig, description, lambda *_: None)
    true = Rotation.from_rotvec([10.0, -40.0, 25.0], degrees=True).as_matrix()
    off_deg = Rotation.from_matrix(found.camera_to_robot @ true.T).as_rotvec(degrees=True)
    assert (np.abs(off_deg) < 2.5 * found.uncertainty_deg).all()
