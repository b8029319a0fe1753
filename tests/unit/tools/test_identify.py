"""Identification of made-up robots whose parameters are known."""

from __future__ import annotations

import datetime
from dataclasses import replace
from functools import partial

import numpy as np
import pytest

from ccr_host.control.adaptive.model import tour_bending_rad
from ccr_host.control.adaptive.motion import predicted_mm
from ccr_host.control.adaptive.parameters import COUNT, Parameters, Scaling
from ccr_host.core.errors import ConfigError
from ccr_host.description import file as description_file
from ccr_host.description import schema
from ccr_host.description.schema import Description, Robot, Segment, Tendon, parse
from ccr_host.robot.rest_model import Markers
from ccr_host.robot.rests import Rests
from ccr_host.tools.chain_fit import ChainModel
from ccr_host.tools.identify import Identification, WrongRobotError
from ccr_host.tools.identify import identify as identify_on
from ccr_host.tools.measured import Measured

pytestmark = pytest.mark.long

NOISE_MM = 0.3
identify = partial(identify_on, date=datetime.date(2026, 11, 27))


def described(*, motors_of_first: tuple[int, ...] = (1, 2, 3)) -> Description:
    """Two spatial segments on three tendons each."""
    segments = tuple(
        Segment(
            length_mm=60.0,
            tendon_radius_mm=4.5,
            tendons=tuple(
                Tendon(angle_deg=60.0 * place + turn, motor=motor)
                for turn, motor in zip((0.0, 120.0, -120.0), motors, strict=True)
            ),
        )
        for place, motors in enumerate((motors_of_first, (4, 5, 6)))
    )
    return Description(robot=Robot(segments=segments))


def measured_of(command: np.ndarray, unit: str, tip_mm: np.ndarray) -> Measured:
    rows = len(command)
    time_s, pattern = np.arange(rows, dtype=float), np.array([""] * rows)
    return Measured(time_s, command, unit, tip_mm, np.empty((rows, 0, 3)), pattern)


def travel_mm(rows: int = 120) -> np.ndarray:
    """Smooth motion of both segments, with a little pretension."""
    time = np.linspace(0.0, 40.0, rows)
    ways = np.radians([0, 120, -120, 60, 180, -60])
    first = 4.0 * np.sin(0.9 * time)[:, None] * np.cos(ways - 0.3 * time[:, None])
    second = 4.0 * np.sin(1.3 * time)[:, None] * np.cos(ways + 0.7 * time[:, None])
    return 0.5 + first + second * (np.arange(6) > 2)


def truth_of(description: Description, seed: int) -> tuple[Measured, dict[str, float]]:
    """Measurements of a robot that differs from its description, in a turned frame."""
    random = np.random.default_rng(seed)
    travel = travel_mm()
    robot = description.robot
    ends, offset_mm = range(len(robot.segments)), np.array([0.0, robot.marker_offset_mm, 0.0])
    model = ChainModel(robot.segments, travel, Markers(tuple(ends), offset_mm, are_from_base=False))
    score = random.standard_normal(len(model.unknowns))
    for number, unknown in enumerate(model.unknowns):
        if unknown.kind in ("turn", "base", "weight"):
            score[number] *= 0.3
    ends_mm = model.predicted_mm(score, np.arange(len(travel)))
    turned = ends_mm @ np.array([[0.0, -1.0, 0.0], [0.0, 0.0, -1.0], [1.0, 0.0, 0.0]]) + 40.0
    truth = {u.name: v for u, v in zip(model.unknowns, model.values(score), strict=True)}
    seen_mm = turned + NOISE_MM * random.standard_normal(turned.shape)
    measured = measured_of(travel, "mm", seen_mm[:, -1])
    return replace(measured, below_mm=seen_mm[:, :-1]), truth


@pytest.fixture(scope="module")
def identified() -> Identification:
    return identify(described(), by_tip_alone(truth_of(described(), 1)[0]))


def by_tip_alone(measured: Measured) -> Measured:
    return replace(measured, below_mm=measured.below_mm[:, :0])


