from dataclasses import replace

import numpy as np
import pytest
import tomlkit
from pydantic import ValidationError

from ccr_host.control.adaptive.model import tour_bending_rad
from ccr_host.control.adaptive.motion import predicted_mm
from ccr_host.control.adaptive.parameters import COUNT, Scaling
from ccr_host.control.adaptive.statics import unhindered_setpoints_for
from ccr_host.control.base import Observation
from ccr_host.control.registry import make_controller
from ccr_host.core.errors import ConfigError, TrackerError
from ccr_host.description import schema
from ccr_host.description.schema import Description, Identified
from ccr_host.robot.kinematics import ConstantCurvature
from ccr_host.robot.paths import load_path
from ccr_host.robot.rests import Rests, identified_rests
from ccr_host.robot.workspace import MotorLimits, Workspace
from ccr_host.tools.survey import identified_section, trial_fit

BELIEVED = Description()
PRIOR = Scaling(BELIEVED.robot).parameters(np.zeros(COUNT))
TRUTH = PRIOR._replace(slack_1_rad=0.12, tip_per_mm=0.003)


def _rests(count=20):
    stops = unhindered_setpoints_for(PRIOR, tour_bending_rad())[:count]
    rests = Rests.in_turn(
        np.zeros(2), stops, np.zeros((len(stops), 3, 3)), np.full(len(stops), 30.0)
    )
    seen_mm, time_s = predicted_mm(TRUTH, rests), 7.0 + 2.1 * np.arange(len(stops))
    return Rests.of_vectors(rests.from_rad, stops, seen_mm, rests.count, time_s)


def _identified(description=BELIEVED):
    section = identified_section(_rests(), description, "2026-01-02")
    plain = {key: getattr(value, "unwrap", lambda v=value: v)() for key, value in section.items()}
    return description.model_copy(update={"identified": Identified.model_validate(plain)})


def test_rests_come_back_as_they_were_measured():
    found, measured = identified_rests(_identified()), _rests()
    assert found.q_rad == pytest.approx(measured.q_rad, abs=1e-6)
    assert found.tip_mm == pytest.approx(measured.tip_mm, abs=1e-4)
    assert found.count == pytest.approx(measured.count)
    assert found.durations_s() == pytest.approx(measured.durations_s())


@pytest.mark.parametrize("name", ["single", "two-spatial", "three-spatial"])
def test_the_ends_of_all_segments_come_back(name):
    described = schema.load(name)
    segments, motors = len(described.robot.chain), described.robot.motors
    measured = _rests()
    q_rad = np.random.default_rng(1).uniform(-0.5, 0.5, (20, motors))
    vectors_mm = np.random.default_rng(2).uniform(-90.0, 90.0, (20, segments, 3))
    measured = Rests.of_vectors(q_rad, q_rad, vectors_mm, measured.count, measured.time_s)
    section = tomlkit.parse(tomlkit.dumps(identified_section(measured, described, "2026-01-02")))
    identified = Identified.model_validate(section.unwrap())
    found = identified_rests(described.model_copy(update={"identified": identified}))
    assert found.vectors_mm == pytest.approx(vectors_mm, abs=1e-4)
    assert ("middle_mm" in section) == (segments > 1)
    # Files of before have M2 alone, of one segment beside the same tip.
    first_mm = tuple(map(tuple, vectors_mm[:, 0].tolist()))
    older = identified.model_copy(update={"middle_mm": first_mm})
    found = identified_rests(described.model_copy(update={"identified": older}))
    assert found.vectors_mm[:, 0] == pytest.approx(vectors_mm[:, 0], abs=1e-4)
    assert found.tip_mm == pytest.approx(vectors_mm[:, -1], abs=1e-4)
    assert np.isnan(found.vectors_mm[:, 1:-1]).all()


@pytest.mark.parametrize("row", [(1.0, 2.0), (1.0, 2.0, 3.0, 4.0, 5.0, 6.0)])
def test_places_of_the_middle_are_whole_and_as_many_at_each_rest(row):
    kept = _identified().identified.model_dump()
    kept["middle_mm"] = (row, *kept["middle_mm"][1:])
    with pytest.raises(ValidationError, match=r"identified\.middle_mm"):
        Identified.model_validate(kept)


def test_rests_of_which_no_times_are_known_are_kept_without():
    measured = replace(_rests(), time_s=np.full(20, np.nan))
    assert "time_s" not in identified_section(measured, BELIEVED, "2026-01-02")


@pytest.mark.parametrize(
    ("section", "change"),
    [
        ("robot", {"marker_offset_mm": 14.0}),
        ("servo", {"neutral_pulse_us": (1510.0, 1500.0)}),
    ],
)
def test_rests_of_another_robot_are_refused(section, change):
    other = _identified().model_copy(
        update={section: getattr(BELIEVED, section).model_copy(update=change)}
    )
    with pytest.raises(ConfigError, match="identify again"):
        make_controller("adaptive", other)


def test_limits_may_change_after_identification():
    narrow = BELIEVED.servo.model_copy(update={"angle_max_deg": (60.0, 60.0)})
    make_controller("adaptive", _identified().model_copy(update={"servo": narrow}))


def _end_of_approach(controller):
    """Where an approach without any measurement leads, and when it is over."""
    q_rad, time_us = np.zeros(2), 0
    while (command := controller.approach(Observation(0, time_us, None, 0, q_rad))) is not None:
        q_rad, time_us = command.q_rad, time_us + 50_000
    return controller.step(Observation(0, time_us, None, 0, q_rad)), time_us


@pytest.mark.long
def test_an_identified_robot_is_known_without_a_tour():
    controller = make_controller("adaptive", _identified())
    model, limits = ConstantCurvature(BELIEVED.robot), MotorLimits.of(BELIEVED.servo)
    controller.start(load_path("8shape", 1.0, Workspace(model, limits)))
    command, duration_us = _end_of_approach(controller)
    there = Rests.in_turn(np.zeros(2), command.q_rad[None], np.zeros((1, 3, 3)), np.ones(1))
    known_mm, prior_mm = (predicted_mm(p, there)[0, 1] for p in (TRUTH, PRIOR))
    off_prior_mm = np.linalg.norm(prior_mm - known_mm)
    assert duration_us < 5_000_000
    assert np.linalg.norm(command.predicted_mm - known_mm) < 0.3 < off_prior_mm


def test_rests_of_no_such_robot_are_not_kept():
    measured = _rests()
    upside_down = measured.turned(-np.eye(3))
    for rests in (upside_down, _rests(count=5)):
        with pytest.raises(TrackerError, match="do not fit the described robot"):
            trial_fit(rests, BELIEVED)
