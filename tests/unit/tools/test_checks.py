"""Findings of the doctor on deficient boards and robots."""

import datetime
from pathlib import Path

import numpy as np
import pytest
import tomlkit

from ccr_host.control.adaptive.model import tour_bending_rad
from ccr_host.control.adaptive.motion import predicted_mm
from ccr_host.control.adaptive.parameters import COUNT, Scaling
from ccr_host.control.adaptive.statics import unhindered_setpoints_for
from ccr_host.core.clock import VirtualClock
from ccr_host.description import schema
from ccr_host.description.schema import Description
from ccr_host.link.board_config import board_config
from ccr_host.link.client import Client
from ccr_host.link.messages import Capabilities, ResetCause
from ccr_host.robot.rests import Rests
from ccr_host.run.open_rig import mismatch_of
from ccr_host.run.options import RigOptions
from ccr_host.sim.board import dispatch
from ccr_host.sim.board.board import SerialLine, UnoEmulator
from ccr_host.tools.checks import Finding, Severity, exit_status
from ccr_host.tools.doctor import check_board, examine
from ccr_host.tools.survey import identified_section


def examined(tmp_path, *overrides: str, **options: str) -> dict[str, Finding]:
    wanted = RigOptions(overrides=overrides, **options)
    return {finding.subject: finding for finding in examine(wanted, tmp_path)}


def test_the_twin_on_the_emulated_board_is_fit_for_a_run(tmp_path) -> None:
    findings = examined(tmp_path)
    assert exit_status(findings.values()) == 0
    about_this_computer = {"disk", "timing"}
    assert {
        subject for subject, found in findings.items() if found.severity is not Severity.GOOD
    } <= about_this_computer
    assert {"board", "state", "EEPROM", "link", "rate", "noise"} <= findings.keys()


def test_a_board_of_older_firmware_is_fit_for_a_run_and_said_to_be_older(
    tmp_path, monkeypatch
) -> None:
    assert "older" not in examined(tmp_path)["board"].text
    monkeypatch.setattr(dispatch, "CAPABILITIES", Capabilities.EEPROM)
    board = examined(tmp_path)["board"]
    assert board.severity is Severity.GOOD
    assert "older than this host, without timed_targets: ccr-host flash" in board.text


def test_the_led_blinks_where_that_was_asked_for(tmp_path) -> None:
    findings = list(examine(RigOptions(), tmp_path, blink=True))
    assert [f.severity for f in findings if f.subject == "LED"] == [Severity.GOOD]
    assert "LED" not in examined(tmp_path)


def test_a_missing_board_does_not_hide_the_tracker(tmp_path) -> None:
    findings = examined(tmp_path, device="serial:/dev/nowhere")
    assert findings["board"].severity is Severity.FAILURE
    assert findings["board"].remedy
    assert exit_status(findings.values()) == 3
    assert findings["rate"].severity is Severity.GOOD


def test_a_missing_tracker_does_not_hide_the_board(tmp_path) -> None:
    findings = examined(tmp_path, tracker="ndi:/dev/nowhere")
    assert findings["tracker"].severity is Severity.FAILURE
    assert findings["state"].severity is Severity.GOOD
    assert exit_status(findings.values()) == 3


@pytest.mark.parametrize("override", ["twin.nonsense=1", "robot.tendon_radius_mm=-1"])
def test_an_unusable_description_is_a_failure_of_usage(tmp_path, override) -> None:
    findings = examined(tmp_path, override)
    assert findings["description"].severity is Severity.FAILURE
    assert exit_status(findings.values()) == 2


@pytest.mark.long
@pytest.mark.parametrize(
    ("override", "subject"),
    [
        ("tracker.dropout=0.5", "rate"),
        ("tracker.rotation_deg=100", "orientation"),
        ("tracker.rotation_deg=[12,0,0]", "orientation"),
        ("tracker.rotation_deg=[0,0,12]", "orientation"),
        ("tracker.latency_ms=400", "age"),
    ],
)
def test_a_poor_camera_is_warned_of_with_a_remedy(tmp_path, override, subject) -> None:
    found = examined(tmp_path, override)[subject]
    assert found.severity is Severity.WARNING
    assert found.remedy


def test_a_tracker_that_repeats_its_picture_does_not_pass_for_one_without_noise(tmp_path) -> None:
    rounds = Path(__file__).parents[3] / "examples" / "own_tracker.py"
    found = examined(tmp_path, tracker=f"{rounds}:CoarseCamera")["noise"]
    assert found.severity is Severity.WARNING
    assert "repeats one picture, or rounds" in found.text
    assert "ccr-host monitor" in found.remedy
    assert examined(tmp_path, "tracker.noise_mm=0")["noise"].severity is Severity.GOOD


@pytest.mark.long
@pytest.mark.parametrize("segment", [0, 1])
@pytest.mark.parametrize("factor", [0.73, 1.2])
def test_a_segment_of_another_length_than_described_is_warned_of(tmp_path, segment, factor) -> None:
    lengths_mm = [58.5, 43.5]
    lengths_mm[segment] *= factor
    described = f"robot.segment_lengths_mm={lengths_mm}"
    found = examined(tmp_path, described, "twin.segment_lengths_mm=[58.5, 43.5]")["scale"]
    assert found.severity is Severity.WARNING
    assert f"{lengths_mm[segment]:g}" in found.text
    assert examined(tmp_path, described)["scale"].severity is Severity.GOOD


