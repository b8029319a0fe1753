"""Files named by the user, and the folder of those that can be made again.

Reading never hangs and uses bounded memory, whatever the file is. Writing is atomic.
"""

from __future__ import annotations

import codecs
import contextlib
import io
import itertools
import os
import stat
import tempfile
from collections.abc import Iterator
from pathlib import Path

from ccr_host.core.errors import ConfigError

_MARKS = (
    (codecs.BOM_UTF8, "utf-8-sig"),
    (codecs.BOM_UTF32_LE, "utf-32"),  # before UTF-16: it starts with the mark of UTF-16
    (codecs.BOM_UTF32_BE, "utf-32"),
    (codecs.BOM_UTF16_LE, "utf-16"),
    (codecs.BOM_UTF16_BE, "utf-16"),
)
_ZIP = b"PK\x03\x04"
_KINDS = (
    (stat.S_ISDIR, "a folder"),
    (stat.S_ISFIFO, "a pipe"),
    (stat.S_ISSOCK, "a socket"),
    (stat.S_ISCHR, "a device"),
    (stat.S_ISBLK, "a device"),
)
_MEGABYTE = 1_000_000
_drafts = itertools.count()
_LEFT_OVER_S = 3600.0
"""Age of a draft beside a new one from which whoever wrote it was killed: writing takes seconds."""


def is_there(path: Path) -> bool:
    """Whether anything exists at this path; False too if the path is invalid or inaccessible."""
    return _mode(path) != 0


def is_folder(path: Path) -> bool:
    """Whether the path is a folder; never raises."""
    return stat.S_ISDIR(_mode(path))


def read_bytes(path: Path, what: str, cure: str, at_most: int) -> bytes:
    """Read a whole file.

    ``what``, such as "path file", and ``cure`` are for the message; a file of more than ``at_most``
    bytes is rejected before it is read.

    Raises:
        ConfigError: the file does not exist, cannot be read, is too long, or is not a regular
            file: a folder, pipe, socket or device, none of which is opened.
    """
    try:
        mode = path.stat().st_mode
        if not stat.S_ISREG(mode):
            kind = next((name for is_kind, name in _KINDS if is_kind(mode)), "not a file")
            raise ConfigError(f"{what} {path}: {kind}", cure)
        # O_NONBLOCK: another program may have replaced the file with a pipe since.
        handle = os.open(
            path, os.O_RDONLY | getattr(os, "O_NONBLOCK", 0) | getattr(os, "O_BINARY", 0)
        )
        with os.fdopen(handle, "rb") as file:
            size = os.fstat(handle).st_size
            content = b"" if size > at_most else file.read(size)
    except (OSError, ValueError) as error:
        why = error.strerror if isinstance(error, OSError) else error
        raise ConfigError(f"{what} {path}: {why}", cure) from None
    if size > at_most:
        longest = f"{at_most / _MEGABYTE:g} MB" if at_most >= _MEGABYTE else f"{at_most} bytes"
        raise ConfigError(f"{what} {path}: longer than {longest}", cure)
    return content


def read_text(path: Path, what: str, cure: str, at_most: int) -> tuple[str, str]:
    """Read a text file in UTF-8, or in UTF-16 or UTF-32 with a byte-order mark.

    Returns:
        The text with its original line endings, and the encoding that reproduces the file.

    Raises:
        ConfigError: see `read_bytes`; or the file is not text.
    """
    content = read_bytes(path, what, cure, at_most)
    if content.startswith(_ZIP):
        raise ConfigError(
            f"{what} {path}: a spreadsheet (.xlsx, .ods) or another zip archive, not text", cure
        )
    encoding = next((name for mark, name in _MARKS if content.startswith(mark)), "utf-8")
    try:
        return content.decode(encoding), encoding
    except UnicodeDecodeError:
        raise ConfigError(
            f"{what} {path}: not text in UTF-8 or UTF-16",
            f"{cure}; text of another encoding: save it as UTF-8",
        ) from None


@contextlib.contextmanager
def replacing(path: Path) -> Iterator[Path]:
    """Write a file atomically.

    A path that is not a regular file, such as a pipe or /dev/null, is written directly.

    Yields:
        A draft to write. It replaces the file when the block ends; after an error the file is
        unchanged. Its name has its own suffix, so that searches by suffix do not find it. One
        that was left over by a killed process is removed an hour later, by whatever is written next
        in that folder.

    Raises:
        OSError: the draft cannot be written, or cannot replace the file.
    """
    target = Path(os.path.realpath(path))
    mode = _mode(target)
    if mode and not stat.S_ISREG(mode):
        yield target
        return
    draft = target.with_name(f".{os.getpid()}-{next(_drafts)}.draft")
    try:
        yield draft
        with draft.open("rb+") as written:
            os.fsync(written.fileno())
        if mode:
            draft.chmod(stat.S_IMODE(mode))
        _remove_left_over(draft)
        draft.replace(target)
    except BaseException:
        with contextlib.suppress(OSError):
            draft.unlink()
        raise


def _remove_left_over(draft: Path) -> None:
    """Remove old drafts beside a new one; the clock is that of their file system."""
    with contextlib.suppress(OSError):
        new_s = draft.stat().st_mtime
        for other in draft.parent.glob(".*-*.draft"):
            if new_s - other.stat().st_mtime > _LEFT_OVER_S:
                other.unlink()


def keep_elsewhere(text: str, suffix: str) -> Path:
    """Write text that would be lost otherwise to a new file among the temporary ones.

    Raises:
        OSError: it cannot be written there either.
    """
    with tempfile.NamedTemporaryFile(
        "w", prefix="ccr-host-", suffix=suffix, encoding="utf-8", errors="replace", delete=False
    ) as file:
        file.write(text)
    return Path(file.name)


def cache_folder() -> Path:
    """Folder for results that can be recomputed; it may not exist yet."""
    return Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "ccr-host"


def lines_of(text: str) -> list[str]:
    r"""Split at \n, \r\n and \r only, unlike `str.splitlines`."""
    return [line.rstrip("\n") for line in io.StringIO(text, newline=None)]


def printable(text: str, at_most: int | None = None) -> str:
    """Text on one line: unprintable characters escaped, cut after `at_most` characters."""
    shown = "".join(c if c.isprintable() else repr(c)[1:-1] for c in text)
    return shown if at_most is None or len(shown) <= at_most else shown[:at_most] + "..."


def _mode(path: Path) -> int:
    try:
        return path.stat().st_mode
    except (OSError, ValueError):
        return 0
