"""Replacement for PlatformIO's platform native."""

from platformio.public import PlatformBase


class NativePlatform(PlatformBase):
    """Defined entirely by its manifest."""
