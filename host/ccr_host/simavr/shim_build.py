"""Builds the C part of the rig on the user's machine, once for each state of its source."""

from __future__ import annotations

import hashlib
import os
import shutil
import subprocess
import tempfile
from pathlib import Path

from ccr_host.errors import DeviceError
from ccr_host.simavr.files import cache_folder

_SOURCES = Path(__file__).parent / "shim"
_COMPILE = ("-std=gnu11", "-O2", "-fPIC", "-shared")
_SIMAVR = ("-I/usr/include/simavr", "-I/usr/local/include/simavr", "-L/usr/local/lib", "-lsimavr")
_CURE = "sudo apt install gcc libsimavr-dev libelf-dev"


def built_shim() -> Path:
    """The shared object, built if this state of its source never was.

    It links libsimavr and is therefore under the GPL-3: for use on this machine only.

    Raises:
        DeviceError: compiler or libsimavr are missing.
    """
    folder = cache_folder()
    library = folder / f"librig-{_digest()}.so"
    if not library.exists():
        folder.mkdir(parents=True, exist_ok=True)
        _build(library)
    return library


def _build(library: Path) -> None:
    compiler = os.environ.get("CC") or shutil.which("cc") or shutil.which("gcc")
    if compiler is None:
        raise DeviceError("simavr: no C compiler", _CURE)
    with tempfile.TemporaryDirectory(dir=library.parent) as scratch:
        unfinished = Path(scratch) / library.name
        sources = sorted(str(source) for source in _SOURCES.glob("*.c"))
        result = subprocess.run(
            [compiler, *_COMPILE, *sources, *_SIMAVR, "-o", str(unfinished)],
            capture_output=True,
            text=True,
            check=False,
        )
        if result.returncode != 0:
            raise DeviceError(f"simavr: the rig does not build: {_gist(result.stderr)}", _CURE)
        unfinished.replace(library)


def _gist(messages: str) -> str:
    """The line that tells what is wrong."""
    lines = messages.splitlines() or ["the compiler says nothing"]
    return next((line for line in lines if "error:" in line or "cannot find" in line), lines[-1])


def _digest() -> str:
    digest = hashlib.sha256()
    for source in sorted(_SOURCES.glob("*.[ch]")):
        digest.update(source.read_bytes())
    return digest.hexdigest()[:16]
