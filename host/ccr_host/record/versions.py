"""What produced a result."""

from __future__ import annotations

import platform
from importlib.metadata import version

from ccr_host.core.version import __version__
from ccr_host.link import messages


def versions() -> dict[str, str]:
    """Version of everything that decides a run's figures."""
    return {
        "ccr_host": __version__,
        "protocol": f"{messages.PROTOCOL_VERSION}, spec {messages.SPEC_HASH:08x}",
        "python": platform.python_version(),
        **{package: version(package) for package in ("numpy", "mujoco-core", "daqp")},
    }
