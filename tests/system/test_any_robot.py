"""Robots of one, four and nine motors, from the run to all that is made of it."""

from __future__ import annotations

import json
from pathlib import Path

import gymnasium
import numpy as np
import pytest
from viser import ViserServer

import ccr_host
import ccr_host.tools.gym
from ccr_host.commands.jog import jog_panel
from ccr_host.core.errors import DeviceError
from ccr_host.core.plugins import Given
from ccr_host.record.export import Format, export, finish_log, write_mat
from ccr_host.record.folder import ResultFolder
from ccr_host.record.keep import execute_logged, keep_result
from ccr_host.record.log import topics
from ccr_host.record.log.reader import RunRecording, play_run
from ccr_host.record.replay import replay
from ccr_host.record.report import write_report
from ccr_host.record.ros_bag import urdf_of, write_bag
from ccr_host.run.observer import Observers
from ccr_host.run.open_rig import open_rig
from ccr_host.run.options import RigOptions, RunOptions
from ccr_host.run.summary import summarise
from ccr_host.tools.jog import LEFT, UP, JogView, jog
from ccr_host.view.history import RunHistory
from ccr_host.view.live import ViewAddress, open_door
from ccr_host.view.page import Page
from ccr_host.view.page_server import in_servers_thread, page_server
from examples.own_plant import ConstantCurvaturePlant
from tests.conformance.firmware_build import firmware_elf

ROBOTS = {"single": 1, "two-spatial": 4, "three-spatial": 9}
QUICK = ("control.settle_s=0.1", "link.arm_axis_ms=20", "tracker.noise_mm=0")


@pytest.fixture(scope="module", params=ROBOTS)
def robot(request: pytest.FixtureRequest) -> str:
    name: str = request.param
    return name


