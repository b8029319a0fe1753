"""The folder that a command leaves behind."""

from __future__ import annotations

import json
import os
import platform
from collections.abc import Callable, Iterator
from contextlib import ExitStack, suppress
from datetime import datetime
from importlib.metadata import version
from pathlib import Path
from typing import Any, Self

from ccr_host.core import __version__
from ccr_host.core.errors import ConfigError, why
from ccr_host.core.user_file import is_there, printable, replacing
from ccr_host.link import messages

try:
    import fcntl
except ModuleNotFoundError:  # on Windows, where two processes may share a folder
    _LOCKS = False
else:
    _LOCKS = True

METRICS_FILE = "run.json"
"""Configuration and summary of a run."""
TIMING_FILE = "timing.json"
FIGURES = ("figure.png", "figure.pdf", "figure.svg")

_LEFT_BY_A_RUN = (METRICS_FILE, TIMING_FILE, *FIGURES, "log_[0-9]*.mcap", "timing_[0-9]*.mcap")
_NEEDED_AT_LEAST = bytes(4096)
_LONGEST_TITLE = 100
_NOT_IN_NAMES = '/\\:*?"<>|'


class ResultFolder:
    """Keeps results; what cannot be written is noted, and the rest goes on.

    The folder is made at once, so that one that cannot be had is known before anything moves, and
    locked, as two runs would leave the log of one beside the figure of the other. To be used as a
    context manager: a folder that was made and has stayed empty is removed at the end. Without a
    ``wanted`` folder it is ``runs/<date>-<title>``, under an unused name.

    Raises:
        ConfigError: it cannot be made or written to, or another run writes to it.
    """

    def __init__(self, wanted: Path | None, title: str) -> None:
        self.path = wanted or next(name for name in _default_names(title) if not is_there(name))
        self.kept: list[str] = []
        """Names of the files written."""
        self._missing: dict[str, list[str]] = {}
        self._made = [f for f in (self.path, *self.path.parents) if not is_there(f)]
        try:
            self.path.mkdir(parents=True, exist_ok=True)
            probe = self.path / ".writable"
            try:
                probe.write_bytes(_NEEDED_AT_LEAST)
            finally:
                probe.unlink(missing_ok=True)
            self._lock = _locked(self.path)
        except BlockingIOError:
            raise ConfigError(
                f"--out {self.path}: another run writes to it", "name another folder"
            ) from None
        except (OSError, ValueError) as error:
            self._remove_if_empty()
            cause = "not a folder" if isinstance(error, FileExistsError) else why(error)
            raise unwritable(self.path, cause) from None

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._lock.close()
        self._remove_if_empty()

    @property
    def trouble(self) -> str:
        """What was not written and why; empty if nothing is missing."""
        missing = self._missing.items()
        return "; ".join(f"no {', '.join(names)}: {cause}" for cause, names in missing)

    def keep(self, write: Callable[[Path], None], *names: str) -> None:
        """Write files in place of those of the same names.

        ``write`` gets the path of the first and replaces each of ``names`` at once or not at all;
        whatever it raises is noted.
        """
        before = {name: _identity(self.path / name) for name in names}
        cause = ""
        try:
            self.path.mkdir(parents=True, exist_ok=True)
            write(self.path / names[0])
        except Exception as error:
            cause = why(error)
        for name in names:
            if _identity(self.path / name) != before[name]:
                self.kept.append(name)
            else:
                self._missing.setdefault(cause, []).append(name)

    def keep_json(self, name: str, content: dict[str, Any]) -> None:
        self.keep(lambda file: write_json(file, content), name)

    def _remove_if_empty(self) -> None:
        with suppress(OSError):
            for folder in self._made:
                folder.rmdir()


def _locked(folder: Path) -> ExitStack:
    """Lock a folder until this is closed or the process ends, however it ends.

    Raises:
        BlockingIOError: it is locked already.
    """
    lock = ExitStack()
    if _LOCKS:
        opened = os.open(folder, os.O_RDONLY)
        lock.callback(os.close, opened)
        try:
            fcntl.flock(opened, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            lock.close()
            raise
        except OSError:
            pass  # some file systems have no locks
    return lock


def unwritable(folder: Path, cause: str) -> ConfigError:
    """The error of a folder that takes no results."""
    return ConfigError(f"--out {folder}: {cause}", "name a folder that can be written")


def write_json(file: Path, content: dict[str, Any]) -> None:
    """Indented, with a final newline; at once or not at all.

    Raises:
        OSError: it cannot be written.
    """
    with replacing(file) as draft:
        draft.write_text(json.dumps(content, indent=2) + "\n", encoding="utf-8")


def remove_earlier_run(folder: Path) -> None:
    """Make room for a run: none of its files shall stand beside those of another one.

    Raises:
        OSError: a file cannot be removed.
    """
    for pattern in _LEFT_BY_A_RUN:
        for file in folder.glob(pattern):
            file.unlink()


def _identity(file: Path) -> tuple[int, int] | None:
    try:
        found = file.stat()
    except OSError:
        return None
    return found.st_ino, found.st_mtime_ns


def _default_names(title: str) -> Iterator[Path]:
    readable = "".join("_" if c in _NOT_IN_NAMES else c for c in printable(title))
    readable = readable.encode()[:_LONGEST_TITLE].decode(errors="ignore")
    first = Path("runs") / f"{datetime.now():%Y%m%d-%H%M%S}-{readable}"
    yield first
    for number in range(2, 1000):
        yield first.with_name(f"{first.name}-{number}")


def versions() -> dict[str, str]:
    """Version of everything that decides a run's figures."""
    return {
        "ccr_host": __version__,
        "protocol": f"{messages.PROTOCOL_VERSION}, spec {messages.SPEC_HASH:08x}",
        "python": platform.python_version(),
        **{package: version(package) for package in ("numpy", "mujoco-core", "daqp")},
    }
