"""Runs the program as a user does, as a command whose output and files are checked."""

from __future__ import annotations

import json
import sys
import time
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest

from ccr_host.core.errors import ConfigError
from ccr_host.link.framing import decode_single_frame
from ccr_host.link.messages import MESSAGES, Message
from ccr_host.record.log import topics
from ccr_host.record.log.files import LOG_PREFIX, log_files
from ccr_host.record.log.reader import RunRecording
from ccr_host.record.log.topics import Topic
from tests.patience import PATIENCE_S
from tests.system.warm_start import PipedProgram, run_program

PAPERS = ("--controller", "mpc")
"""The fastest closed loop: it starts the path at once."""
PATIENT_BOARD = ("--set", "link.relax_after_ms=60000")
"""Options of tests not about the watchdog: a busy machine may stop any host for seconds."""
AT_ONCE = ("--unchecked", "--set", "control.settle_s=0.5")
"""Options of runs that are not about how a path begins; they save a fifth of a short one's CPU."""
IN_REAL_TIME = (*PATIENT_BOARD, *AT_ONCE)
COMMAND = str(Path(sys.executable).with_name("ccr-host"))


@dataclass(frozen=True)
class Ended:
    status: int
    out: str
    err: str

    @property
    def summary(self) -> dict[str, Any]:
        return json.loads(self.out)


class CcrHost:
    """The command, run in a new folder."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder

    def __call__(self, *words: str, timeout_s: float = PATIENCE_S, drawn: bool = False) -> Ended:
        """Run it to its end; only tests of figures have them drawn."""
        return Ended(*run_program(words, self.folder, timeout_s, drawn=drawn))

    def start(self, *words: str, drawn: bool = False) -> PipedProgram:
        return PipedProgram(words, self.folder, drawn=drawn)


def logged(folder: Path, *wanted: Topic) -> list[dict[str, Any]]:
    """Contents of the log's messages, in order."""
    return [message.content for message in RunRecording(folder).messages(*wanted)]


def events(folder: Path) -> list[str]:
    return [content["message"] for content in logged(folder, topics.EVENT)]


def messages_in(folder: Path, topic: Topic) -> list[Message]:
    """Every message on the link in one direction, in order."""
    frames = [decode_single_frame(bytes.fromhex(c["hex"])) for c in logged(folder, topic)]
    return [MESSAGES[frame.id].unpack(frame.payload) for frame in frames if frame]


_ACTING = """
import os, pathlib, shutil, signal, time
from ccr_host.control.mpc.controller import ModelPredictive

class Acting(ModelPredictive):
    def step(self, observation):
        if observation.step == {step}:
            {deed}
        return super().step(observation)
"""


def acting(folder: Path, deed: str, step: int) -> tuple[str, str]:
    """Options for `mpc` that does something at one step, however fast the machine is."""
    (folder / "acting.py").write_text(_ACTING.format(step=step, deed=deed))
    return "--controller", "acting.py:Acting"


def wait_until_following(folder: Path, process: PipedProgram) -> None:
    """Wait until the first step of the path is in the log."""
    deadline = time.monotonic() + PATIENCE_S
    while process.poll() is None and time.monotonic() < deadline:
        with suppress(ConfigError):  # a file that has only just been made
            if log_files(folder, LOG_PREFIX) and logged(folder, topics.STEP):
                return
        time.sleep(0.25)  # The log is read each time.
    pytest.fail(f"the run did not start: {process.communicate()}")


def children(parent: int) -> list[int]:
    """Its worker processes, as multiprocessing has spawned them from any thread."""
    found = []
    for file in Path(f"/proc/{parent}/task").glob("*/children"):
        with suppress(OSError):
            words = file.read_text().split()
            found += [w for w in words if b"spawn_main" in Path(f"/proc/{w}/cmdline").read_bytes()]
    return [int(word) for word in found]


@pytest.fixture
def ccr_host(tmp_path: Path) -> CcrHost:
    return CcrHost(tmp_path)


def write_short_path(folder: Path) -> str:
    """Five seconds well inside the workspace."""
    file = folder / "short.csv"
    file.write_text("t_s,y_mm,z_mm\n0,0,30\n5,10,35\n")
    return str(file)


@pytest.fixture
def short_path(tmp_path: Path) -> str:
    return write_short_path(tmp_path)
