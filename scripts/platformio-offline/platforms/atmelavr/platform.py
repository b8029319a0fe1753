"""Replacement for PlatformIO's platform atmelavr."""

from platformio.public import PlatformBase


class AtmelavrPlatform(PlatformBase):
    """Defined entirely by its manifest."""
