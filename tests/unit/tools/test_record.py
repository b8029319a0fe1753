"""Recording the simulated robot, and what is left of a recording that ends early."""

from __future__ import annotations

import datetime
import shutil
import tempfile
from pathlib import Path

import numpy as np
import pytest

from ccr_host.core.errors import CcrError, ConfigError
from ccr_host.description.schema import Description
from ccr_host.link.messages import State, StateReport
from ccr_host.robot.workspace import MotorLimits
from ccr_host.run.observer import Observers, RunObserver
from ccr_host.run.open_rig import open_rig
from ccr_host.run.options import RigOptions
from ccr_host.tools.identify import identify
from ccr_host.tools.measured import FEWEST_ROWS, Measured, home_of, read_measured, sweeps_of
from ccr_host.tools.record import PATTERNS, Stops, new_table, record_rests, stops_of

SLACK_MM = (0.9, 1.4, 0.9, 1.4)
"""Motors of both tendons on one side of the robot, then of both on the other."""
OPTIONS = RigOptions(
    robot="ideal", overrides=(f"twin.slack_mm={[*SLACK_MM]}", "control.solver=compiled")
)
DESCRIPTION = OPTIONS.description()
REST = np.arange(27.0).reshape(3, 3, 3)


class LastState(RunObserver):
    """Keeps what the board said last."""

    report: StateReport | None = None

    def state(self, time_us: int, report: StateReport) -> None:
        self.report = report


def measured_at(stops: Stops) -> Measured:
    nowhere_mm = np.zeros((len(stops.q_rad), 3))
    time_s = np.arange(float(len(stops.q_rad)))
    below_mm, pattern = nowhere_mm[:, None], np.array(stops.pattern)
    return Measured(time_s, stops.q_rad, "rad", nowhere_mm, below_mm, pattern)


def recorded(options: RigOptions, stops: Stops, folder: Path) -> Measured:
    description, file = options.description(), folder / "recorded.csv"
    with (
        new_table(file, description.robot) as table,
        open_rig(options, description, Observers()) as rig,
    ):
        record_rests(rig, description, stops, table, lambda *_: None)
    return read_measured(file)


@pytest.mark.long
def test_what_is_recorded_can_be_identified_as_it_is(tmp_path: Path) -> None:
    stops = stops_of(DESCRIPTION, ["multisine", "random"], 12, seed=1)
    measured = recorded(OPTIONS, stops, tmp_path)
    assert measured.pattern.tolist() == ["random"] * 12 + ["multisine"] * 12
    np.testing.assert_allclose(measured.command, stops.q_rad, atol=1e-5)
    found = identify(DESCRIPTION, measured, date=datetime.date(2026, 11, 27))
    assert found.held_out.median_mm < 1.0
    of = {p.name: p for p in found.parameters}
    for motor in (1, 2):
        slack = of[f"slack_{motor}_rad"]
        true_rad = SLACK_MM[motor - 1] / DESCRIPTION.robot.pulley_radius_mm
        assert slack.identified
        assert slack.value == pytest.approx(true_rad, abs=3.0 * slack.deviation)


@pytest.mark.long
def test_markers_of_a_robot_that_bends_in_space_are_where_they_are_described(
    tmp_path: Path,
) -> None:
    options = RigOptions(robot="two-spatial")
    description = options.description()
    measured = recorded(options, stops_of(description, ["random"], 24, seed=1), tmp_path)
    found = identify(description, measured, date=datetime.date(2026, 11, 29))
    markers = [p for p in found.parameters if p.name.startswith("marker")]
    assert len(markers) == 3
    for place in markers:
        assert abs(place.value) < 2.0 * place.prior_deviation, place.name