def test_a_robot_that_hangs_the_other_way_is_warned_of(tmp_path) -> None:
    upside_down = "twin.gravity_m_s2=-9.81"
    assert examined(tmp_path, upside_down)["orientation"].severity is Severity.WARNING
    described = examined(tmp_path, upside_down, "robot.gravity_direction=[0,0,1]")
    assert described["orientation"].severity is Severity.GOOD


@pytest.mark.parametrize(
    "override",
    [
        "servo.neutral_pulse_us=[1540, 1500]",
        "servo.pulse_per_90_deg_us=[1000, -1000]",
        "servo.angle_max_deg=60",
        "servo.slew_deg_s=100",
    ],
)
def test_a_board_that_keeps_another_calibration_than_described_is_warned_of(override) -> None:
    clock = VirtualClock()
    board = UnoEmulator()
    line = SerialLine(board)
    clock.attach(line)
    kept = schema.load(None, [override])
    with Client(line, clock, 1) as client:
        client.connect()
        client.configure(board_config(kept))
        client.save_config()
        board.reset(ResetCause.POWER_ON)
    with Client(line, clock, 2) as client:
        client.connect()
        found, same = (
            next(f for f in check_board(client, clock, belief) if f.subject == "configuration")
            for belief in (Description(), kept)
        )
    assert found.severity is Severity.WARNING
    assert override.partition("=")[0] in found.text
    assert same.severity is Severity.GOOD


def test_a_simulated_robot_behind_a_real_board_is_warned_of(tmp_path) -> None:
    found = examined(tmp_path, device="tcp://127.0.0.1:1")["device and tracker"]
    assert found.severity is Severity.WARNING
    assert "simulated" in found.text


def test_a_real_camera_with_a_simulated_board_is_reported() -> None:
    assert "simulated board" in mismatch_of(RigOptions(tracker="igtl://127.0.0.1:1"))
    assert mismatch_of(RigOptions(device="serial:/dev/ttyACM0", tracker="ndi:/dev/ttyUSB0")) == ""
    assert mismatch_of(RigOptions(device="emulator+pty:", tracker="ndi-emulator:")) == ""


def test_a_stopped_board_is_a_failure_and_stays_stopped() -> None:
    clock = VirtualClock()
    line = SerialLine(UnoEmulator())
    clock.attach(line)
    with Client(line, clock, 1) as client:
        client.connect()
        client.stop()
        for _ in range(2):
            findings = list(check_board(client, clock, Description()))
            assert exit_status(findings) == 3
            assert "stopped" in next(f.text for f in findings if f.subject == "state")


def _robot_with_rests(folder: Path, off_mm: float) -> str:
    """A description with rests of its model, each displaced at random."""
    description = Description()
    p = Scaling.of(description).parameters(np.zeros(COUNT))
    stops_rad = unhindered_setpoints_for(p, tour_bending_rad())
    count = np.full(len(stops_rad), 20.0)
    rests = Rests.in_turn(np.zeros(2), stops_rad, np.empty(0), count)
    vectors_mm = predicted_mm(p, rests)
    vectors_mm += off_mm * np.random.default_rng(1).standard_normal(vectors_mm.shape)
    seen = Rests.of_vectors(rests.from_rad, stops_rad, vectors_mm, count)
    section = identified_section(seen, description, datetime.date(2026, 1, 2))
    file = folder / "robot.toml"
    file.write_text(tomlkit.dumps({"identified": section, "control": {"solver": "compiled"}}))
    return str(file)


@pytest.mark.long
def test_identified_rests_are_compared_with_the_noise(tmp_path) -> None:
    usual = examined(tmp_path, robot=_robot_with_rests(tmp_path, 0.25))["identification"]
    assert usual.severity is Severity.GOOD
    assert "times what noise and usual errors make" in usual.text
    odd = examined(tmp_path, robot=_robot_with_rests(tmp_path, 2.0))["identification"]
    assert odd.severity is Severity.WARNING
    assert "does not explain the robot" in odd.text
    assert "calibrate --identify" in odd.remedy


def test_rests_of_another_robot_are_a_failure(tmp_path) -> None:
    robot = _robot_with_rests(tmp_path, 0.25)
    found = examined(tmp_path, "robot.pulley_radius_mm=11", robot=robot)["identification"]
    assert found.severity is Severity.FAILURE


@pytest.mark.parametrize("robot", ["single", "two-spatial", "three-spatial"])
def test_a_robot_of_any_kind_that_is_turned_at_rest_is_noticed(tmp_path, robot: str) -> None:
    assert examined(tmp_path, robot=robot)["orientation"].severity is Severity.GOOD
    turned = examined(tmp_path, "tracker.rotation_deg=[0,0,30]", robot=robot)["orientation"]
    assert turned.severity is Severity.WARNING
    assert "30 deg away from its model" in turned.text
