"""Problems with standard input, output and error change neither results nor status."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
from collections.abc import Callable
from functools import partial
from pathlib import Path

import pytest

from tests.patience import PATIENCE_S
from tests.system.conftest import AT_ONCE, COMMAND, IN_REAL_TIME, PAPERS, CcrHost, events
from tests.system.driven_terminal import DrivenTerminal
from tests.system.warm_start import PipedProgram, with_streams

pytestmark = pytest.mark.usefixtures("short_path")

TRACK = ("track", "short.csv", *PAPERS, *AT_ONCE, "--no-open", "--out", "kept")
RESULTS = ("run.json", "timing.json", "figure.png", "log_0000.mcap")
A_STEP = r"\d+/\d"
"""Progress that a busy machine may show seldom."""
GONE = ("> /dev/full", "2> /dev/full", ">&-", "2>&-", "<&-", "<&- >&- 2>&-")


def warm(folder: Path, *words: str, streams: str) -> tuple[int, str, str]:
    """Status and output with streams as the shell below makes them."""
    program = PipedProgram(words, folder, prepared=partial(with_streams, streams))
    out, err = program.communicate(PATIENCE_S)
    return program.wait(), out, err


def in_shell(folder: Path, *words: str, streams: str, **environment: str) -> tuple[int, str, str]:
    line = f'"$0" "$@" {streams}; exit ${{PIPESTATUS[0]}}'
    ended = subprocess.run(
        ["bash", "-c", line, COMMAND, *words],
        cwd=folder,
        env=os.environ | environment,
        capture_output=True,
        text=True,
        timeout=PATIENCE_S,
        check=False,
    )
    return ended.returncode, ended.stdout, ended.stderr


def assert_results(folder: Path) -> None:
    json.loads((folder / "run.json").read_text())
    assert {file.name for file in folder.iterdir()} >= set(RESULTS)


@pytest.mark.parametrize(
    ("start", "streams"),
    [*((warm, streams) for streams in GONE), (in_shell, GONE[-1]), (in_shell, "2>&1 | head -0")],
)
def test_a_run_whose_output_goes_nowhere_keeps_its_results_and_status_0(
    tmp_path: Path, start: Callable[..., tuple[int, str, str]], streams: str
) -> None:
    status, _, err = start(tmp_path, *TRACK, streams=streams)
    assert status == 0, err
    assert "Traceback" not in err
    assert_results(tmp_path / "kept")


@pytest.mark.parametrize(
    "words",
    [
        ("doctor", "--json"),
        ("monitor", "--duration", "1", "--json"),
        ("workspace", "8shape", "--json"),
    ],
)
@pytest.mark.parametrize("streams", ["> /dev/full", ">&- 2>&-"])
def test_other_commands_end_as_they_would_have_ended(
    tmp_path: Path, words: tuple[str, ...], streams: str
) -> None:
    status, _, err = warm(tmp_path, *words, streams=streams)
    assert status == 0, err
    assert "Traceback" not in err


def test_a_full_disk_behind_standard_output_is_reported_once(tmp_path: Path) -> None:
    _, _, err = in_shell(tmp_path, "--help", streams="> /dev/full")
    assert err == "ccr-host: standard output is incomplete: No space left on device\n"


def test_an_unreadable_error_message_keeps_its_status(tmp_path: Path) -> None:
    for streams in ("2>&-", "2> /dev/full", "> /dev/full"):
        assert warm(tmp_path, "track", "spiral", streams=streams)[0] == 2


def first_line(ccr_host: CcrHost, *words: str) -> str:
    """The line after which its reader closes the pipe, which is no error."""
    program = ccr_host.start(*words)
    line = program.stdout.readline()
    program.stdout.close()
    assert program.wait(PATIENCE_S) == 0
    assert program.stderr.read() == ""
    return line


def test_a_reader_that_closes_the_pipe_is_not_an_error(ccr_host: CcrHost) -> None:
    assert first_line(ccr_host, *TRACK).startswith("short with mpc")


def test_a_monitor_ends_with_its_reader(ccr_host: CcrHost) -> None:
    assert json.loads(first_line(ccr_host, "monitor", "--json"))["tracker"] == "twin:"


def test_what_the_locale_cannot_show_is_escaped(tmp_path: Path) -> None:
    folder = os.fsdecode("gehört-\udcff".encode(errors="surrogateescape"))
    words = (*TRACK[:-1], folder)
    status, out, err = in_shell(tmp_path, *words, streams="", PYTHONIOENCODING="ascii")
    assert status == 0, err
    assert r"geh\xf6rt-\udcff" in out
    assert_results(tmp_path / folder)


def test_a_name_with_brackets_is_shown_as_it_is(ccr_host: CcrHost, tmp_path: Path) -> None:
    (tmp_path / "short.csv").rename(tmp_path / "[bold]a.csv")
    ended = ccr_host("track", "[bold]a.csv", *TRACK[2:])
    assert ended.status == 0, ended.err
    assert "[bold]a with mpc" in ended.out


def test_a_message_stays_one_line_whatever_the_name_in_it(ccr_host: CcrHost) -> None:
    ended = ccr_host("track", "gone\n\x1b[31m.csv")
    assert ended.status == 2
    assert r"gone\n\x1b[31m.csv" in ended.err
    assert len(ended.err.splitlines()) == 1


def close_window(terminal: DrivenTerminal) -> int | None:
    """Status of a command whose terminal is closed."""
    terminal.hang_up()
    return terminal.status


def test_a_terminal_that_is_closed_in_mid_run_interrupts_it_and_keeps_all(tmp_path: Path) -> None:
    words = (
        "track",
        "8shape",
        *PAPERS,
        *IN_REAL_TIME,
        "--realtime",
        "--rate",
        "5",
        "--out",
        "kept",
    )
    terminal = DrivenTerminal(tmp_path, *words)
    terminal.wait_for(A_STEP)
    assert close_window(terminal) == 130
    assert_results(tmp_path / "kept")
    assert events(tmp_path / "kept")[-1] == "interrupted"


def test_a_run_that_ignores_hangups_outlives_its_terminal(tmp_path: Path) -> None:
    words = (
        "track",
        "short.csv",
        *PAPERS,
        *IN_REAL_TIME,
        "--realtime",
        "--rate",
        "5",
        "--out",
        "kept",
    )
    ignore_hangups = partial(signal.signal, signal.SIGHUP, signal.SIG_IGN)  # as under nohup
    terminal = DrivenTerminal(tmp_path, *words, prepared=ignore_hangups)
    terminal.wait_for(A_STEP)
    assert close_window(terminal) == 0
    assert_results(tmp_path / "kept")
    assert json.loads((tmp_path / "kept" / "run.json").read_text())["metrics"]["faults"] == []


@pytest.mark.parametrize(
    ("words", "shown"),
    [(("jog",), "target"), (("monitor",), "M1"), (("emulate",), "try"), (("doctor",), "good")],
)
def test_closing_the_terminal_ends_every_command_without_a_crash(
    tmp_path: Path, words: tuple[str, ...], shown: str
) -> None:
    terminal = DrivenTerminal(tmp_path, *words)
    terminal.wait_for(shown)
    assert close_window(terminal) in (0, 130)


@pytest.mark.parametrize("defect", ["MemoryError('x')", "SystemExit(7)", "OSError(5, 'x')"])
def test_a_defect_is_one_line_that_names_the_file_with_its_traceback(
    tmp_path: Path, defect: str
) -> None:
    program = (
        "import sys; from ccr_host import cli; from ccr_host.commands.app import app\n"
        f"def broken() -> None: raise {defect}\n"
        "app.command()(broken); sys.argv[1:] = ['broken']; cli.main()"
    )
    ended = subprocess.run(
        [sys.executable, "-c", program],
        env=os.environ | {"TMPDIR": str(tmp_path)},
        capture_output=True,
        text=True,
        check=False,
    )
    assert ended.returncode == 3
    (kept,) = tmp_path.glob("ccr-host-*.txt")
    assert ended.stderr.splitlines() == [ended.stderr.rstrip()]
    assert str(kept) in ended.stderr
    assert "in broken" in kept.read_text()


def test_an_interruption_while_the_program_is_being_loaded_is_one_line_too(tmp_path: Path) -> None:
    program = (
        "import os, signal, sys; from ccr_host import cli\n"
        "class Impatient:\n"
        "    def find_spec(self, name, *_):\n"
        "        if name == 'ccr_host.commands.track': os.kill(os.getpid(), signal.SIGTERM)\n"
        "sys.meta_path.insert(0, Impatient()); cli.main()"
    )
    ended = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, check=False
    )
    assert (ended.returncode, ended.stderr) == (130, "ccr-host: interrupted\n")
