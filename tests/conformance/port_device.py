"""A board on a port, in real time: an UNO, or a simulated one served by another program."""

from __future__ import annotations

import pytest

from ccr_host.core.clock import Clock
from ccr_host.core.errors import DeviceError
from ccr_host.link import messages as m
from ccr_host.link.board import BOOT_TIMEOUT_US
from ccr_host.link.device_errors import BoardSilentError
from ccr_host.link.framing import Frame, FrameDecoder, encode_frame
from ccr_host.link.transport import DeviceUri, open_transport

_NOTICE_CLOSED_US = (100_000, 500_000, 2_500_000)
"""How long the port stays closed until its opening resets the board. `ccr-host emulate` looks every
20 ms whether its client has left, on a busy machine less often."""
_PING_PERIOD_US = 25_000
"""Longer than the slowest USB adapter takes (16 ms latency timer): one answer at a time is due."""
_LOOK_PERIOD_US = 1_000
_ANSWER_TIMEOUT_US = 5_000_000
"""Margin for a loaded machine; no result depends on it."""


class PortDevice:
    """The board is reset by opening its port (DTR); neither pins nor EEPROM can be reached.

    Raises:
        DeviceError: no such port, port in use, or no board with this firmware behind it.
    """

    in_step = False
    answer_timeout_us = _ANSWER_TIMEOUT_US

    def __init__(self, uri: DeviceUri, clock: Clock) -> None:
        self.name = str(uri)
        self._uri = uri
        self._clock = clock
        self._open()

    def send(self, data: bytes) -> None:
        self._port.write(data)

    def advance_to(self, since_reset_us: int) -> None:
        self._clock.sleep_until_us(self._reset_us + since_reset_us)

    def since_reset_us(self) -> int:
        return self._clock.now_us() - self._reset_us

    def read(self) -> bytes:
        return self._port.read()

    def reset(self, cause: m.ResetCause) -> None:
        if cause is not m.ResetCause.EXTERNAL:
            pytest.skip(f"a port cannot cause a {cause.name.lower()} reset")
        before_us = self._clock.now_us()
        for closed_us in _NOTICE_CLOSED_US:
            self._port.close()
            self._clock.sleep_until_us(self._clock.now_us() + closed_us)
            self._open()
            if self._reset_us > before_us:
                return

    def close(self) -> None:
        self._port.close()

    def _open(self) -> None:
        self._port = open_transport(self._uri)
        try:
            self._reset_us = self._wait_until_it_listens()
        except DeviceError:
            self._port.close()
            raise

    def _wait_until_it_listens(self) -> int:
        """Returns the time of the board's reset, as its own clock tells it."""
        clock = self._clock
        decoder = FrameDecoder()
        deadline_us = clock.now_us() + BOOT_TIMEOUT_US
        heard = 0
        pings = 0
        next_ping_us = clock.now_us()
        while clock.now_us() < deadline_us:
            if clock.now_us() >= next_ping_us:
                pings += 1
                ping = encode_frame(m.ClockSync.ID, 0, m.ClockSync(pings).pack())
                self._port.write(bytes([m.FRAME_DELIMITER]) + ping)
                next_ping_us = clock.now_us() + _PING_PERIOD_US
            clock.sleep_until_us(clock.now_us() + _LOOK_PERIOD_US)
            data = self._port.read()
            heard += len(data)
            for frame in decoder.feed(data):
                if not (isinstance(frame, Frame) and frame.id == m.ClockReply.ID):
                    continue
                reply = m.ClockReply.unpack(frame.payload)
                if reply.host_time_us == pings:  # nothing more is under way
                    return clock.now_us() - reply.board_time_us
                next_ping_us = clock.now_us() + _PING_PERIOD_US
        if heard:
            raise DeviceError(
                f"{self.name}: what is there does not speak this protocol",
                "check that the port is the right one; flash the board: ccr-host flash",
            )
        raise BoardSilentError(self.name, m.ClockSync.NAME)
