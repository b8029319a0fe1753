"""Calibration of a robot with misaligned servos, one of them reversed."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from ccr_host.description import schema
from ccr_host.record.log import topics
from tests.system.conftest import PATIENT_BOARD, CcrHost, logged
from tests.system.driven_terminal import DOWN, LEFT, RIGHT, UP, DrivenTerminal

NEUTRAL_US = (1540.0, 1475.0)
PER_90_DEG_US = (950.0, -1050.0)
TWIN = (f"twin.servo_neutral_us={[*NEUTRAL_US]}", f"twin.servo_us_per_90_deg={[*PER_90_DEG_US]}")
STEPS_DEG = (10.0, 5.0, 2.0, 1.0, 0.5, 0.1)
KEYS = ((UP, DOWN), (RIGHT, LEFT))


@pytest.fixture
def robot(tmp_path: Path) -> Path:
    file = tmp_path / "robot.toml"
    file.write_text('name = "mine"  # keep this\n')
    return file


@pytest.fixture
def calibrated(tmp_path: Path) -> Path:
    """Not there yet."""
    return tmp_path / "calibrated.toml"


@pytest.fixture
def terminal(tmp_path: Path, robot: Path, calibrated: Path) -> Iterator[DrivenTerminal]:
    files = ("--robot", robot.name, "--out", calibrated.name)
    overrides = [word for key in TWIN for word in ("--set", key)]
    terminal = DrivenTerminal(tmp_path, "calibrate", "--by-eye", *files, *overrides, *PATIENT_BOARD)
    yield terminal
    terminal.kill()


def keys_for(axis: int, motion_deg: float) -> str:
    """Move with steps from 10 deg down to 0.1 deg and back."""
    forwards, backwards = KEYS[axis]
    keys, left_deg = "", abs(motion_deg)
    for step_deg in STEPS_DEG:
        count = int(left_deg / step_deg + 1e-6)
        left_deg -= count * step_deg
        keys += (forwards if motion_deg > 0 else backwards) * count + "-"
    return keys + "+" * len(STEPS_DEG)


def test_marks_by_eye_are_saved_in_file_and_board(
    terminal: DrivenTerminal, robot: Path, calibrated: Path
) -> None:
    terminal.wait_for("1 of 10")
    terminal.press("+" * len(STEPS_DEG))
    asked = 1
    for axis in (0, 1):
        here_deg = 0.0
        for horn_deg in (0.0, 45.0, -45.0, -70.0, 60.0):
            pulse_us = NEUTRAL_US[axis] + PER_90_DEG_US[axis] * horn_deg / 90
            there_deg = round((pulse_us - 1500.0) * 0.09, 1)
            terminal.press(keys_for(axis, there_deg - here_deg))
            terminal.wait_for(rf"motor {axis + 1} +{there_deg:.2f} +{there_deg:.2f} ")
            here_deg = there_deg
            terminal.press("\r")
            asked += 1
            terminal.wait_for(f"{asked} of 10" if asked <= 10 else "saved in")
    terminal.end()
    assert terminal.status == 0
    servo = schema.load(str(calibrated)).servo
    assert calibrated.read_text().startswith('name = "mine"  # keep this\n')
    assert robot.read_text() == 'name = "mine"  # keep this\n'
    assert servo.neutral_pulse_us == pytest.approx(NEUTRAL_US, abs=1.5)
    assert servo.pulse_per_90_deg_us == pytest.approx(PER_90_DEG_US, abs=3.0)
    assert servo.angle_min_deg == pytest.approx((-70.0, -70.0), abs=0.3)
    assert servo.angle_max_deg == pytest.approx((60.0, 60.0), abs=0.3)


def test_leaving_early_changes_nothing(
    terminal: DrivenTerminal, robot: Path, calibrated: Path
) -> None:
    terminal.wait_for("1 of 10")
    terminal.press("\r")
    terminal.wait_for("2 of 10")
    terminal.press("q")
    assert "nothing changed" in terminal.end()
    assert terminal.status == 0
    assert robot.read_text() == 'name = "mine"  # keep this\n'
    assert not calibrated.exists()


def test_a_shipped_description_is_not_written_to(ccr_host: CcrHost) -> None:
    ended = ccr_host("calibrate", "--by-eye", "--robot", "hard")
    assert ended.status == 2
    assert "no description of yours" in ended.err


def test_an_identified_robot_is_followed_without_a_tour(
    ccr_host: CcrHost, robot: Path, short_path: str
) -> None:
    loop = robot.with_name("loop.csv")
    loop.write_text("t_s,y_mm,z_mm\n0,0,50\n8,15,50\n16,0,35\n24,-15,50\n32,0,50\n")
    registered = {"camera_to_robot_deg": [0, 0, 0], "uncertainty_deg": [0.28, 0.07, 0.14]}
    lines = ["[registration]", *(f"{key} = {value}" for key, value in registered.items())]
    robot.write_text(robot.read_text() + "\n".join(lines) + "\n")
    compiled = ("--set", "control.solver=compiled")
    ended = ccr_host("calibrate", "--identify", "--robot", robot.name, *compiled)
    assert ended.status == 0, ended.err
    assert "# keep this" in robot.read_text()

    def track(out: str, path: str, *words: str) -> tuple[float, float]:
        common = (*compiled, "--no-open", "--json", "--out", out)
        summary = ccr_host("track", path, *common, *words).summary
        noted_s = {
            content["message"]: content["timestamp"]["sec"] + content["timestamp"]["nsec"] * 1e-9
            for content in logged(ccr_host.folder / out, topics.EVENT)
        }
        approach_s = noted_s["following the path"] - noted_s["arming"]
        return approach_s, summary["true_mean_error_mm"]

    keys = [f"registration.{key}={value}" for key, value in registered.items()]
    words = [word for key in keys for word in ("--set", key)]
    tour_s, toured_mm = track("toured", str(loop), *words)
    _, identified_mm = track("identified", str(loop), "--robot", robot.name)
    approach_s, _ = track("unchecked", short_path, "--robot", robot.name, "--unchecked")
    assert approach_s < 5.0
    assert tour_s > 20.0
    assert identified_mm < 1.05 * toured_mm
    changed = ("--robot", robot.name, "--set", "robot.marker_offset_mm=14")
    refused = ccr_host("track", "8shape", "--controller", "adaptive", *changed)
    assert refused.status == 2
    assert "identify again" in refused.err


def test_one_tour_finds_servos_camera_and_rests_for_the_first_path(
    ccr_host: CcrHost, robot: Path, short_path: str
) -> None:
    true = (*TWIN, "tracker.rotation_deg=[40,-100,70]", "control.solver=compiled")
    overrides = [word for key in true for word in ("--set", key)]
    ended = ccr_host("calibrate", "--robot", robot.name, *overrides)
    assert ended.status == 0, ended.err
    found = schema.load(str(robot))
    assert found.servo.neutral_pulse_us == pytest.approx(NEUTRAL_US, abs=15.0)
    assert np.sign(found.servo.pulse_per_90_deg_us).tolist() == [1.0, -1.0]
    assert found.registration is not None
    followed = ccr_host(
        "track", short_path, "--no-open", "--json", "--robot", robot.name, *overrides
    )
    assert followed.summary["true_mean_error_mm"] < 1.5


def test_the_eye_cannot_identify(ccr_host: CcrHost, robot: Path) -> None:
    assert ccr_host("calibrate", "--by-eye", "--identify", "--robot", robot.name).status == 2


@pytest.mark.parametrize("command", [["calibrate"], ["calibrate", "--identify"], ["register"]])
def test_a_real_board_is_not_fitted_to_the_simulated_robot_by_default(
    ccr_host: CcrHost, robot: Path, command: list[str]
) -> None:
    common = ("--robot", robot.name, "--device", "tcp://127.0.0.1:1")
    ended = ccr_host(*command, *common)
    assert ended.status == 2
    assert "--tracker" in ended.err
    assert "refused" in ccr_host(*command, *common, "--tracker", "twin:").err
    assert robot.read_text() == 'name = "mine"  # keep this\n'