@pytest.mark.long
def test_an_interrupted_recording_keeps_its_rests_and_disarms(tmp_path: Path) -> None:
    stops, board = stops_of(DESCRIPTION, [], 12, seed=1), LastState()
    file = tmp_path / "recorded.csv"
    on_disk = []

    def interrupt(done: int, _: int) -> None:
        on_disk.append(len(file.read_text().splitlines()) - 1)
        if done == 2:
            raise KeyboardInterrupt

    with (
        pytest.raises(KeyboardInterrupt),
        new_table(file, DESCRIPTION.robot) as table,
        open_rig(OPTIONS, DESCRIPTION, board) as rig,
    ):
        record_rests(rig, DESCRIPTION, stops, table, interrupt)
    assert on_disk == [0, 1, 2]
    assert len(file.read_text().splitlines()) == 3
    assert board.report is not None
    assert board.report.state is State.DISARMED


@pytest.mark.parametrize("robot", ["default", "dirty", "hard"])
def test_all_patterns_stay_within_the_limits_and_move_every_motor(robot: str) -> None:
    description = RigOptions(robot=robot).description()
    servo = description.servo
    for name in PATTERNS:
        q_deg = np.degrees(stops_of(description, [name], 24, seed=3).q_rad)
        assert (q_deg >= np.array(servo.angle_min_deg) - 1e-9).all()
        assert (q_deg <= np.array(servo.angle_max_deg) + 1e-9).all()
        assert (np.ptp(q_deg, axis=0) > 10.0).all()


def test_patterns_show_hysteresis_of_every_motor_and_repeatability_at_home() -> None:
    measured = measured_at(stops_of(DESCRIPTION, ["staircase"], 24, seed=1))
    home = home_of(measured)
    assert home is not None
    assert home.visits >= 3
    moving = measured.command.argmax(axis=1)
    assert {0, 1} == set(moving.tolist())
    tips = Measured(
        measured.time_s,
        measured.command,
        "rad",
        100.0 * np.pad(measured.command, ((0, 0), (0, 1))),
        measured.below_mm,
        measured.pattern,
    )
    assert {sweep.motor for sweep in sweeps_of(tips)} == {1, 2}


def test_a_pattern_does_not_depend_on_the_others_but_on_the_seed() -> None:
    alone = stops_of(DESCRIPTION, ["multisine"], 24, seed=1)
    among = stops_of(DESCRIPTION, [], 24, seed=1)
    here = [name == "multisine" for name in among.pattern]
    np.testing.assert_array_equal(alone.q_rad, among.q_rad[here])
    other = stops_of(DESCRIPTION, ["multisine"], 24, seed=2)
    assert not np.allclose(alone.q_rad, other.q_rad)
    with pytest.raises(ConfigError, match="--pattern spiral"):
        stops_of(Description(), ["spiral"], 24, seed=1)


