"""The emulated board's port as a pseudo-terminal."""

from __future__ import annotations

import errno
import os
import select
import selectors
from contextlib import suppress

from ccr_host.emulator.server import PortListener
from ccr_host.errors import ConfigError

try:
    import pty
    import termios
    import tty
except ModuleNotFoundError:  # on Windows
    _SUPPORTED = False
else:
    _SUPPORTED = True

_READ_BYTES = 4096
_LFLAG = 3


class PtyPort:
    """A pseudo-terminal whose other end is opened like a serial port.

    Raises:
        ConfigError: this computer gives none.
    """

    def __init__(self) -> None:
        if not _SUPPORTED:
            raise ConfigError(
                "this system has no pseudo-terminals", "use emulator:, or emulate --tcp HOST:PORT"
            )
        try:
            self._master, slave = pty.openpty()
            self._path = os.ttyname(slave)
            tty.setraw(slave)
        except (OSError, termios.error) as error:
            raise ConfigError(
                f"no pseudo-terminal to serve on ({error})",
                "see that /dev/pts is mounted and not full, or serve on --tcp",
            ) from None
        self.uri = f"serial:{self._path}"
        os.set_blocking(self._master, False)
        os.close(slave)  # only with no end open here can it be told whether a client has one
        self._hang_up = select.poll()
        self._hang_up.register(self._master, 0)
        self._client = False

    def register(self, selector: selectors.BaseSelector, listener: PortListener) -> None:
        self._selector = selector
        self._listener = listener

    def look_for_client(self) -> None:
        """The kernel tells only by polling that an end was opened again after a hang-up."""
        present = not self._hang_up.poll(0)
        if present == self._client:
            return
        self._client = present
        if present:
            self._make_raw()
            self._selector.register(self._master, selectors.EVENT_READ, self._read)
            self._listener.opened()
        else:
            self._selector.unregister(self._master)

    def send(self, data: bytes) -> None:
        if not (self._client and data):
            return
        try:
            os.write(self._master, data)
        except OSError as error:
            if error.errno not in (errno.EAGAIN, errno.EIO):
                raise

    def close(self) -> None:
        os.close(self._master)

    def _read(self) -> None:
        try:
            data = os.read(self._master, _READ_BYTES)
        except OSError as error:
            if error.errno not in (errno.EAGAIN, errno.EIO):
                raise
            self.look_for_client()
            return
        self._listener.received(data)

    def _make_raw(self) -> None:
        """The kernel restores a cooked terminal on the last close; a client may not care."""
        with suppress(termios.error):  # the client may be gone again
            if termios.tcgetattr(self._master)[_LFLAG] & (termios.ECHO | termios.ICANON):
                tty.setraw(self._master)
