"""The surface of an identified robot: points that it reaches, in the frame of (10)."""

from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from ccr_host.control.adaptive.model import tour_bending_rad
from ccr_host.control.adaptive.motion import predicted_mm
from ccr_host.control.adaptive.parameters import COUNT, Scaling
from ccr_host.control.adaptive.statics import unhindered_setpoints_for
from ccr_host.control.adaptive.surface import IdentifiedSurface
from ccr_host.core.errors import ConfigError
from ccr_host.description import schema
from ccr_host.description.schema import Description, Identified
from ccr_host.robot.kinematics import ConstantCurvature
from ccr_host.robot.paths import PAPER_PATHS, load_path
from ccr_host.robot.rests import Rests
from ccr_host.robot.workspace import MotorLimits, Workspace
from ccr_host.run.options import RunOptions
from ccr_host.tools.survey import identified_section

DESCRIBED = schema.load(None, ["control.solver=compiled"])
LIMITS = MotorLimits.of(DESCRIBED.servo)
SHORTER_MM = 6.0
PRIOR = Scaling(DESCRIBED.robot).parameters(np.zeros(COUNT))
SHORT = PRIOR._replace(
    length_1_mm=PRIOR.length_1_mm - SHORTER_MM,
    length_2_mm=PRIOR.length_2_mm - SHORTER_MM,
    slack_1_rad=0.08,
)
TURN = Rotation.from_rotvec([1.0, -1.5, 2.0], degrees=True).as_matrix()


def identified_as_short(
    description: Description = DESCRIBED, turn: np.ndarray | None = None
) -> Description:
    """The description with the rests of the short robot, as a turned camera sees them."""
    stops_rad = unhindered_setpoints_for(PRIOR, tour_bending_rad())
    count = np.full(len(stops_rad), 30.0)
    unseen = Rests.in_turn(np.zeros(2), stops_rad, np.zeros((len(stops_rad), 3, 3)), count)
    rests = Rests.of_vectors(unseen.from_rad, stops_rad, predicted_mm(SHORT, unseen), count)
    section = identified_section(
        rests if turn is None else rests.turned(turn), description, "2026-01-02"
    )
    plain = {key: getattr(value, "unwrap", lambda v=value: v)() for key, value in section.items()}
    return description.model_copy(update={"identified": Identified.model_validate(plain)})


@pytest.fixture(scope="module")
def surface() -> IdentifiedSurface:
    return IdentifiedSurface(identified_as_short())


def tips_mm(q_rad: np.ndarray) -> np.ndarray:
    """Where the short robot comes to rest."""
    each = [Rests.in_turn(q, q[None], np.zeros((1, 3, 3)), np.ones(1)) for q in q_rad]
    return np.array([predicted_mm(SHORT, rest)[0, 1] for rest in each])


@pytest.mark.long
@pytest.mark.parametrize("path", PAPER_PATHS)
def test_its_robot_comes_to_rest_where_the_path_is(surface: IdentifiedSurface, path: str) -> None:
    reference = load_path(path, 1.0, surface)
    assert np.array_equal(LIMITS.clip(reference.q_rad), reference.q_rad)
    off_mm = np.linalg.norm(tips_mm(reference.q_rad) - reference.target_mm, axis=1)
    # Identified to tenths of a mm; what is beyond reach is beyond it laterally.
    assert np.all(np.abs(off_mm - reference.unavoidable_mm) < 0.4)
    described = load_path(path, 1.0, Workspace(ConstantCurvature(DESCRIBED.robot), LIMITS))
    assert np.array_equal(reference.target_mm[:, [0, 2]], described.target_mm[:, [0, 2]])
    assert np.all(reference.target_mm[:, 1] > described.target_mm[:, 1] + SHORTER_MM)


@pytest.mark.long
def test_a_turned_camera_does_not_turn_it(surface: IdentifiedSurface) -> None:
    turned = IdentifiedSurface(identified_as_short(turn=TURN))
    seen = [load_path("8shape", 1.0, each).target_mm for each in (surface, turned)]
    # 3 deg would lift the ends of the path by 2.5 mm; what is left is the fit's uncertainty.
    assert np.abs(seen[0] - seen[1]).max() < 1.0


@pytest.mark.long
def test_a_point_that_has_all_coordinates_keeps_them(surface: IdentifiedSurface) -> None:
    reached_mm = surface.nearest([[5.0, 40.0], [-10.0, 20.0]]).tip_mm
    again = surface.nearest(reached_mm)
    assert again.tip_mm == pytest.approx(reached_mm, abs=1e-3)
    beyond = surface.nearest(reached_mm - [0.0, 5.0, 0.0])
    assert np.all(beyond.distance_mm > 1.0)


@pytest.mark.long
@given(direction_deg=st.floats(0.0, 360.0), away_mm=st.floats(50.0, 150.0))
@settings(max_examples=20, deadline=None)
def test_no_neighbouring_pose_is_nearer_to_a_point_out_of_reach(
    surface: IdentifiedSurface, direction_deg: float, away_mm: float
) -> None:
    direction_rad = np.radians(direction_deg)
    point_mm = away_mm * np.array([np.cos(direction_rad), np.sin(direction_rad)])
    found = surface.nearest(point_mm[None])
    steps_rad = np.radians(4.0) * np.array([(0, 0), (1, 0), (-1, 0), (0, 1), (0, -1)])
    lateral_mm = tips_mm(LIMITS.clip(found.q_rad + steps_rad))[:, [0, 2]]
    here_mm, *there_mm = np.linalg.norm(lateral_mm - point_mm, axis=1)
    # What differs by less than the fit is uncertain by is as near.
    assert min(there_mm) > here_mm - 0.3


@pytest.mark.long
def test_beyond_the_motor_limits_it_ends_where_they_are() -> None:
    narrow = DESCRIBED.servo.model_copy(update={"angle_max_deg": (20.0, 85.0)})
    surface = IdentifiedSurface(identified_as_short(DESCRIBED.model_copy(update={"servo": narrow})))
    found = surface.nearest([[0.0, 45.0], [0.0, -45.0]])
    assert np.degrees(found.q_rad[:, 0].max()) == pytest.approx(20.0)
    assert tips_mm(found.q_rad) == pytest.approx(found.tip_mm, abs=0.4)
    assert found.distance_mm.max() > 10.0
    assert found.distance_mm.min() < 0.01


@pytest.mark.parametrize(
    ("robot", "why"), [(None, "section identified"), ("two-spatial", "two planar segments")]
)
def test_a_robot_that_was_not_identified_has_none(robot: str | None, why: str) -> None:
    with pytest.raises(ConfigError, match=why):
        IdentifiedSurface(schema.load(robot))


def test_an_unknown_surface_is_refused() -> None:
    options: dict[str, Any] = {"path": "8shape", "surface": "mine"}
    with pytest.raises(ConfigError, match="give model or robot"):
        RunOptions(**options)
