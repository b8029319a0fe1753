"""Serves emulated devices to other programs in real time, on pseudo-terminals or on TCP.

Opening its port resets a board, as DTR resets an UNO. Without a client the board keeps running.
"""

from __future__ import annotations

import selectors
import signal
import socket
from collections.abc import Sequence
from threading import Thread
from typing import Protocol, Self

from ccr_host.core.clock import Clock, Steppable

BOOT_LOADER_US = 1_000_000
"""Time for which the UNO's boot loader waits for an upload after a reset (optiboot's time-out)."""


class Line(Protocol):
    """The line to a device, which advances with it."""

    def advance_to(self, time_us: int) -> None:
        """Advance line and device to `time_us`."""

    @property
    def next_event_us(self) -> int:
        """Time of the next event if the host sends nothing."""

    def write(self, data: bytes) -> None:
        """Start to transmit bytes now."""

    def read(self) -> bytes:
        """Return the bytes that have arrived from the board."""

    def open_port(self, boot_loader_us: int = 0) -> None:
        """Reset the board, as an UNO is reset when its port is opened."""


class Port(Protocol):
    """A port for at most one client at a time."""

    uri: str
    """URI for `--device`."""

    def register(self, selector: selectors.BaseSelector, station: Station) -> None:
        """Watch for clients; the selector's keys carry the function to call when ready."""

    def look_for_client(self) -> None:
        """Poll for changes that the selector does not report; called every control tick."""

    def send(self, data: bytes) -> None:
        """Send bytes to the client; dropped if there is none or it does not read."""

    def close(self) -> None:
        """Disconnect the client and close the port."""


class Station:
    """One line behind one port.

    The device does not listen for ``boot_loader_us`` after its port was opened. ``world`` advances
    the line and all that moves with it; None for the line alone.
    """

    def __init__(
        self, line: Line, port: Port, *, boot_loader_us: int = 0, world: Steppable | None = None
    ) -> None:
        self.line = line
        self.port = port
        self.advance_to = (world or line).advance_to
        self._boot_loader_us = boot_loader_us

    def opened(self) -> None:
        """Reset the board, as a client has opened the port."""
        self.line.open_port(self._boot_loader_us)

    def received(self, data: bytes) -> None:
        """Transmit bytes from the client."""
        self.line.write(data)

    def deliver(self) -> None:
        """Send the client what has arrived from the device."""
        self.port.send(self.line.read())
        self.port.look_for_client()


class BoardServer:
    """An emulated board behind its port, and further devices; a ``with`` block serves in a thread.

    ``boot_loader_us`` and ``world`` are as for `Station`; devices ``beside`` are advanced after the
    board.
    """

    def __init__(
        self,
        line: Line,
        port: Port,
        clock: Clock,
        *,
        boot_loader_us: int = BOOT_LOADER_US,
        world: Steppable | None = None,
        beside: Sequence[Station] = (),
    ) -> None:
        board = Station(line, port, boot_loader_us=boot_loader_us, world=world)
        self._stations = (board, *beside)
        self._clock = clock
        self._stopping = False
        self._thread = Thread(target=self.run, name="emulated board", daemon=True)
        self._wake_read, self._wake_write = socket.socketpair()  # Windows selects sockets only
        self._wake_write.setblocking(False)

    @property
    def uri(self) -> str:
        """Device URI of the board."""
        return self._stations[0].port.uri

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        if self._thread.is_alive():
            self.stop()
        self._thread.join()

    def run(self) -> None:
        """Serve until :meth:`stop`; then close the ports."""
        with selectors.SelectSelector() as selector:  # epoll rounds time-outs up to 1 ms
            selector.register(self._wake_read, selectors.EVENT_READ, self._note_stop)
            for station in self._stations:
                station.port.register(selector, station)
            try:
                while not self._stopping:
                    self._advance_lines()
                    for station in self._stations:
                        station.deliver()
                    self._wait(selector)
            finally:
                for station in self._stations:
                    station.port.close()
                self._wake_read.close()
                self._wake_write.close()

    def run_until_signal(self) -> None:
        """Serve until SIGINT or SIGTERM; in the main thread only."""
        signals = (signal.SIGINT, signal.SIGTERM)
        before = {number: signal.signal(number, lambda *_: self.stop()) for number in signals}
        try:
            self.run()
        finally:
            for number, handler in before.items():
                signal.signal(number, handler)

    def stop(self) -> None:
        """End :meth:`run`, from a signal handler or another thread."""
        self._wake_write.send(b"\0")

    def _note_stop(self) -> None:
        self._stopping = True

    def _advance_lines(self) -> None:
        now_us = self._clock.now_us()
        for station in self._stations:
            station.advance_to(now_us)

    def _wait(self, selector: selectors.BaseSelector) -> None:
        event_us = min(station.line.next_event_us for station in self._stations)
        ready = selector.select(max(event_us - self._clock.now_us(), 0) * 1e-6)
        self._advance_lines()  # so that bytes received now are transmitted from now on
        for key, _ in ready:
            key.data()
