"""A serial driver or terminal that fails in the middle of a command: one line, no traceback."""

from __future__ import annotations

import errno
import os
import pty
import termios
import tty
from collections.abc import Iterator
from functools import partial
from pathlib import Path

import pytest

from tests.patience import PATIENCE_S
from tests.system.warm_start import PipedProgram, with_streams


def with_failing_driver(terminal: str) -> None:
    """Make every serial driver fail, at the keyboard of a terminal."""
    with_streams(f"< {terminal}")
    termios.tcsetattr = tty.tcsetattr = _fail


def _fail(*_: object) -> None:
    raise termios.error(errno.EIO, "Input/output error")


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
    program = PipedProgram(
        [word.format(port=terminal) for word in words],
        tmp_path,
        prepared=partial(with_failing_driver, terminal),
    )
    _, err = program.communicate(PATIENCE_S)
    assert program.wait() == status, err
    assert "Traceback" not in err


@pytest.mark.parametrize("words", [["jog"], ["calibrate", "--by-eye", "--out", "robot.toml"]])
def test_keys_from_a_closed_standard_input_are_refused(tmp_path: Path, words: list[str]) -> None:
    program = PipedProgram(words, tmp_path, prepared=partial(with_streams, "<&-"))
    _, err = program.communicate(PATIENCE_S)
    assert program.wait() == 2, err
    assert err.strip().endswith(
        "ccr-host: error: standard input is not a terminal; start it from a terminal"
    )