def test_a_robot_of_the_models_kind_is_identified_down_to_the_noise(identified):
    _, truth = truth_of(described(), 1)
    assert identified.held_out.rmse_mm < 1.5 * NOISE_MM * np.sqrt(3.0)
    wrong = [
        (p.value - truth[p.name]) / p.deviation
        for p in identified.parameters
        if not p.name.startswith(("turn", "base", "angle"))
    ]
    assert np.sqrt(np.mean(np.square(wrong))) < 1.5


def test_markers_below_the_tip_tell_more_of_the_segments_below_it(identified):
    measured, truth = truth_of(described(), 1)
    measured.below_mm[::3] = np.nan
    found = {p.name: p for p in identify(described(), measured).parameters}
    for alone in identified.parameters:
        if alone.name in ("length_1_mm", "tendon_radius_1_mm", "length_2_mm"):
            assert found[alone.name].deviation < 0.7 * alone.deviation
            off = found[alone.name].value - truth[alone.name]
            assert abs(off) < 3.0 * found[alone.name].deviation


def test_it_is_told_what_the_measurements_say_and_what_they_cannot_tell_apart(identified):
    of = {p.name: p for p in identified.parameters}
    assert of["tendon_radius_1_mm"].identified
    assert not of["length_1_mm"].identified
    # All tendons of a robot turned about its axis look like tendons that stand aside.
    assert of["angle_1_rad"].confounded_with.startswith("turn")
    for p in identified.parameters:
        assert p.deviation <= 1.001 * p.prior_deviation
        assert bool(p.confounded_with) == (abs(p.correlation) >= 0.7)


def test_what_was_found_is_a_description_and_leaves_the_comments(identified):
    text = """
[[robot.segments]]
length_mm = 60.0  # as built
tendon_radius_mm = 4.5
tendons = [
  { angle_deg = 0, motor = 1 }, { angle_deg = 120, motor = 2 }, { angle_deg = -120, motor = 3 },
]

[[robot.segments]]  # the distal one
length_mm = 60.0
tendon_radius_mm = 4.5
[[robot.segments.tendons]]
angle_deg = 60  # beside the first
motor = 4
[[robot.segments.tendons]]
angle_deg = 180
motor = 5
[[robot.segments.tendons]]
angle_deg = -60
motor = 6
"""
    assert parse(text).robot.segments == described().robot.segments
    written = description_file.updated(text, identified.sections)
    for comment in ("# as built", "# the distal one", "# beside the first"):
        assert comment in written
    segments = parse(written).robot.segments
    of = {p.name: p.value for p in identified.parameters}
    assert segments[1].length_mm == pytest.approx(of["length_2_mm"], abs=0.01)
    clocking_deg = np.degrees(of["clocking_2_rad"])
    assert segments[1].clocking_deg == pytest.approx(clocking_deg, abs=0.01)
    assert segments[0].tendons[2].slack_mm == pytest.approx(of["slack_3_mm"], abs=0.001)
    assert [t.motor for s in segments for t in s.tendons] == [1, 2, 3, 4, 5, 6]


def test_described_clocking_moves_the_robot_as_fitted_clocking_does():
    first, second = described().robot.segments
    clocked = first, second.model_copy(update={"clocking_deg": 10.0})
    model, rows = ChainModel((first, second), travel_mm()), np.arange(120)
    score = model.nothing
    number = [unknown.kind for unknown in model.unknowns].index("clocking")
    score[number] = np.radians(10.0) / model.deviation[number]
    fitted_mm, as_described_mm = (
        model.predicted_mm(score, rows),
        model.predicted_mm(0 * score, rows),
    )
    clocked_model = ChainModel(clocked, travel_mm())
    clocked_mm = clocked_model.predicted_mm(clocked_model.nothing, rows)
    assert clocked_mm == pytest.approx(fitted_mm, abs=1e-6)
    assert np.abs(fitted_mm - as_described_mm).max() > 1.0


