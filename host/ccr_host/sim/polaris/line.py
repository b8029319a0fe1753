"""The serial line between host and emulated camera, with its transmission time.

The host end is the driver's port. It runs in virtual time in process, in real time in a server.
`make_polaris` builds line and camera from a robot description.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Self

import numpy as np

from ccr_host.core.clock import NEVER_US
from ccr_host.core.errors import TrackerError
from ccr_host.core.wire import bytes_in, crc16_arc, wire_time_us
from ccr_host.description import simulation
from ccr_host.description.simulation import Tracker
from ccr_host.sim.polaris.device import RESET_BAUD, PolarisDevice
from ccr_host.sim.polaris.sensor import NO_FAULTS, PolarisFaults, PositionSensor, Span, is_within

PROCESSING_US = 1000
"""Time from the last byte of a command to the first of its reply (assumed)."""
RESET_US = 1_500_000
"""Time from a reset to its message (assumed; a real camera may take twice as long)."""

_CR = b"\r"
_LONGEST_COMMAND_BYTES = 1024


@dataclass(slots=True)
class _Sending:
    start_us: int
    data: bytes
    baud: int
    taken: int = 0


class PolarisLine:
    """Serial line to a camera; with `paced=False` transmission takes no time, as on TCP.

    ``rng`` is for garbled bytes. Host and camera must agree on the bit rate that paces them.
    """

    name = "ndi-emulator:"

    def __init__(
        self, device: PolarisDevice, rng: np.random.Generator, *, paced: bool = True
    ) -> None:
        self.device = device
        self.has_baud = self.has_break = paced
        self.device_baud = RESET_BAUD
        self._rng = rng
        self._paced = paced
        self._host_baud: int | None = None
        self._now_us = 0
        self._to_device: deque[tuple[int, bytes]] = deque()
        self._host_free_us = self._device_free_us = 0
        self._command = bytearray()
        self._replies: deque[_Sending] = deque()
        self._reset_us = NEVER_US
        self._power_failed_us = -1
        self._in_break = False

    @property
    def next_event_us(self) -> int:
        events = [self.device.sensor.next_exposure_us, self.next_turn_us]
        if self._replies:
            events.append(self._arrival_us(self._replies[0], len(self._replies[0].data)))
        return min(events)

    @property
    def next_turn_us(self) -> int:
        """Time of the next event that changes the line itself; exposures are the sensor's."""
        first_us = self._to_device[0][0] if self._to_device else NEVER_US
        return min(first_us, self._reset_us, self._next_power_failure_us())

    @property
    def next_arrival_us(self) -> int:
        """Time before which `read` neither ends a line nor fails; 0, the past, in garbage."""
        if any(self._differs(reply.baud) for reply in self._replies):
            return 0
        unplugged_us = self.device.sensor.faults.unplugged_us
        events = [start_us for start_us, end_us in unplugged_us if end_us > self._now_us]
        if self._replies:
            head = self._replies[0]
            # A damaged byte may be a carriage return, too.
            events.append(self._arrival_us(head, head.data.index(_CR, head.taken) + 1))
        return min(events, default=NEVER_US)

    def advance_to(self, time_us: int) -> None:
        while (event_us := self.next_turn_us) <= time_us:
            self._now_us = max(self._now_us, event_us)
            if self._next_power_failure_us() <= event_us:
                self._power_failed_us = event_us
                self._begin_reset(event_us)
            elif self._reset_us <= event_us:
                self._reset_us = NEVER_US
                self._send(event_us, "RESET")
            else:
                self._receive(*self._to_device.popleft())
        self._now_us = time_us

    def write(self, data: bytes) -> None:
        """Start to transmit bytes now; they are garbled if the bit rates differ."""
        self._require_plug()
        baud = self._host_baud or self.device_baud
        start_us = max(self._now_us, self._host_free_us)
        self._host_free_us = start_us + self._wire_time_us(len(data), baud)
        if self._differs(self.device_baud):
            data = self._garbage(len(data))
        self._to_device.append((self._host_free_us, data))

    def read(self) -> bytes:
        self._require_plug()
        taken = bytearray()
        while self._replies:
            head = self._replies[0]
            passed_us = self._now_us - head.start_us
            sent = len(head.data) if not self._paced else bytes_in(max(passed_us, 0), head.baud)
            sent = 0 if passed_us < 0 else min(sent, len(head.data))
            fresh = head.data[head.taken : sent]
            taken += self._garbage(len(fresh)) if self._differs(head.baud) else fresh
            head.taken = sent
            if sent < len(head.data):
                break
            self._replies.popleft()
        return bytes(taken)

    def set_baud(self, baud: int) -> None:
        """Set the host's bit rate; until then it equals the device's, as on a pty."""
        if self._paced:
            self._host_baud = baud

    def set_break(self, on: bool) -> None:
        """Set or clear the break condition; the device resets when a break ends."""
        if self._in_break and not on:
            self._begin_reset(self._now_us)
        self._in_break = on

    def open(self) -> Self:
        """Return the host end, as a driver opens it.

        Raises:
            TrackerError: the port is gone.
        """
        self._require_plug()
        return self

    def open_port(self, _boot_loader_us: int = 0) -> None:
        """Do nothing: opening its port does not affect a camera."""

    def close(self) -> None:
        """Forget the host's bit rate; the camera keeps running for the next host."""
        self._host_baud = None

    def _next_power_failure_us(self) -> int:
        resets_us = self.device.sensor.faults.resets_us
        return min((at for at in resets_us if at > self._power_failed_us), default=NEVER_US)

    def _require_plug(self) -> None:
        if is_within(self._now_us, self.device.sensor.faults.unplugged_us):
            self._replies.clear()
            raise TrackerError(f"{self.name} the port is gone", "plug the camera in again")

    def _receive(self, time_us: int, data: bytes) -> None:
        self._command += data
        while _CR in self._command:
            line, _, rest = bytes(self._command).partition(_CR)
            self._command = bytearray(rest)
            self._carry_out(line, time_us)
        if len(self._command) > _LONGEST_COMMAND_BYTES:
            self._command.clear()

    def _carry_out(self, line: bytes, time_us: int) -> None:
        is_resetting = self._reset_us != NEVER_US
        if is_resetting or is_within(time_us, self.device.sensor.faults.silent_us):
            return
        answer = self.device.execute(line, time_us + PROCESSING_US)
        if answer is None:
            self._begin_reset(time_us)
            return
        self._send(time_us + PROCESSING_US, answer.text)
        if answer.new_baud is not None:  # From now on: this answer goes at the old bit rate.
            self.device_baud = answer.new_baud

    def _begin_reset(self, time_us: int) -> None:
        self.device.reset()
        self.device_baud = RESET_BAUD
        self._command.clear()
        self._reset_us = time_us + RESET_US

    def _send(self, time_us: int, text: str) -> None:
        payload = text.encode("ascii")
        data = b"%s%04X\r" % (payload, crc16_arc(payload))
        if self._rng.random() < self.device.sensor.faults.bad_crc:
            data = self._with_a_changed_byte(data)
        start_us = max(time_us, self._device_free_us)
        self._device_free_us = start_us + self._wire_time_us(len(data), self.device_baud)
        self._replies.append(_Sending(start_us, data, self.device_baud))

    def _with_a_changed_byte(self, data: bytes) -> bytes:
        at = int(self._rng.integers(len(data) - 1))
        changed = data[at] ^ int(self._rng.integers(1, 128))
        return data[:at] + bytes([changed]) + data[at + 1 :]

    def _arrival_us(self, reply: _Sending, count: int) -> int:
        """When the first bytes of a reply have arrived."""
        return reply.start_us + self._wire_time_us(count, reply.baud)

    def _wire_time_us(self, count: int, baud: int) -> int:
        return wire_time_us(count, baud) if self._paced else 0

    def _differs(self, baud: int) -> bool:
        return self._host_baud is not None and self._host_baud != baud

    def _garbage(self, count: int) -> bytes:
        """Bytes as received at a wrong bit rate; never a carriage return."""
        return bytes(self._rng.integers(0x80, 0x100, count, dtype=np.uint8))


