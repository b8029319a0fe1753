"""Progress bars and colours appear on terminals only; pipes and files get plain text."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.system.conftest import AT_ONCE, PAPERS, CcrHost
from tests.system.driven_terminal import DrivenTerminal

COLOUR = "\x1b[3"
WORDS = ("track", "short.csv", "--no-open", *PAPERS, *AT_ONCE)


def on_a_terminal(folder: Path, *words: str, **environment: str) -> str:
    terminal = DrivenTerminal(folder, *words, **environment)
    shown = terminal.styled_end()
    assert terminal.status == 0
    return shown


@pytest.mark.usefixtures("short_path")
def test_a_pipe_gets_neither_colours_nor_a_moving_bar(ccr_host: CcrHost) -> None:
    ended = ccr_host(*WORDS)
    assert ended.status == 0
    assert "tip error (mm)" in ended.out
    assert "\x1b" not in ended.out + ended.err
    assert "arming" not in ended.out + ended.err


@pytest.mark.usefixtures("short_path")
def test_a_width_of_zero_hides_nothing(tmp_path: Path) -> None:
    assert "tip error (mm)" in on_a_terminal(tmp_path, *WORDS, COLUMNS="0")


@pytest.mark.usefixtures("short_path")
def test_the_name_of_a_folder_stays_on_its_line(ccr_host: CcrHost) -> None:
    assert r"saved in a\nb/: run.json" in ccr_host(*WORDS, "--out", "a\nb").out


@pytest.mark.usefixtures("short_path")
def test_a_terminal_sees_one_line_of_progress_with_step_and_error(tmp_path: Path) -> None:
    shown = on_a_terminal(tmp_path, *WORDS)
    assert "short, mpc" in shown
    assert "/6" in shown
    assert "error" in shown
    assert "tip error (mm)" in shown


def test_every_term_of_the_tables_is_explained_below_them(
    ccr_host: CcrHost, short_path: str
) -> None:
    for command in (("track",), ("compare", "--path")):
        out = ccr_host(*command, short_path, "--controller", "mpc", "--unchecked").out
        table, _, terms = out.partition("distance between measured and desired tip")
        assert all(len(line) <= 80 for line in table.splitlines())
        assert "…" not in table, "no figure is cut off on 80 columns"
        for term in ("true", "floor", "ratio"):
            assert term in table
            assert f"\n{term} " in terms
        assert "paper" not in out, "it has no such path"


def test_the_papers_figures_stand_beside_its_own_experiment_alone(
    ccr_host: CcrHost, short_path: str
) -> None:
    both = ("--path", "8shape", "--path", short_path)
    words = ("compare", "--robot", "paper", "--controller", "mpc", "--unchecked", *both)
    lines = ccr_host(*words).out.splitlines()
    row = {words[0]: words for line in lines if (words := line.split())}
    assert "7.50" in row["8shape"]
    assert len(row["short"]) == len(row["8shape"]) - 1


def test_a_measured_error_far_from_the_true_one_is_explained(
    ccr_host: CcrHost, short_path: str
) -> None:
    words = ("--path", short_path, "--robot", "hard", "--controller", "mpc", "--unchecked")
    told = " ".join(ccr_host("compare", *words).out.split())
    assert "turned by 3 deg" in told
    assert "ccr-host register" in told


def test_a_robot_that_is_shorter_than_described_is_told_once(
    ccr_host: CcrHost, short_path: str
) -> None:
    words = ("--path", short_path, "--robot", "paper", *PAPERS)
    told = " ".join(ccr_host("compare", *words).out.split())
    assert told.count("where 58.5 and 43.5 are described") == 1


def test_colours_are_for_terminals_and_left_out_on_request(tmp_path: Path) -> None:
    assert COLOUR in on_a_terminal(tmp_path, "doctor")
    assert COLOUR not in on_a_terminal(tmp_path, "doctor", NO_COLOR="1")
