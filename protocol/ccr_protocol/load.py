"""Load a spec file as a `Spec`, or list what is wrong with it."""

from __future__ import annotations

import hashlib
import json
import tomllib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from pydantic import ValidationError
from pydantic_core import ErrorDetails

from ccr_protocol import meaning
from ccr_protocol.spec import CAPABILITIES, Spec

_PROSE_KEYS = frozenset({"prose", "text"})
_LISTS_IN_ANY_ORDER = ("constant", "enum", "flags", "struct", "message")
_IN_TOML = {
    "missing": "missing",
    "extra_forbidden": "unknown key",
    "model_type": "must be a table",
    "model_attributes_type": "must be a table",
    "tuple_type": "must be a list",
    "union_tag_invalid": "direction must be 'to_board' or 'to_host'",
    "union_tag_not_found": "direction: missing",
}
"""Kinds of errors that TOML has other words for than Python."""


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
    """Validate a parsed spec; what it means is judged only once its shape is sound.

    Raises:
        SpecError: says what is wrong, line by line.
    """
    try:
        spec = Spec.model_validate(tree)
    except ValidationError as error:
        raise SpecError([_line(one, tree) for one in error.errors()]) from None
    problems = list(meaning.problems(spec))
    if problems:
        raise SpecError(problems)
    spec._hash = spec_hash(tree)
    return spec


def validate(tree: dict[str, Any]) -> list[str]:
    """List what is wrong."""
    try:
        from_tree(tree)
    except SpecError as error:
        return error.problems
    return []


def _line(error: ErrorDetails, tree: object) -> str:
    """One error with its place; entries of lists are named by their name, id or number."""
    place, node = "", tree
    for part in error["loc"]:
        if isinstance(part, int):
            node = node[part] if isinstance(node, list) and part < len(node) else None
            place += f" {_label(node, part)}"
        elif part in ("to_board", "to_host") and isinstance(node, Mapping):
            continue  # the kind of a message, by which pydantic names its errors
        else:
            node = node.get(part) if isinstance(node, Mapping) else None
            place += f", {part}" if place else part
    told = _IN_TOML.get(error["type"], error["msg"]).removeprefix("Value error, ")
    if told.startswith("Input should"):
        told = f"{told.replace('Input should', 'must')}, not {error['input']!r}"
    return f"{place}: {told}"


def _label(node: object, index: int) -> str:
    names = (node.get(key) for key in ("name", "id")) if isinstance(node, Mapping) else ()
    return next((name for name in names if isinstance(name, str)), f"#{index + 1}")


def spec_hash(tree: Mapping[str, Any]) -> int:
    """32 bits of SHA-256 over what matters on the wire and in the board's behaviour.

    Prose, the wording of requirements, the firmware's version and the order of definitions are
    left out; the order of fields counts. Optional messages and their capabilities are left out too:
    `hello_reply` announces them, so that boards with and without them are equally understood.
    """
    meaning = {key: value for key, value in tree.items() if key != "requirement"}
    optional = {node["optional"] for node in tree["message"] if "optional" in node}
    meaning["message"] = [node for node in tree["message"] if "optional" not in node]
    meaning["flags"] = [
        {**node, "bits": [bit for bit in node["bits"] if bit["name"] not in optional]}
        if node["name"] == CAPABILITIES
        else node
        for node in tree["flags"]
    ]
    meaning["protocol"] = {k: v for k, v in tree["protocol"].items() if k != "firmware_version"}
    for key in _LISTS_IN_ANY_ORDER:
        meaning[key] = sorted(meaning[key], key=lambda node: str(node["name"]))
    meaning["state_machine"] = sorted(
        (source, node["event"], node["to"])
        for node in tree["state_machine"]["transitions"]
        for source in node["from"]
    )
    canonical = json.dumps(_without_prose(meaning), sort_keys=True, separators=(",", ":"))
    return int.from_bytes(hashlib.sha256(canonical.encode()).digest()[:4], "big")


def _without_prose(node: Any) -> Any:  # noqa: ANN401 - any TOML value
    if isinstance(node, Mapping):
        return {k: _without_prose(v) for k, v in node.items() if k not in _PROSE_KEYS}
    if isinstance(node, list):
        return [_without_prose(value) for value in node]
    return node
