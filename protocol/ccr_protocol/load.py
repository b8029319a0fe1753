"""From a file to a `Spec`, or to the list of what is wrong with it."""

from __future__ import annotations

import tomllib
from pathlib import Path
from typing import Any

from ccr_protocol import meaning, shape
from ccr_protocol.build import build
from ccr_protocol.spec import Spec


class SpecError(Exception):
    """A spec that cannot be used; `problems` has one line for each defect, with its place."""

    def __init__(self, problems: list[str]) -> None:
        self.problems = problems
        super().__init__("\n".join(problems))


def load(path: Path) -> Spec:
    """Read and validate a spec file.

    Raises:
        SpecError: the file cannot be read, is not TOML, or is not a valid spec.
    """
    try:
        tree = tomllib.loads(path.read_text(encoding="utf-8"))
    except (OSError, UnicodeDecodeError, tomllib.TOMLDecodeError) as error:
        raise SpecError([f"{path.name}: {error}"]) from None
    return from_tree(tree)


def from_tree(tree: dict[str, Any]) -> Spec:
    """Validate a parsed spec.

    Raises:
        SpecError: says what is wrong, line by line.
    """
    problems = validate(tree)
    if problems:
        raise SpecError(problems)
    return build(tree)


def validate(tree: dict[str, Any]) -> list[str]:
    """List what is wrong; the meaning of a spec is judged only once its shape is sound."""
    problems: list[str] = []
    shape.SPEC(tree, "", problems)
    return problems or list(meaning.problems(tree))
