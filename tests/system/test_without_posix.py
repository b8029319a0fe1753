"""The pure host part on a system without POSIX features, such as Windows."""

import re
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from tests.patience import PATIENCE_S

CHECKOUT = Path(__file__).parents[2]


COMMAND = (sys.executable, "-m", "tests.without_posix")


def ccr_host(*words: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [*COMMAND, *words],
        cwd=CHECKOUT,
        capture_output=True,
        text=True,
        timeout=PATIENCE_S,
        check=False,
    )


def test_a_run_on_the_emulator_and_the_twin_needs_no_posix_and_can_be_read(tmp_path: Path) -> None:
    path = tmp_path / "short.csv"
    path.write_text("t_s,y_mm,z_mm\n0,0,30\n5,10,35\n")
    kept = str(tmp_path / "run")
    words = ("--controller", "mpc", "--publish", "igtl://:0", "--out", kept)
    run = ccr_host("track", str(path), *words)
    assert run.returncode == 0, run.stderr
    for form in ("mat", "rosbag2"):
        exported = ccr_host("export", kept, "--format", form)
        assert exported.returncode == 0, exported.stderr
    report = ccr_host("report", str(tmp_path / "run"))
    assert report.returncode == 0, report.stderr


def test_an_emulated_board_is_served_over_tcp() -> None:
    words = [*COMMAND, "emulate", "--tcp", "127.0.0.1:0", "--boot-ms", "0"]
    with subprocess.Popen(words, cwd=CHECKOUT, stdout=subprocess.PIPE, text=True) as emulator:
        try:
            assert emulator.stdout is not None
            told = re.search(r"tcp://[\d.:]+", emulator.stdout.readline())
            assert told
            doctor = ccr_host("doctor", "--device", told[0])
            assert "firmware" in doctor.stdout, doctor.stderr
            emulator.send_signal(signal.SIGINT)
            assert emulator.wait(PATIENCE_S) == 0
        finally:
            emulator.kill()


@pytest.mark.parametrize(
    ("words", "cure"),
    [
        (("emulate",), "--tcp"),
        (("track", "8shape", "--device", "emulator+pty:"), "--tcp"),
        (("jog",), "terminal"),
    ],
)
def test_what_needs_posix_says_so_in_one_line(words: tuple[str, ...], cure: str) -> None:
    ended = ccr_host(*words)
    assert ended.returncode == 2
    (line,) = ended.stderr.splitlines()
    assert line.startswith("ccr-host: ") and cure in line


@pytest.mark.parametrize(
    "command", ["calibrate", "doctor", "flash", "monitor", "register", "sweep"]
)
def test_every_command_can_be_asked_for_help(command: str) -> None:
    assert ccr_host(command, "--help").returncode == 0
