"""Stand-in for PlatformIO's platform atmelavr."""

from platformio.public import PlatformBase


class AtmelavrPlatform(PlatformBase):
    """Everything is in the manifest."""