@pytest.mark.parametrize(
    ("unit", "command_factor", "tip_factor", "told"),
    [
        ("mm", 1.0, 1e-3, "the tip moves by 0"),
        ("mm", 1.0, 1e1, "the tip moves by"),
        ("rad", np.degrees(0.2), 1.0, "motors turn by up to"),
        ("rad", np.radians(0.2), 1.0, "motors turn by up to"),
    ],
)
def test_a_unit_that_makes_no_sense_is_told_instead_of_a_robot_that_is_not_described(
    unit, command_factor, tip_factor, told
):
    travel = travel_mm()
    tip_mm = tip_factor * 10.0 * travel[:, :3]
    with pytest.raises(ConfigError, match=told) as refused:
        identify(described(), measured_of(command_factor * travel, unit, tip_mm))
    assert "the unit in the header" in refused.value.cure


def test_another_robot_is_told_so_and_not_identified():
    measured, _ = truth_of(described(), 1)
    with pytest.raises(WrongRobotError, match="does not move as described"):
        identify(described(motors_of_first=(3, 1, 2)), measured)
    with pytest.raises(ConfigError, match="measurements of 6 motors"):
        identify(Description(), measured)
    few = measured.kept(np.arange(120) < 22)
    with pytest.raises(ConfigError, match="rows to fit"):
        identify(described(), few, train_share=0.9)
    with pytest.raises(ConfigError, match="0 rows are left"):
        identify(described(), measured.kept(np.zeros(120, dtype=np.bool_)))


def test_a_robot_that_goes_nowhere_twice_is_not_taken_for_another_one():
    measured, _ = truth_of(described(), 1)
    random = np.random.default_rng(1)
    astray_mm = 18.0 * random.standard_normal(measured.tip_mm.shape)
    restless = replace(by_tip_alone(measured), tip_mm=measured.tip_mm + astray_mm)
    with pytest.raises(WrongRobotError, match="mm RMS of a motion of"):
        identify(described(), restless)
    at_home = np.arange(len(astray_mm)) % 12 == 0
    tip_mm = np.where(at_home[:, None], restless.tip_mm.mean(axis=0) + astray_mm, restless.tip_mm)
    command = np.where(at_home[:, None], 0.0, restless.command)
    identify(described(), replace(restless, command=command, tip_mm=tip_mm))


def rests_of(p: Parameters, q_rad: np.ndarray) -> np.ndarray:
    nothing = np.full((len(q_rad), 2, 3), np.nan)
    return predicted_mm(p, Rests.of_vectors(q_rad, q_rad, nothing, np.ones(len(q_rad))))[:, 1]


def two_motor_robot() -> tuple[np.ndarray, np.ndarray, Parameters]:
    scaling = Scaling(Robot())
    score = np.zeros(COUNT)
    score[[0, 3, 7, 18]] = 0.8, -0.6, 0.7, 1.0
    p = scaling.parameters(score)
    tour = tour_bending_rad() / p.gain_1
    q_rad = np.concatenate([np.zeros((1, 2)), tour, tour[::-1] * 0.7])
    return q_rad, rests_of(p, q_rad), p


def test_a_robot_with_two_motors_is_identified_by_the_model_of_adaptive_also_from_travel():
    q_rad, tip_mm, p = two_motor_robot()
    tip_mm = tip_mm + 0.2 * np.random.default_rng(1).standard_normal(tip_mm.shape)
    compiled = schema.load(None, ["control.solver=compiled"])
    found = identify(compiled, measured_of(12.5 * q_rad, "mm", tip_mm))
    assert found.held_out.median_mm < 1.0
    of = {f.name: f for f in found.parameters}
    assert of["gain_1"].value == pytest.approx(p.gain_1, abs=3.0 * of["gain_1"].deviation)
    assert "middle_up_mm" not in of
    section = found.sections["identified"]
    assert len(section["setpoint_rad"]) <= 60
    assert "middle_mm" not in section
    assert parse(description_file.updated("", found.sections)).identified is not None
