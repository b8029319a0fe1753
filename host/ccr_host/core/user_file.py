"""Files that a user names.

Reading: whatever stands there, nothing hangs and memory is bounded. Writing: at once or not at all.
"""

from __future__ import annotations

import codecs
import contextlib
import io
import itertools
import os
import stat
from collections.abc import Iterator
from pathlib import Path

from ccr_host.core.errors import ConfigError

_MARKS = (
    (codecs.BOM_UTF8, "utf-8-sig"),
    (codecs.BOM_UTF32_LE, "utf-32"),  # begins with the mark of UTF-16
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


def is_there(path: Path) -> bool:
    """Whether anything has this name; False too where nothing can have it or it is out of sight."""
    return _mode(path) != 0


def is_folder(path: Path) -> bool:
    """Whether a folder has this name; never raises."""
    return stat.S_ISDIR(_mode(path))


def read_bytes(path: Path, what: str, cure: str, at_most: int) -> bytes:
    """Read a whole file.

    Args:
        path: as the user gave it.
        what: the file is, for the message: "path file".
        cure: what to give instead.
        at_most: bytes; a longer file is refused before it is read.

    Raises:
        ConfigError: there is no such file, it cannot be read, is too long, or is no file: a folder,
            pipe, socket or device, none of which is opened.
    """
    try:
        mode = path.stat().st_mode
        if not stat.S_ISREG(mode):
            kind = next((name for is_kind, name in _KINDS if is_kind(mode)), "not a file")
            raise ConfigError(f"{what} {path}: {kind}", cure)
        # Another program may have put a pipe there since.
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
    """Read a text in UTF-8, or in UTF-16 or UTF-32 with a byte-order mark.

    Returns:
        The text with its own line ends, and the encoding that makes the same file of it again.

    Raises:
        ConfigError: see `read_bytes`; or it is not text.
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
    """Write a file at once or not at all.

    What is not a regular file, such as a pipe or /dev/null, is written as it is.

    Yields:
        A draft to write. It takes the file's place when the block ends; after an error the file is
        as it was. Whoever looks for files by their suffix does not find a draft.

    Raises:
        OSError: the draft cannot be written, or cannot take the place.
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
        draft.replace(target)
    except BaseException:
        with contextlib.suppress(OSError):
            draft.unlink()
        raise


def lines_of(text: str) -> list[str]:
    """Lines ended in any of the three ways, and in no other."""
    return [line.rstrip("\n") for line in io.StringIO(text, newline=None)]


def printable(text: str, at_most: int | None = None) -> str:
    """On one line, what cannot be printed escaped, cut where it is too long."""
    shown = "".join(c if c.isprintable() else repr(c)[1:-1] for c in text)
    return shown if at_most is None or len(shown) <= at_most else shown[:at_most] + "..."


def _mode(path: Path) -> int:
    try:
        return path.stat().st_mode
    except (OSError, ValueError):
        return 0
