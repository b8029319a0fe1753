"""The released wheel, used in an empty folder and without the checkout."""

import json
import os
import subprocess
import sys
from collections.abc import Callable
from importlib.metadata import version
from pathlib import Path

import pytest

from ccr_host.link import messages as m
from ccr_host.sim.simavr.serve import open_pty_server
from tests.patience import PATIENCE_S

CHECKOUT = Path(__file__).parents[2]
PROGRAMS = str(Path(sys.executable).parent)
START = "import sys; from ccr_host.cli import main; sys.argv[0] = 'ccr-host'; main()"

Command = Callable[..., subprocess.CompletedProcess[str]]
"""Takes words, and environment variables by name."""


@pytest.fixture(scope="module")
def unpacked(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Folder with the wheel's packages; what it depends on comes from this environment."""
    built, unpacked = tmp_path_factory.mktemp("dist"), tmp_path_factory.mktemp("wheel")

    def run(*command: str | Path) -> None:
        path = os.pathsep.join((PROGRAMS, os.environ["PATH"]))
        ended = subprocess.run(
            command, env=os.environ | {"PATH": path}, capture_output=True, text=True, check=False
        )
        assert ended.returncode == 0, ended.stderr

    run(CHECKOUT / "scripts/release", "--build-only", built)
    notes = (built / "notes.md").read_text(encoding="utf-8")
    assert notes.strip().splitlines()[0] in (CHECKOUT / "CHANGELOG.md").read_text(encoding="utf-8")
    assert "\n## " not in notes, "of this release alone"
    run("uv", "pip", "install", "--no-deps", "--target", unpacked, *built.glob("*.whl"))
    return unpacked


@pytest.fixture
def ccr_host(unpacked: Path, tmp_path: Path) -> Command:
    """The command of the wheel in an empty folder."""

    def run(*words: str, **variables: str) -> subprocess.CompletedProcess[str]:
        return subprocess.run(
            [sys.executable, "-c", START, *words],
            cwd=tmp_path,
            env=os.environ | {"PYTHONPATH": str(unpacked)} | variables,
            capture_output=True,
            text=True,
            timeout=PATIENCE_S,
            check=False,
        )

    return run


def test_the_version_is_printed(ccr_host: Command) -> None:
    assert ccr_host("--version").stdout == f"ccr-host {version('ccr-host')}\n"


def test_flash_puts_the_firmware_that_came_along_onto_an_empty_board(ccr_host: Command) -> None:
    with open_pty_server(None) as server:
        flashed = ccr_host("flash", "--port", server.uri.removeprefix("serial:"), "--json")
    assert flashed.returncode == 0, flashed.stderr
    assert json.loads(flashed.stdout)["spec_hash"] == f"{m.SPEC_HASH:08x}"


def test_simavr_runs_the_firmware_that_came_along(ccr_host: Command, tmp_path: Path) -> None:
    (tmp_path / "short.csv").write_text("t_s,y_mm,z_mm\n0,0,30\n2,4,32\n")
    words = ("track", "short.csv", "--controller", "mpc", "--no-open", "--device", "simavr:")
    ended = ccr_host(*words)
    assert ended.returncode == 0, ended.stderr


def test_simavr_runs_the_megas_firmware_for_a_robot_of_four_motors(
    ccr_host: Command, tmp_path: Path
) -> None:
    (tmp_path / "short.csv").write_text("t_s,y_mm,z_mm\n0,0,0\n1,0,4\n")
    words = ("track", "short.csv", "--robot", "two-spatial", "--controller", "open-loop")
    ended = ccr_host(*words, "--unchecked", "--device", "simavr:")
    assert ended.returncode == 0, ended.stderr


def test_where_simavr_cannot_be_built_one_line_says_what_to_install(
    ccr_host: Command, tmp_path: Path
) -> None:
    without_simavr = tmp_path / "cc"
    without_simavr.write_text('#!/bin/sh\nexec cc -nostdinc "$@"\n')
    without_simavr.chmod(0o755)
    for variables in ({"PATH": str(tmp_path / "nothing"), "CC": ""}, {"CC": str(without_simavr)}):
        ended = ccr_host("track", "star", "--device", "simavr:", XDG_CACHE_HOME=".", **variables)
        assert ended.returncode == 3
        (line,) = ended.stderr.splitlines()
        assert line.endswith("; sudo apt install gcc libsimavr-dev libelf-dev")
