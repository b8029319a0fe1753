"""Messages of an OpenIGTLink server over TCP, read without waiting.

pyigtl unpacks them. Its client is not used: it keeps only the newest message of each device, does
not notice a lost server, and prints a traceback for anything that it does not understand.
"""

from __future__ import annotations

import errno
import re
import socket
from collections.abc import Callable
from typing import Any

from ccr_host.core.addresses import joined
from ccr_host.core.errors import TrackerError
from ccr_host.core.plugins import import_optional
from ccr_host.tracking.tracker import ForeignPeerError

Message = Any
"""A message of pyigtl, which has no types."""

POSE_TYPES = ("TRANSFORM", "POINT")
"""Types of the messages that are unpacked; the others are skipped."""

_CONNECT_S = 3.0
_NOT_YET = (errno.EAGAIN, errno.EWOULDBLOCK, errno.EINPROGRESS, errno.ENOTCONN)
_READ_BYTES = 1 << 16
_READS_AT_ONCE = 64
"""Limit, so that a server that floods the line does not delay the run."""

_HEADER_BYTES = 58
_HEADER = re.compile(rb"\0[\x01-\x03](?P<type>[A-Z][A-Z0-9_]*)\0*")
"""Version and type; a name, a time stamp, the length of the body and its check sum follow."""
_TYPE_END, _LENGTH = 14, slice(42, 50)
_LONGEST_BODY_BYTES = 1 << 31
"""More than any image."""
_LONGEST_POSE_BYTES = 1 << 16
"""More than any transform with its metadata, or any list of the points that a camera sees."""
_SHOWN_BYTES = 24

Unpack = Callable[[bytes, bytes], Message]
"""Unpacks a message from header and body."""


class IgtlStream:
    """One connection.

    ``connection`` is a socket, possibly not connected yet, ``unpack`` a function of pyigtl.
    """

    def __init__(self, name: str, connection: socket.socket, unpack: Unpack) -> None:
        connection.setblocking(False)
        self._name = name
        self._connection = connection
        self._unpack = unpack
        self._received = bytearray()
        self._to_skip = 0
        self.is_silent = True
        """Whether nothing at all has arrived yet."""
        self.skipped_types: set[str] = set()
        """Types of the messages that carry no pose."""
        self.damaged = 0
        """Messages that could not be unpacked."""

    def messages(self) -> list[Message]:
        """Poses and points that have arrived since the last call, in the order of their arrival.

        Raises:
            ForeignPeerError: the peer does not speak OpenIGTLink.
            TrackerError: the connection is lost, and everything before has been returned.
        """
        lost = self._receive()
        messages = []
        while (whole := self._next_pose()) is not None:
            try:
                messages.append(self._unpack(*whole))
            except Exception:  # pyigtl lets any exception of its unpacking through
                self.damaged += 1
        if lost is not None and not messages:
            raise lost
        return messages

    def close(self) -> None:
        self._connection.close()

    def _receive(self) -> TrackerError | None:
        """Receive what has arrived; returns why nothing more will come, if so."""
        cause = ""
        try:
            for _ in range(_READS_AT_ONCE):
                data = self._connection.recv(_READ_BYTES)
                if not data:
                    said = ", without sending anything" if self.is_silent else ""
                    cause = f"the server has closed the connection{said}"
                    break
                self.is_silent = False
                self._received += data
                self._skip()
        except OSError as error:
            if error.errno not in _NOT_YET:
                cause = f"no connection ({error.strerror})"
        cure = "check that an OpenIGTLink server runs there: PLUS, 3D Slicer"
        return TrackerError(f"{self._name}: {cause}", cure) if cause else None

    def _skip(self) -> None:
        count = min(self._to_skip, len(self._received))
        del self._received[:count]
        self._to_skip -= count

    def _next_pose(self) -> tuple[bytes, bytes] | None:
        """Header and body of the next message of `POSE_TYPES`; None until it has arrived."""
        received = self._received
        while True:
            self._skip()
            if received and received[0] != 0:
                raise self._foreign()
            if self._to_skip or len(received) < _HEADER_BYTES:
                return None
            form = _HEADER.fullmatch(received, 0, _TYPE_END)
            length = int.from_bytes(received[_LENGTH], "big")
            if form is None or length > _LONGEST_BODY_BYTES:
                raise self._foreign()
            kind = form["type"].decode("ascii")
            if kind in POSE_TYPES and length <= _LONGEST_POSE_BYTES:
                end = _HEADER_BYTES + length
                if len(received) < end:
                    return None
                whole = bytes(received[:_HEADER_BYTES]), bytes(received[_HEADER_BYTES:end])
                del received[:end]
                return whole
            self.skipped_types.add(kind)
            self._to_skip = _HEADER_BYTES + length

    def _foreign(self) -> ForeignPeerError:
        shown = bytes(self._received[:_SHOWN_BYTES])
        return ForeignPeerError(
            f"{self._name}: what answers there does not speak OpenIGTLink (it sent {shown!r})",
            "check address and port of the server; 18944 is usual",
        )


def igtl_opener(host: str, port: int) -> Callable[[], IgtlStream]:
    """Opens successive connections to a server; the first call waits until it is connected.

    Raises:
        ConfigError: pyigtl is not installed.
    """
    base = import_optional("pyigtl", "igtl", "tracker igtl://").MessageBase
    name = f"igtl://{joined(host, port)}"
    peer: tuple[int, Any] | None = None

    def unpack(header: bytes, body: bytes) -> Message:
        fields = base.parse_header(header)
        message = base.create_message(fields["message_type"])
        message.unpack(fields, body)
        return message

    def open_stream() -> IgtlStream:
        nonlocal peer
        try:
            if peer is None:
                connection = socket.create_connection((host, port), timeout=_CONNECT_S)
                peer = connection.family, connection.getpeername()
            else:
                connection = socket.socket(peer[0])
                connection.setblocking(False)
                connection.connect_ex(peer[1])
        except OSError as error:
            raise TrackerError(
                f"{name}: cannot be reached ({error.strerror or error})",
                "start the OpenIGTLink server (PLUS, 3D Slicer), check address and port",
            ) from None
        return IgtlStream(name, connection, unpack)

    return open_stream
