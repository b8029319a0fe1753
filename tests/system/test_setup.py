"""Setup of a new robot up to its first path: servos reversed and off by 8 deg, camera rotated."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.system.conftest import CcrHost
from tests.system.driven_terminal import DrivenTerminal

ROBOT = (
    "tracker.rotation_deg=[40,-100,70]",
    "twin.servo_neutral_us=[1589,1411]",
    "twin.servo_us_per_90_deg=[-1000,-1000]",
    "control.solver=compiled",
)
OVERRIDES = [word for key in ROBOT for word in ("--set", key)]
EIGHT = ("track", "8shape", "--no-open", "--robot", "mine.toml", *OVERRIDES, "--json")


@pytest.mark.parametrize(
    "ends",
    [
        ("--device", "emulator:", "--tracker", "twin:"),
        pytest.param(
            ("--device", "emulator+pty:", "--tracker", "ndi-emulator:"), marks=pytest.mark.slow
        ),
    ],
)
def test_a_new_robot_is_set_up_and_finished_steps_are_not_repeated(
    tmp_path: Path, ends: tuple[str, ...]
) -> None:
    words = ("setup", "--robot", "mine.toml", *ends, *OVERRIDES)
    stopped = DrivenTerminal(tmp_path, *words)
    stopped.wait_for("measure camera and servos .Enter starts")
    stopped.press("\r")
    assert "motor 1 and 2" in stopped.wait_for("measuring again")
    stopped.press("\x03")
    stopped.end()
    assert stopped.status == 130

    first = DrivenTerminal(tmp_path, *words)
    first.wait_for("measure camera and servos .Enter starts")
    first.press("\r")
    assert "measuring again" not in first.wait_for("as described")
    first.wait_for("saved in mine.toml: camera and rests")
    first.wait_for("Enter starts")
    first.press("\r")
    assert "is set up: ccr-host track 8shape --robot mine.toml" in first.end()
    assert first.status == 0
    before = (tmp_path / "mine.toml").read_bytes()

    again = DrivenTerminal(tmp_path, *words)
    again.wait_for("done before; Enter continues")
    again.press("\r")
    again.wait_for("Enter starts, s skips")
    again.press("s\r")
    assert "poses" not in again.end()
    assert again.status == 0
    assert (tmp_path / "mine.toml").read_bytes() == before

    followed = CcrHost(tmp_path)(*EIGHT, timeout_s=600)
    assert followed.summary["true_mean_error_mm"] < 0.8


def test_rests_that_no_longer_fit_the_description_are_measured_again(tmp_path: Path) -> None:
    (tmp_path / "mine.toml").write_text(
        f"[identified]\nstart_rad = [0, 0]\nsetpoint_rad = {[[0, 0]] * 10}\n"
        f"tip_mm = {[[0, 0, 100]] * 10}\ncount = {[1] * 10}\nvalid_for = '0123456789abcdef'\n"
    )
    words = ("setup", "--robot", "mine.toml", "--tracker", "twin:")
    terminal = DrivenTerminal(tmp_path, *words)
    terminal.wait_for("measure camera and servos .Enter starts")
    terminal.press("\x03")
    terminal.end()
    assert terminal.status == 130


@pytest.mark.long
def test_a_robot_that_bends_in_space_is_set_up_and_follows_its_first_path(
    ccr_host: CcrHost,
) -> None:
    begun = 'name = "mine"\n[robot]\npulley_radius_mm = 8\n[[robot.segments]]\n'
    tendons = ", ".join(f"{{ angle_deg = {120 * n}, motor = {n + 1} }}" for n in range(3))
    begun += f"length_mm = 60\ntendon_radius_mm = 4.5\ntendons = [{tendons}]\n"
    (ccr_host.folder / "mine.toml").write_text(begun)
    wrong = ("tracker.rotation_deg=[40,-100,70]", "twin.servo_us_per_90_deg=[1000,-1000,1000]")
    sets = [word for key in (*wrong, "twin.slack_mm=0.3") for word in ("--set", key)]
    ended = ccr_host("setup", "--yes", "--robot", "mine.toml", *sets, timeout_s=600)
    assert ended.status == 0, ended.err
    assert "motor 2; ccr-host calibrate corrects" in " ".join(ended.out.split())
    assert "is set up: ccr-host track circle --robot mine.toml" in ended.out


def test_without_a_terminal_yes_must_be_given(ccr_host: CcrHost) -> None:
    ended = ccr_host("setup", "--robot", "mine.toml")
    assert ended.status == 2
    assert "give --yes" in ended.err
    assert not (ccr_host.folder / "mine.toml").exists()


def test_a_board_that_does_not_answer_ends_it_and_the_file_stays(ccr_host: CcrHost) -> None:
    words = ("setup", "--yes", "--robot", "mine.toml", "--tracker", "twin:")
    ended = ccr_host(*words, "--device", "tcp://127.0.0.1:9")
    assert ended.status == 3
    assert "start again: setup continues here" in ended.out
    assert (ccr_host.folder / "mine.toml").read_text() == 'name = "mine"\n'


def test_a_segment_that_no_motor_bends_ends_it_with_the_cause(ccr_host: CcrHost) -> None:
    words = ("setup", "--yes", "--robot", "mine.toml", "--set", "twin.servo_rate_deg_s=0.01")
    ended = ccr_host(*words)
    assert ended.status == 3
    assert "motor 1 moved M3 by" in ended.err.strip().splitlines()[-1]
    assert (ccr_host.folder / "mine.toml").read_text() == 'name = "mine"\n'
