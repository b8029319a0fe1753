"""What a check has found, and what to do about it."""

from __future__ import annotations

import enum
from collections.abc import Iterable
from dataclasses import dataclass

from ccr_host.core.errors import CcrError


class Severity(enum.IntEnum):
    """How bad it is."""

    GOOD = 0
    WARNING = 1
    """A run is possible but not as good or not as safe as it could be."""
    FAILURE = 2
    """A run is not possible."""


@dataclass(frozen=True)
class Finding:
    """One line of the doctor's report."""

    subject: str
    """What was looked at, in a word or two."""
    severity: Severity
    text: str
    remedy: str = ""
    exit_status: int = 0
    """Of the command if this is a failure; the same as the error's that a run would end with."""

    def as_summary(self) -> dict[str, str]:
        """For JSON."""
        return {
            "subject": self.subject,
            "severity": self.severity.name.lower(),
            "text": self.text,
            "remedy": self.remedy,
        }


def good(subject: str, text: str) -> Finding:
    """Nothing to do."""
    return Finding(subject, Severity.GOOD, text)


def warning(subject: str, text: str, remedy: str) -> Finding:
    """To be mended, but not now."""
    return Finding(subject, Severity.WARNING, text, remedy)


def failure(subject: str, error: CcrError) -> Finding:
    """What would end a run."""
    return Finding(subject, Severity.FAILURE, error.cause, error.cure, error.exit_status)


def judged(subject: str, text: str, *, fine: bool, remedy: str) -> Finding:
    """Good or a warning."""
    return good(subject, text) if fine else warning(subject, text, remedy)


def exit_status(findings: Iterable[Finding]) -> int:
    """0 while a run is possible; else that of the first failure."""
    return next((f.exit_status for f in findings if f.severity is Severity.FAILURE), 0)