@pytest.fixture(scope="module")
def run(robot: str, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Folder of a run of two seconds."""
    folder = tmp_path_factory.mktemp(robot)
    path = folder / "short.csv"
    path.write_text("t_s,y_mm,z_mm\n0,0,0\n2,0,4\n")
    options = RunOptions(
        path=str(path),
        controller="open-loop",
        robot=robot,
        plant=Given(ConstantCurvaturePlant),
        rate_hz=5.0,
        overrides=QUICK,
        checks="none",
    )
    with ResultFolder(folder / "run", "run") as kept:
        result = execute_logged(options, kept.path, lambda *_: None)
        assert result.failure is None
        keep_result(kept, result, None)
    return folder / "run"


def test_the_tip_is_where_the_plant_has_it(run: Path) -> None:
    summary = ccr_host.load_run(run).summary
    assert summary["steps"] == 11
    assert summary["true_mean_error_mm"] == pytest.approx(summary["floor_mean_error_mm"], abs=0.2)
    assert summary["mean_error_mm"] == pytest.approx(summary["true_mean_error_mm"], abs=0.2)


def test_its_log_has_the_robot_in_its_schemas_and_is_replayed(run: Path, robot: str) -> None:
    recording = RunRecording(run)
    assert recording.description.robot.motors == ROBOTS[robot]
    schemas = {topic.name: topic.schema for topic in recording.topics}
    asked = schemas[topics.STEP.name]["properties"]["q_rad"]
    assert asked["minItems"] == asked["maxItems"] == ROBOTS[robot]
    assert replay(recording).difference is None


def test_every_table_has_a_column_for_each_motor_and_marker(
    run: Path, robot: str, tmp_path: Path
) -> None:
    recording = RunRecording(run)
    steps = ccr_host.load_run(run).steps
    assert [name for name in steps if name.startswith("q_")] == [
        f"q_{motor}_rad" for motor in range(1, ROBOTS[robot] + 1)
    ]
    samples = ccr_host.load_run(run).table("samples")
    last = recording.description.robot.markers[-1].lower()
    assert {f"{last}_x_mm", "m1_z_mm"} < {*samples}
    assert np.isfinite(samples[f"{last}_x_mm"]).any()
    for form in Format:
        assert all(count for _, count in export(recording, form, tmp_path))
    write_mat(recording, tmp_path)
    assert write_bag(recording, tmp_path)["/ccr/servo_jp"]
    assert urdf_of(recording.description).count("<cylinder") == len(
        recording.description.robot.chain
    )
    finished = tmp_path / "finished"
    finished.mkdir()
    assert finish_log(recording, finished) == len(list(recording.messages()))


def test_report_and_page_draw_it(run: Path, robot: str, tmp_path: Path) -> None:
    write_report([run], tmp_path / "report.html")
    assert f"motor {ROBOTS[robot]}" in (tmp_path / "report.html").read_text(encoding="utf-8")
    history = RunHistory()
    play_run(run, history)
    door = open_door(ViewAddress("127.0.0.1", 0))
    with page_server(door) as server:

        def draw(server: ViserServer) -> None:
            page = Page(server, history, None)
            page.draw(0, 0.0, 0)

        in_servers_thread(server, draw, server)
    moment = history.at(history.end_us)
    assert moment.board is not None
    assert len(moment.board.setpoint_rad) == len(moment.board.pulses_us) == ROBOTS[robot]


def test_keys_and_programs_move_each_motor(robot: str) -> None:
    options = RigOptions(robot=robot, plant=Given(ConstantCurvaturePlant), overrides=QUICK)
    description = options.description()
    keys, seen = [UP, str(-(-ROBOTS[robot] // 2)), UP, LEFT, "", "", "q"], list[JogView]()
    with open_rig(options, description, Observers()) as rig:
        jog(rig, description, lambda: [keys.pop(0)] if keys else ["q"], seen.append)
    moved = np.flatnonzero(seen[-1].target.q_rad)
    assert moved.max() == ROBOTS[robot] - 1
    assert len(seen[-1].report.setpoint_cdeg if seen[-1].report else ()) == ROBOTS[robot]
    jog_panel(seen[-1], simulated_tip=False)
    wanted_deg = np.linspace(-5.0, 5.0, ROBOTS[robot])
    with ccr_host.open_robot(
        robot=robot, plant=ConstantCurvaturePlant, overrides=QUICK
    ) as connected:
        connected.arm()
        connected.move(wanted_deg)
        np.testing.assert_allclose(connected.angles_deg, wanted_deg, atol=0.01)
        assert connected.tip_mm().shape == (3,)


@pytest.mark.parametrize(
    ("robot", "board", "motors"), [("two-spatial", "mega2560", 4), ("three-spatial", "mega2560", 9)]
)
def test_the_firmware_of_a_mega_drives_the_first_of_its_axes(
    robot: str, board: str, motors: int, tmp_path: Path
) -> None:
    path = tmp_path / "short.csv"
    path.write_text("t_s,y_mm,z_mm\n0,0,0\n1,0,4\n")
    options = RunOptions(
        path=str(path),
        controller="open-loop",
        robot=robot,
        plant=Given(ConstantCurvaturePlant),
        device=f"simavr:{firmware_elf(board=board)}",
        rate_hz=5.0,
        overrides=QUICK,
        checks="none",
    )
    result = execute_logged(options, tmp_path, lambda *_: None)
    assert result.failure is None
    figures = summarise(result)
    assert figures["true_mean_error_mm"] == pytest.approx(figures["floor_mean_error_mm"], abs=0.3)
    recording = RunRecording(tmp_path)
    states = [one.content for one in recording.messages(topics.STATE)]
    assert {len(state["pulse_half_us"]) for state in states} == {motors}
    assert replay(recording).difference is None


def test_a_board_with_too_few_axes_is_refused_with_the_board_that_has_them(tmp_path: Path) -> None:
    path = tmp_path / "short.csv"
    path.write_text("t_s,y_mm,z_mm\n0,0,0\n1,0,4\n")
    options = RunOptions(
        path=str(path),
        controller="open-loop",
        robot="two-spatial",
        plant=Given(ConstantCurvaturePlant),
        device=f"simavr:{firmware_elf()}",
    )
    failure = execute_logged(options, tmp_path, lambda *_: None).failure
    assert isinstance(failure, DeviceError)
    assert "drives 2 servos, the described robot has 4 motors" in failure.cause
    assert "flash --board mega2560" in failure.cure


def test_an_environment_has_an_action_for_each_motor(robot: str, run: Path) -> None:
    path = json.loads((run / "run.json").read_text(encoding="utf-8"))["options"]["path"]
    env = gymnasium.make(
        "ccr_host/Track-v0", robot=robot, plant=Given(ConstantCurvaturePlant), path=path
    )
    assert env.action_space.shape == (ROBOTS[robot],)
    seen, _ = env.reset(seed=1)
    assert seen.shape == env.observation_space.shape
    seen, reward, *_ = env.step(env.action_space.sample())
    assert env.observation_space.contains(seen)
    assert reward < 0
    env.close()