def faults_of(described: simulation.PolarisFaults, start_us: int | None) -> PolarisFaults:
    """Faults of a robot description.

    ``start_us`` is the zero of its times; None leaves out the timed faults.
    """
    lasting = PolarisFaults(
        shuffle=described.shuffle,
        phantoms=described.phantoms,
        occlusion=described.occlusion,
        bad_crc=described.bad_crc,
    )
    if start_us is None:
        return lasting

    def spans_us(spans_s: Sequence[tuple[float, float]]) -> tuple[Span, ...]:
        return tuple((_at(start_us, begin), _at(start_us, end)) for begin, end in spans_s)

    return replace(
        lasting,
        occluded_us=spans_us(described.occluded_s),
        out_of_volume_us=spans_us(described.out_of_volume_s),
        silent_us=spans_us(described.silent_s),
        unplugged_us=spans_us(described.unplugged_s),
        resets_us=tuple(_at(start_us, time_s) for time_s in described.reset_s),
    )


def _at(start_us: int, time_s: float) -> int:
    return start_us + round(time_s * 1e6)


def make_polaris(
    tracker: Tracker,
    seed: np.random.SeedSequence,
    *,
    faults: PolarisFaults = NO_FAULTS,
    paced: bool = True,
) -> PolarisLine:
    """An emulated Vicra with the noise, faults and misalignment of a robot description's tracker.

    Its rate is the Vicra's 20 Hz; `tracker.rate_hz` is ignored. ``paced`` is False if the bytes
    travel over TCP.
    """
    optics_seed, line_seed = seed.spawn(2)
    sensor = PositionSensor(np.random.default_rng(optics_seed), tracker, faults=faults)
    return PolarisLine(PolarisDevice(sensor), np.random.default_rng(line_seed), paced=paced)
