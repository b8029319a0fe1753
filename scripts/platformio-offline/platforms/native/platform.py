"""Stand-in for PlatformIO's platform native."""

from platformio.public import PlatformBase


class NativePlatform(PlatformBase):
    """Everything is in the manifest."""
