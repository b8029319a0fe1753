"""What cameras have in common whose connection is opened again after it was lost."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from typing import Generic, Protocol, TypeVar

from ccr_host.core.errors import TrackerError
from ccr_host.tracking.tracker import ForeignPeerError, FrameCount, MarkerFrame

_RETRY_US = 1_000_000


class Connection(Protocol):
    """A port, a stream or an image source."""

    def close(self) -> None:
        """Close the connection."""


C = TypeVar("C", bound=Connection)


class ReopenedCamera(ABC, Generic[C]):
    """Opens the connection of a camera at the start, and a second after each `TrackerError`."""

    def __init__(self, name: str, open_connection: Callable[[], C]) -> None:
        self.name = name
        self._open_connection = open_connection
        self._connection: C | None = None
        self._openings = 0
        self._retry_us = 0
        self._running = False
        self._last_error = ""
        self._frames = FrameCount()

    @property
    def _reconnections(self) -> int:
        return max(0, self._openings - 1)

    def start(self) -> None:
        """Open the connection.

        Raises:
            TrackerError: there is no such camera.
        """
        self._open(0)
        self._running = True

    def advance_to(self, time_us: int) -> None:
        """Process what has arrived; open the connection again if it was lost."""
        if not self._running or time_us < self._retry_us:
            return
        try:
            self._process(self._connection or self._open(time_us), time_us)
        except TrackerError as error:
            self._let_go()
            if isinstance(error, ForeignPeerError) and not self._frames.count:
                self._running = False
                raise
            self._last_error = str(error)
            self._retry_us = time_us + _RETRY_US

    def newest_frame(self) -> MarkerFrame | None:
        return self._frames.newest

    def stop(self) -> None:
        self._running = False
        self._let_go()

    @abstractmethod
    def _process(self, connection: C, time_us: int) -> None:
        """Process what has arrived.

        Raises:
            TrackerError: the connection is of no use any more.
        """

    def _open(self, time_us: int) -> C:
        self._connection = connection = self._open_connection()
        self._openings += 1
        return connection

    def _let_go(self) -> None:
        """Close the connection if it is open, and forget its state."""
        if self._connection is not None:
            self._connection.close()
            self._connection = None
