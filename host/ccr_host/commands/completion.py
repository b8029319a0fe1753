"""What the shell offers for values; only called, and only then importing, while completing."""

from __future__ import annotations


def controllers(incomplete: str) -> list[str]:
    """Names of controllers."""
    from ccr_host.control.registry import controller_names, peer_names

    return _beginning_with(incomplete, [*controller_names(), *peer_names()])


def paths(incomplete: str) -> list[str]:
    """Names of built-in paths; where none fits, the shell itself offers files."""
    from ccr_host.robot.paths import path_names

    return _beginning_with(incomplete, path_names())


def robots(incomplete: str) -> list[str]:
    """Names of shipped descriptions; where none fits, the shell itself offers files."""
    from ccr_host.description_source import shipped_descriptions

    return _beginning_with(incomplete, shipped_descriptions())


def _beginning_with(incomplete: str, names: list[str]) -> list[str]:
    return [name for name in names if name.startswith(incomplete)]
