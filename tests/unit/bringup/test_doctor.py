"""What the doctor finds, on boards and robots that lack something."""

import pytest

from ccr_host.bringup.board_checks import check_board
from ccr_host.bringup.doctor import examine
from ccr_host.bringup.finding import Finding, Severity, exit_status
from ccr_host.config import Description
from ccr_host.emulator.board import UnoEmulator
from ccr_host.emulator.serial_line import SerialLine
from ccr_host.link.client import Client
from ccr_host.run.clock import VirtualClock
from ccr_host.run.options import RigOptions


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


@pytest.mark.parametrize(
    ("override", "subject"),
    [
        ("tracker.dropout=0.5", "rate"),
        ("tracker.rotation_deg=100", "orientation"),
        ("tracker.latency_ms=400", "age"),
    ],
)
def test_a_poor_camera_is_warned_of_with_a_remedy(tmp_path, override, subject) -> None:
    found = examined(tmp_path, override)[subject]
    assert found.severity is Severity.WARNING
    assert found.remedy


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
