"""The few exceptions of the host.

Each carries a cause and a cure and decides the exit status of ``ccr-host``.
"""

from __future__ import annotations


class CcrError(Exception):
    """Base of everything the host raises on purpose.

    Args:
        cause: what is wrong, one line, in the user's words.
        cure: what the user can do about it, one line.
    """

    exit_status = 3

    def __init__(self, cause: str, cure: str = "") -> None:
        self.cause = cause
        self.cure = cure
        super().__init__(f"{cause} ({cure})" if cure else cause)


class ConfigError(CcrError):
    """A command line, robot description or path file that cannot be used (exit status 2)."""

    exit_status = 2


class DeviceError(CcrError):
    """The microcontroller is absent, silent, refuses, or has latched a fault (exit status 3)."""


class TrackerError(CcrError):
    """The tracker is absent, silent or reports a fault (exit status 3)."""