def test_a_full_disk_is_told_in_one_line_although_the_row_stays_in_the_buffer(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    opened = Path.open
    monkeypatch.setattr(Path, "open", lambda *_, **__: opened(Path("/dev/full"), "w"))
    with (
        pytest.raises(CcrError, match=r"No space left on device.*free disk space"),
        new_table(tmp_path / "out.csv", DESCRIPTION.robot),
    ):
        pass


def test_a_file_is_never_overwritten_and_an_empty_one_not_left(tmp_path: Path) -> None:
    file = tmp_path / "recorded.csv"
    with pytest.raises(KeyboardInterrupt), new_table(file, DESCRIPTION.robot):
        raise KeyboardInterrupt
    assert not file.exists()
    with new_table(file, DESCRIPTION.robot) as table:
        table.add(1_000_000, "single", np.zeros(2), REST)
    before = file.read_text()
    with pytest.raises(ConfigError, match="exists"), new_table(file, DESCRIPTION.robot):
        raise AssertionError
    assert file.read_text() == before
    with pytest.raises(ConfigError, match="No such file"), new_table(tmp_path / "no" / "f", 2):
        raise AssertionError


def test_a_table_that_is_removed_in_mid_recording_is_written_again(tmp_path: Path) -> None:
    file = tmp_path / "folder" / "recorded.csv"
    file.parent.mkdir()
    with new_table(file, DESCRIPTION.robot) as table:
        table.add(1_000_000, "single", np.zeros(2), REST)
        shutil.rmtree(file.parent)
        table.add(2_000_000, "single", np.ones(2), REST)
        before = file.read_text()
        file.unlink()
        assert table.settled() == file
    assert file.read_text() == before
    assert before.count("single") == 2


def test_rests_whose_table_is_replaced_are_kept_elsewhere(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    file = tmp_path / "recorded.csv"
    with new_table(file, DESCRIPTION.robot) as table:
        table.add(1_000_000, "single", np.zeros(2), REST)
        file.unlink()
        file.write_text("mine")
        with pytest.raises(CcrError, match=r"recorded\.csv: .*rows until now are in") as told:
            table.add(2_000_000, "single", np.ones(2), REST)
        kept = table.settled()
    assert table.rests == 2
    assert str(kept) in told.value.cure
    assert kept.read_text().count("single") == 2
    assert file.read_text() == "mine"


@pytest.mark.parametrize(
    ("name", "marked"),
    [
        ("single", ["tip"]),
        ("default", ["tip", "middle"]),
        ("two-spatial", ["tip", "middle"]),
        ("three-spatial", ["tip", "m2", "m3"]),
    ],
)
def test_a_row_has_every_marker_as_seen_from_the_first(
    tmp_path: Path, name: str, marked: list[str]
) -> None:
    robot, file = RigOptions(robot=name).description().robot, tmp_path / "recorded.csv"
    q_rad = np.linspace(0.1, 1.0, robot.motors)
    markers_mm = np.random.default_rng(1).normal(size=(5, len(robot.markers), 3))
    with new_table(file, robot) as table:
        for row in range(FEWEST_ROWS):
            table.add(1_000_000 * row, "single", (-1) ** row * q_rad, markers_mm)
    header, first, *_ = (line.split(",") for line in file.read_text().splitlines())
    start = 2 + robot.motors
    assert header[start:-1] == [f"{marker}_{axis}_mm" for marker in marked for axis in "xyz"]
    mean_mm = markers_mm.mean(axis=0)
    expected_mm = np.roll(mean_mm[1:] - mean_mm[0], 1, axis=0)
    np.testing.assert_allclose(np.array(first[start:-1], float), expected_mm.ravel(), atol=1e-4)
    measured = read_measured(file)
    ends_mm = measured.ends_mm(len(robot.chain))
    np.testing.assert_allclose(ends_mm[0], mean_mm[1:] - mean_mm[0], atol=1e-4)


@pytest.mark.parametrize(
    ("name", "motors"), [("single", 1), ("two-spatial", 4), ("three-spatial", 9)]
)
def test_patterns_keep_every_robot_within_its_limits(name: str, motors: int) -> None:
    description = RigOptions(robot=name).description()
    stops = stops_of(description, [], 24, seed=1)
    assert stops.q_rad.shape == (len(stops.pattern), motors)
    assert {*stops.pattern} == {*PATTERNS} - ({"pairs"} if motors == 1 else set())
    limits = MotorLimits.of(description.servo)
    np.testing.assert_array_equal(limits.clip(stops.q_rad), stops.q_rad)
    assert (np.ptp(stops.q_rad, axis=0) > 0.1).all()
    assert stops.pattern.count("release") <= 32


def test_motors_that_cannot_pay_out_stay_at_home_while_others_wind_up() -> None:
    one_way = RigOptions(robot="three-spatial", overrides=("servo.angle_min_deg=0",))
    q_rad = stops_of(one_way.description(), [], 24, seed=1).q_rad
    assert np.isfinite(q_rad).all()
    assert (q_rad >= 0.0).all()
    assert (np.ptp(q_rad, axis=0) > 0.1).all()


def test_no_pose_winds_tendons_against_each_other() -> None:
    """The pulls of three tendons of a segment with a motor each add up to nothing."""
    description = RigOptions(robot="three-spatial").description()
    stops = stops_of(description, [], 24, seed=1)
    of_segments = stops.q_rad.reshape(-1, 3, 3)
    np.testing.assert_allclose(of_segments.sum(axis=2), 0.0, atol=1e-9)
    alone = stops.q_rad[[name == "single" for name in stops.pattern]]
    assert np.degrees(np.abs(alone).max(axis=0)).min() > 40.0
