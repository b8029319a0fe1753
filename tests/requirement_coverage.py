"""Requirements of the protocol shown by the tests on a board, and why others were not."""

from __future__ import annotations

import tomllib
from collections import defaultdict
from collections.abc import Iterable
from dataclasses import dataclass, field
from pathlib import Path

_SPEC = Path(__file__).parents[1] / "protocol" / "spec.toml"
REQUIREMENTS = tuple(
    requirement["id"]
    for requirement in tomllib.loads(_SPEC.read_text(encoding="utf-8"))["requirement"]
)
"""Ids of all requirements, as the spec orders them."""


@dataclass
class Evidence:
    """What came of the tests that name a requirement."""

    passed: int = 0
    failed: int = 0
    skipped: set[str] = field(default_factory=set)
    """Their reasons."""

    def verdict(self) -> str:
        """ "shown" only if every test of it has passed."""
        if self.failed:
            return "violated"
        if not (self.passed or self.skipped):
            return "not run"
        if not self.skipped:
            return "shown"
        reasons = "; ".join(sorted(self.skipped))
        return f"shown but for: {reasons}" if self.passed else f"not shown: {reasons}"


class Coverage:
    """Collects evidence, by board and requirement."""

    def __init__(self) -> None:
        self._boards: dict[str, dict[str, Evidence]] = defaultdict(
            lambda: {name: Evidence() for name in REQUIREMENTS}
        )

    def note(self, board: str, requirement: str, outcome: str, reason: str = "") -> None:
        """Outcome of one test: passed, failed or skipped."""
        evidence = self._boards[board][requirement]
        match outcome:
            case "passed":
                evidence.passed += 1
            case "failed":
                evidence.failed += 1
            case "skipped":
                evidence.skipped.add(reason)

    def lines(self) -> Iterable[str]:
        """Lines for the terminal, one per board and one per requirement not fully shown."""
        for board, evidence in sorted(self._boards.items()):
            if not any(one.passed or one.failed for one in evidence.values()):
                continue
            verdicts = {name: one.verdict() for name, one in evidence.items()}
            whole = [name for name, verdict in verdicts.items() if verdict == "shown"]
            partly = [name for name, verdict in verdicts.items() if verdict.startswith("shown but")]
            line = f"requirements shown on {board} {len(whole)} of {len(REQUIREMENTS)}"
            yield line + (f", {len(partly)} more in part" if partly else "")
            for name, verdict in verdicts.items():
                if verdict not in ("shown", "not run"):
                    yield f"  {name} {verdict}"
            not_run = [name for name, verdict in verdicts.items() if verdict == "not run"]
            if not_run:
                yield f"  no test was run of {', '.join(not_run)}"
