"""The few exceptions of the host.

Each carries a cause and a cure and decides the exit status of ``ccr-host``.
"""

from __future__ import annotations

import errno
import traceback
from collections.abc import Iterator
from contextlib import contextmanager

_LONGEST_MESSAGE = 300
"""Characters of the message of someone else's exception."""


class CcrError(Exception):
    """Base class of all errors that the host raises on purpose.

    Args:
        cause: what is wrong, one line, in the user's words.
        cure: what the user can do about it, one line.
    """

    exit_status = 3

    def __init__(self, cause: str, cure: str = "") -> None:
        self.cause = cause
        self.cure = cure
        super().__init__(f"{cause} ({cure})" if cure else cause)

    def __reduce__(self) -> tuple[object, ...]:
        """Make every subclass picklable, whatever its constructor takes."""
        return _passed_on, (type(self), self.cause, self.cure), self.__dict__


class ConfigError(CcrError):
    """A command line, robot description or path file that cannot be used (exit status 2)."""

    exit_status = 2


class DeviceError(CcrError):
    """The microcontroller is absent, silent, refuses, or has latched a fault (exit status 3)."""


class TrackerError(CcrError):
    """The tracker is absent, silent or reports a fault (exit status 3)."""


class CodeError(CcrError):
    """A class supplied by the user has failed (exit status 2).

    ``error`` is the exception it raised; None if it returned something unusable instead.
    """

    exit_status = 2

    def __init__(self, cause: str, cure: str = "", error: BaseException | None = None) -> None:
        super().__init__(cause, cure)
        self.traceback = "" if error is None else "".join(traceback.format_exception(error))


@contextmanager
def blaming(who: str, cure: str) -> Iterator[None]:
    """Turn any exception of a user-supplied class into an error that names the class.

    Raises:
        CodeError: for every exception except ours and an interrupt.
    """
    try:
        yield
    except (CcrError, KeyboardInterrupt):
        raise
    except BaseException as error:
        # Also SystemExit and those of frameworks, such as asyncio's CancelledError.
        raise code_error(who, cure, error) from error


def code_error(who: str, cure: str, error: BaseException, effect: str = "") -> CodeError:
    """The error to raise where user-supplied code has raised one.

    ``who`` is the class or method; ``effect``, what became of the robot, is added to the cause.
    """
    cause = f"{who} has failed: {type(error).__name__}: {_message(error)}{effect}"
    return CodeError(cause, cure, error)


def _message(error: BaseException) -> str:
    """The error's own text on one line; short, whatever it holds."""
    try:
        text = str(error)
    except Exception:  # the user's own __str__
        return "(its message cannot be read)"
    line = " ".join("".join(c if c.isprintable() else " " for c in text).split())
    return line if len(line) <= _LONGEST_MESSAGE else line[:_LONGEST_MESSAGE] + "..."


def full_text(error: Exception) -> str:
    """Cause and cure of our own errors, type and message of others."""
    return str(error) if isinstance(error, CcrError) else f"{type(error).__name__}: {error}"


def why(error: Exception) -> str:
    """The cause of any error, one line, without its cure."""
    if isinstance(error, CcrError):
        return error.cause
    if isinstance(error, OSError) and error.strerror:
        limit = " (see the limit of ulimit -f)" if error.errno == errno.EFBIG else ""
        return error.strerror + limit
    return full_text(error)


def _passed_on(kind: type[CcrError], cause: str, cure: str) -> CcrError:
    error = kind.__new__(kind)
    CcrError.__init__(error, cause, cure)
    return error
