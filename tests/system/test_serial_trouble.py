"""A serial driver or terminal that fails in the middle of a command: one line, no traceback."""

from __future__ import annotations

import os
import pty
import subprocess
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.patience import PATIENCE_S
from tests.system.conftest import COMMAND

_FAILING_DRIVER = """
import errno, termios
def fail(*_):
    raise termios.error(errno.EIO, "Input/output error")
termios.tcsetattr = fail
"""
"""Replaces a preloaded library: every program with this PYTHONPATH gets such a driver."""


@pytest.fixture
def terminal() -> Iterator[str]:
    master, slave = pty.openpty()
    yield os.ttyname(slave)
    os.close(master)
    os.close(slave)


@pytest.mark.parametrize(
    ("words", "status"),
    [
        (["track", "8shape", "--controller", "mpc", "--device", "serial:{port}"], 3),
        (["track", "8shape", "--controller", "mpc", "--tracker", "ndi:{port}"], 3),
        (["track", "8shape", "--controller", "mpc", "--device", "emulator+pty:"], 2),
        (["doctor", "--device", "serial:{port}"], 3),
        (["doctor", "--tracker", "ndi:{port}"], 3),
        (["monitor", "--tracker", "ndi:{port}", "--duration", "1"], 3),
        (["monitor", "--device", "serial:{port}", "--duration", "1"], 3),
        (["register", "--tracker", "twin:", "--device", "serial:{port}"], 3),
        (["calibrate", "--tracker", "twin:", "--device", "serial:{port}", "--out", "r.toml"], 3),
        (["calibrate", "--by-eye", "--out", "robot.toml"], 2),
        (["jog"], 2),
        (["flash", "--port", "{port}"], 3),
        (["emulate"], 2),
        (["emulate", "--polaris"], 2),
    ],
)
def test_a_failing_driver_is_one_line(
    tmp_path: Path, terminal: str, words: list[str], status: int
) -> None:
    (tmp_path / "sitecustomize.py").write_text(_FAILING_DRIVER)
    with Path(terminal).open() as keys:
        ended = subprocess.run(
            [COMMAND, *(word.format(port=terminal) for word in words)],
            cwd=tmp_path,
            env=os.environ | {"PYTHONPATH": str(tmp_path)},
            stdin=keys,
            capture_output=True,
            text=True,
            timeout=PATIENCE_S,
            check=False,
        )
    assert ended.returncode == status, ended.stderr
    assert "Traceback" not in ended.stderr


@pytest.mark.parametrize("words", [["jog"], ["calibrate", "--by-eye", "--out", "robot.toml"]])
def test_keys_from_a_closed_standard_input_are_refused(tmp_path: Path, words: list[str]) -> None:
    ended = subprocess.run(
        ["/bin/sh", "-c", f'exec "$0" {" ".join(words)} <&-', COMMAND],
        cwd=tmp_path,
        capture_output=True,
        text=True,
        timeout=PATIENCE_S,
        check=False,
    )
    assert ended.returncode == 2, ended.stderr
    assert ended.stderr.strip().endswith(
        "ccr-host: error: standard input is not a terminal; start it from a terminal"
    )
