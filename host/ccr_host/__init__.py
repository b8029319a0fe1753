"""Control stack for tendon-driven continuum robots."""

__version__ = "0.1.0"
