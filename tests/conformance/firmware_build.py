"""The firmware as it stands in the tree, built once for all tests of a checkout."""

from __future__ import annotations

import fcntl
import hashlib
import subprocess
from functools import cache
from pathlib import Path

ROOT = Path(__file__).parents[2]
BUILDS = ROOT / "build" / "firmware"


@cache
def firmware_elf(*flags: str, board: str = "uno") -> Path:
    """Build with extra compiler flags, unless the same source was built with them before."""
    folder = BUILDS / _fingerprint((board, *flags))
    folder.mkdir(parents=True, exist_ok=True)
    elf = folder / "firmware.elf"
    with (folder / "lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        if not elf.exists():
            command = [str(ROOT / "scripts" / "build-firmware"), "--board", board]
            command += [str(folder), *flags]
            try:
                subprocess.run(command, check=True, capture_output=True, text=True)
            except subprocess.CalledProcessError as error:
                elf.unlink(missing_ok=True)
                raise AssertionError(
                    f"the firmware does not build (apt install gcc-avr avr-libc?):\n{error.stderr}"
                ) from None
    return elf


def _fingerprint(flags: tuple[str, ...]) -> str:
    digest = hashlib.sha256(" ".join(flags).encode())
    sources = [ROOT / "scripts" / "build-firmware"]
    sources += [file for file in (ROOT / "firmware").rglob("*") if file.suffix in (".h", ".cpp")]
    for file in sorted(sources):
        digest.update(str(file.relative_to(ROOT)).encode() + b"\0" + file.read_bytes())
    return digest.hexdigest()[:16]
