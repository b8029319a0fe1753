import signal
import sys

import pytest

from ccr_host.link.messages import EEPROM_BOOT_COUNTER
from tests.patience import PATIENCE_S
from tests.system.conftest import IN_REAL_TIME, PAPERS, CcrHost
from tests.system.warm_start import PipedProgram

LATE = 2
"""Missed deadlines, of 6 steps, that a busy machine may cause; a board that is slow to serve makes
nearly all of them late."""


def served_uri(process: PipedProgram) -> str:
    return process.stdout.readline().split()[3].rstrip(";")


@pytest.mark.parametrize("words", [["--tcp", "127.0.0.1:0"], ["--pty"]])
def test_a_run_over_a_served_board_in_real_time_loses_nothing(
    ccr_host: CcrHost, short_path: str, words: list[str]
) -> None:
    server = ccr_host.start("emulate", *words)
    try:
        uri = served_uri(server)
        summary = ccr_host(
            "track", short_path, *PAPERS, *IN_REAL_TIME, "--no-open", "--device", uri, "--json"
        ).summary
    finally:
        server.send_signal(signal.SIGINT)
        server.communicate(timeout=PATIENCE_S)
    assert server.returncode == 0
    assert summary["device"] == uri
    assert summary["steps"] == 6
    assert summary["link"]["crc_errors"] == 0
    assert summary["missed_deadlines"] <= LATE
    assert summary["faults"] == []
    assert summary["mean_error_mm"] < 15, "the twin follows the board's pulses"


@pytest.mark.skipif(sys.platform != "linux", reason="pseudo-terminals as on Linux")
def test_the_board_on_a_separate_pty(ccr_host: CcrHost, short_path: str) -> None:
    summary = ccr_host(
        "track",
        short_path,
        *PAPERS,
        *IN_REAL_TIME,
        "--no-open",
        "--device",
        "emulator+pty:",
        "--json",
    ).summary
    assert summary["link"]["crc_errors"] == 0
    assert summary["missed_deadlines"] <= LATE


def test_eeprom_file_survives_the_emulator(ccr_host: CcrHost, short_path: str) -> None:
    for boots in (1, 2):
        server = ccr_host.start("emulate", "--tcp", "127.0.0.1:0", "--eeprom", "board.eeprom")
        try:
            served_uri(server)
        finally:
            server.send_signal(signal.SIGTERM)
            server.communicate(timeout=PATIENCE_S)
        content = (ccr_host.folder / "board.eeprom").read_bytes()
        at = EEPROM_BOOT_COUNTER + 2 * boots
        assert int.from_bytes(content[at : at + 2], "little") == boots, "counted at each start"


@pytest.mark.parametrize(
    ("robot", "status", "told"),
    [
        ("two-spatial", 0, "saved in"),
        ("three-spatial", 3, "drives 4 servos, the described robot has 9 motors"),
    ],
)
def test_a_served_board_has_the_axes_of_the_robot_that_it_is_served_for(
    ccr_host: CcrHost, short_path: str, robot: str, status: int, told: str
) -> None:
    server = ccr_host.start("emulate", "--tcp", "127.0.0.1:0", "--robot", "two-spatial")
    try:
        uri = served_uri(server)
        words = ("--robot", robot, "--controller", "open-loop", *IN_REAL_TIME, "--no-open")
        ended = ccr_host("track", short_path, *words, "--device", uri)
    finally:
        server.send_signal(signal.SIGINT)
        server.communicate(timeout=PATIENCE_S)
    assert ended.status == status
    assert told in ended.out + ended.err
