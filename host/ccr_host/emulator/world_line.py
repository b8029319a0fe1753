"""A line to an emulated board behind which the simulated robot moves, too."""

from __future__ import annotations

from ccr_host.emulator.server import Line
from ccr_host.run.clock import Steppable


class WorldLine:
    """Whoever advances the line advances the world of which the board is a part.

    Args:
        line: to the board.
        world: moves board, servos, robot and camera in the order of their events.
    """

    def __init__(self, line: Line, world: Steppable) -> None:
        self._line = line
        self._world = world

    def advance_to(self, time_us: int) -> None:
        """Bring the world to `time_us`."""
        self._world.advance_to(time_us)

    @property
    def next_event_us(self) -> int:
        """When to look again if the host stays silent."""
        return self._line.next_event_us

    def write(self, data: bytes) -> None:
        """Put bytes on the wire now."""
        self._line.write(data)

    def read(self) -> bytes:
        """Bytes that have arrived from the board."""
        return self._line.read()

    def open_port(self, boot_loader_us: int = 0) -> None:
        """Reset the board as an UNO is reset when its port is opened."""
        self._line.open_port(boot_loader_us)
