"""An interrupt ends the program as such, however a library handles it."""

from __future__ import annotations

import os
import signal
import subprocess
import sys

import pytest

_SWALLOWED = """
import signal
from ccr_host import cli
from ccr_host.commands import app

def run(words):
    try:
        signal.raise_signal(signal.{name})
    except KeyboardInterrupt as interruption:
        raise ImportError("initialization failed") from interruption

app.run = run
cli.main()
"""


@pytest.mark.long
def test_an_interrupted_import_is_an_interruption() -> None:
    for name in ("SIGINT", "SIGTERM", *(("SIGHUP",) if hasattr(signal, "SIGHUP") else ())):
        ended = subprocess.run(
            [sys.executable, "-c", _SWALLOWED.format(name=name)],
            capture_output=True,
            text=True,
            env=os.environ,
            check=False,
        )
        assert (ended.returncode, ended.stderr) == (130, "ccr-host: interrupted\n")


_IN_A_FINALIZER = """
import signal
from ccr_host import cli
from ccr_host.commands import app

class Finalized:
    def __del__(self):
        signal.raise_signal(signal.SIGINT)

def run(words):
    Finalized()
    signal.raise_signal(signal.SIGINT)
    return 0

app.run = run
cli.main()
"""


def test_an_interruption_in_a_finalizer_does_not_cost_the_next_one() -> None:
    ended = subprocess.run(
        [sys.executable, "-c", _IN_A_FINALIZER], capture_output=True, text=True, check=False
    )
    assert (ended.returncode, ended.stderr) == (130, "ccr-host: interrupted\n")
