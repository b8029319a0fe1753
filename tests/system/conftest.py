"""Runs the program as its user does: as a command, judged by what it prints and leaves behind."""

from __future__ import annotations

import json
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest

from ccr_host.link.framing import FrameDecoder
from ccr_host.link.messages import MESSAGES, Message

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
    """The command, in a folder of its own."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder

    def __call__(self, *words: str, timeout_s: float = 120) -> Ended:
        ended = subprocess.run(
            [COMMAND, *words],
            cwd=self.folder,
            capture_output=True,
            text=True,
            timeout=timeout_s,
            check=False,
        )
        return Ended(ended.returncode, ended.stdout, ended.stderr)

    def start(self, *words: str) -> subprocess.Popen[str]:
        return subprocess.Popen(
            [COMMAND, *words],
            cwd=self.folder,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
        )


def log_lines(folder: Path) -> list[dict[str, Any]]:
    return [json.loads(line) for line in (folder / "log.jsonl").read_text().splitlines()]


def messages_in(folder: Path, direction: str) -> list[Message]:
    """Every message on the link in one direction, in order."""
    decoder = FrameDecoder()
    frames = [
        frame
        for line in log_lines(folder)
        if line["kind"] == "frame" and line["dir"] == direction
        for frame in decoder.feed(bytes.fromhex(line["hex"]))
    ]
    return [MESSAGES[frame.id].unpack(frame.payload) for frame in frames]


@pytest.fixture
def ccr_host(tmp_path: Path) -> CcrHost:
    return CcrHost(tmp_path)


@pytest.fixture
def short_path(tmp_path: Path) -> str:
    """Five seconds well inside the workspace."""
    file = tmp_path / "short.csv"
    file.write_text("t_s,y_mm,z_mm\n0,0,30\n5,10,35\n")
    return str(file)
