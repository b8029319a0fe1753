"""Small edits of a parsed spec, by name."""

from typing import Any

Tree = dict[str, Any]


def find(tree: Tree, kind: str, name: str) -> Tree:
    """The enum, flags, struct, message or constant of this name."""
    return next(node for node in tree[kind] if node["name"] == name)


def field(tree: Tree, kind: str, owner: str, name: str) -> Tree:
    """A field of a struct or message."""
    return next(node for node in find(tree, kind, owner)["fields"] if node["name"] == name)


def value(tree: Tree, enum: str, name: str) -> Tree:
    """A value of an enumeration."""
    return next(node for node in find(tree, "enum", enum)["values"] if node["name"] == name)


def bit(tree: Tree, flags: str, name: str) -> Tree:
    """A bit of a flag set."""
    return next(node for node in find(tree, "flags", flags)["bits"] if node["name"] == name)


def transition(tree: Tree, event: str, to: str) -> Tree:
    """A row of the state machine."""
    rows = tree["state_machine"]["transitions"]
    return next(row for row in rows if (row["event"], row["to"]) == (event, to))


def remove(nodes: list[Tree], name: str) -> None:
    """Take the entry of this name out of a list."""
    nodes[:] = [node for node in nodes if node["name"] != name]
