"""Control stack for tendon-driven continuum robots."""

from ccr_host.core.version import __version__

__all__ = ["__version__"]
