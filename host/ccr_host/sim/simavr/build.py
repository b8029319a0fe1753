"""Programs in C that are compiled on this machine when they are first needed."""

from __future__ import annotations

import hashlib
import subprocess
import tempfile
from collections.abc import Sequence
from pathlib import Path

from ccr_host.core.errors import DeviceError
from ccr_host.core.user_file import cache_folder


def compiled(
    name: str, compiler: str, sources: Sequence[Path], options: Sequence[str], cure: str
) -> Path:
    """What a compiler makes of C files and their headers; once for each version of them.

    ``name`` is that of the result, without its digest of the sources; ``cure`` is for the message.

    Raises:
        DeviceError: they do not compile.
    """
    digest = hashlib.sha256()
    for source in sources:
        digest.update(source.read_bytes())
    result = cache_folder() / name
    result = result.with_stem(f"{result.stem}-{digest.hexdigest()[:16]}")
    if result.exists():
        return result
    result.parent.mkdir(parents=True, exist_ok=True)
    files = [str(source) for source in sources if source.suffix == ".c"]
    with tempfile.TemporaryDirectory(dir=result.parent) as scratch:
        unfinished = Path(scratch) / result.name
        done = subprocess.run(
            [compiler, *files, *options, "-o", str(unfinished)],
            capture_output=True,
            text=True,
            check=False,
        )
        if done.returncode != 0:
            raise DeviceError(f"simavr: {name} does not build: {_gist(done.stderr)}", cure)
        unfinished.replace(result)
    return result


def _gist(messages: str) -> str:
    """The first line that states an error."""
    lines = messages.splitlines() or ["no message from the compiler"]
    return next((line for line in lines if "error:" in line or "cannot find" in line), lines[-1])
