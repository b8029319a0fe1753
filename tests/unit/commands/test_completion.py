"""Shell completion, called like bash calls it."""

import os
import subprocess
import sys
from pathlib import Path
from typing import get_args

import pytest

from ccr_host.commands.options import RobotOption
from ccr_host.control.registry import baseline_names, controller_names
from ccr_host.description.source import shipped_descriptions
from ccr_host.robot.paths import path_names

COMMAND = str(Path(sys.executable).with_name("ccr-host"))


def offered(line: str) -> list[str]:
    """Completions of the last word of a line, which may be empty."""
    spoken = {
        "_CCR_HOST_COMPLETE": "complete_bash",
        "COMP_WORDS": line,
        "COMP_CWORD": str(line.count(" ")),
    }
    done = subprocess.run(
        [COMMAND], env=os.environ | spoken, capture_output=True, text=True, check=True
    )
    assert not done.stderr
    return done.stdout.split()


@pytest.mark.long
@pytest.mark.parametrize(
    ("line", "wanted"),
    [
        ("ccr-host ca", {"calibrate"}),
        ("ccr-host re", {"record", "register", "replay", "report"}),
        ("ccr-host track 8shape --see", {"--seed"}),
        ("ccr-host track ", set(path_names())),
        ("ccr-host track mine.c", set()),
        ("ccr-host track 8shape --controller ", {*controller_names(), *baseline_names()}),
        ("ccr-host compare --controller kal", {"kalman-jacobian"}),
        ("ccr-host jog --robot ", set(shipped_descriptions())),
    ],
)
def test_bash_is_offered_what_fits(line: str, wanted: set[str]) -> None:
    assert set(offered(line)) == wanted


def test_bash_falls_back_on_files() -> None:
    shown = subprocess.run(
        [COMMAND, "--show-completion", "bash"],
        env=os.environ | {"_TYPER_COMPLETE_TEST_DISABLE_SHELL_DETECTION": "1"},
        capture_output=True,
        text=True,
        check=True,
    )
    assert "complete -o default" in shown.stdout
    assert "_CCR_HOST_COMPLETE=complete_bash" in shown.stdout


def test_command_names_are_offered_without_loading_what_controllers_need() -> None:
    loaded = subprocess.run(
        [sys.executable, "-c", "import sys, ccr_host.commands.app; print(*sys.modules)"],
        capture_output=True,
        text=True,
        check=True,
    )
    modules = loaded.stdout.split()
    assert "ccr_host.commands.options" in modules
    slow = {"ccr_host.control.registry", "mujoco", "matplotlib", "daqp", "scipy", "viser", "mcap"}
    assert not slow & set(modules)


def test_the_help_names_every_shipped_robot() -> None:
    (_, option) = get_args(RobotOption)
    named = option.help.rpartition(": ")[2].removesuffix(".").split(", ")
    assert named == shipped_descriptions()
