"""Random requests to a board: mostly valid commands, some invalid, some damaged in transit."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from ccr_host.link import messages as m
from ccr_host.link.framing import encode_frame
from ccr_host.link.messages import State
from tests.conformance.device import AXES

SESSIONS = (0x5E55, 0x0102)

_LATCHED = (State.FAULT, State.STOPPED)
_MOVING = (State.ACTIVE, State.HOLD, State.RELAXING)
_CONFIGURABLE = (State.DISARMED, *_LATCHED)


@dataclass
class Script:
    """Draws the bytes of a host in one frame of 20 ms, given the board's state."""

    rng: np.random.Generator
    accelerations: bool = False
    """Whether acceleration limits are set, too."""
    tick: int | None = None
    """Number of the next tick if targets for later ticks are drawn, too; kept by the caller."""
    axes: int = AXES
    commands: int = 0
    _sequence: int = 0
    _last: bytes = b""
    _session: int = SESSIONS[0]
    _quiet_ticks: int = 0
    history: list[str] = field(default_factory=list)

    def next_frame(self, state: State) -> bytes:
        """Bytes to send in the next frame; none in a pause."""
        if self._quiet_ticks > 0:
            self._quiet_ticks -= 1
            return b""
        if self._chance(0.03):
            self._quiet_ticks = int(self.rng.integers(1, 40))
        count = int(self.rng.choice([1, 2, 3], p=[0.5, 0.3, 0.2]))
        self.commands += count
        return b"".join(self._one(state) for _ in range(count))

    def say(self, *requests: m.Request) -> bytes:
        """Requests chosen by the caller, with the next sequence numbers."""
        return b"".join(self._framed(request.ID, request.pack()) for request in requests)

    @property
    def session(self) -> int:
        """That which its requests carry."""
        return self._session

    def _one(self, state: State) -> bytes:
        if self._last and self._chance(0.05):
            return self._note("again", self._last)
        if self._chance(0.03):
            return self._note("junk", self.rng.bytes(int(self.rng.integers(1, 70))) + b"\0")
        if self._chance(0.04):
            payload = self.rng.bytes(int(self.rng.integers(0, m.MAX_PAYLOAD.of(self.axes) + 1)))
            return self._framed(int(self.rng.integers(0, 256)), payload)
        request = self._request(state)
        frame = self._framed(request.ID, request.pack())
        return self._damaged(frame) if self._chance(0.08) else frame

    def _request(self, state: State) -> m.Request:
        rng, session = self.rng, self._session
        if self._chance(0.02):
            self._session = session = int(rng.choice(SESSIONS))
        if state in _LATCHED and self._chance(0.3):
            return m.ClearFault(session)
        if state is State.DISARMED and self._chance(0.3):
            return m.Arm(session)
        if state in _MOVING and self.tick is not None and self._chance(0.1):
            return self._timed_target(self.tick)
        if state in _MOVING and self._chance(0.5):
            return self._target()
        if state in _CONFIGURABLE and self._chance(0.4):
            return self._configuration()
        return self._any_request()

    def _any_request(self) -> m.Request:
        session = self._session
        choices: list[m.Request] = [
            m.Hello(int(self.rng.integers(0, 256)), int(self.rng.integers(0, 2**32))),
            m.OpenSession(m.SPEC_HASH ^ int(self._chance(0.1)), session),
            m.OpenSession(m.SPEC_HASH, session),
            m.ClockSync(int(self.rng.integers(0, 2**32))),
            m.GetState(),
            m.GetLinkLimits(),
            m.Blink(self._integer(0, 3)),
            m.GetCounters(),
            m.GetLimits(),
            m.GetSlew(),
            m.GetWatchdog(),
            m.GetCalibration(),
            m.GetEquipment(),
            m.GetAcceleration(),
            m.GetFaultRecord(self._integer(0, 8)),
            m.SetTelemetry(session, int(self.rng.integers(0, 6))),
            self._target(),
            self._target(),
            self._configuration(),
        ]
        if self.tick is not None:
            choices.append(self._timed_target(self.tick))
        if self._chance(0.15):
            choices = [m.Disarm(session), m.Stop(), m.SaveConfig(session), m.Arm(session)]
        return choices[int(self.rng.integers(len(choices)))]

    def _target(self) -> m.SetTarget:
        wide = self._chance(0.1)
        angle = 20_000 if wide else 9_000
        return m.SetTarget(
            self._session,
            self._integers(-angle, angle),
            ramp_ms=self._integer(0, 10_100) if wide else self._integer(0, 400),
            validity_ms=self._integer(0, 10_100) if wide else self._integer(20, 600),
        )

    def _timed_target(self, tick: int) -> m.SetTargetAt:
        target = self._target()
        times = target.ramp_ms, target.validity_ms
        later = max(tick + self._integer(-2, 10), 0)
        return m.SetTargetAt(target.session, target.target_cdeg, *times, later)

    def _configuration(self) -> m.Request:
        session = self._session
        beyond = 1.1 if self._chance(0.2) else 1.0
        match self._integer(0, 5 if self.accelerations else 4):
            case 5:
                top = 300 if self._chance(0.5) else int(2000 * beyond)
                limits = self._by_axis(
                    lambda: self._integer(0, top),
                    lambda: self._integer(0, 20) * self._integer(0, 1),
                )
                return m.SetAcceleration(session, m.Acceleration(limits))
            case 4:
                name = tuple(self.rng.integers(0, 256, 16).tolist())
                stop, full = self._integer(0, int(2 * beyond)), self._integer(0, 255)
                return m.SetEquipment(session, m.Equipment(name, stop, full, full // 2))
            case 0:
                low = self._integers(-9000, 0)
                high = self._integers(1, 9000)
                rest = self._integers(-300, 300)
                return m.SetLimits(session, m.Limits(low, high, rest))
            case 1:
                top = int(800 * beyond**10)
                slews = self._by_axis(lambda: self._integer(10, top), lambda: self._integer(5, top))
                return m.SetSlew(session, m.Slew(slews))
            case 2:
                return m.SetWatchdog(
                    session,
                    m.Watchdog(
                        relax_after_ms=self._integer(20, 500),
                        relax_slew_cdeg_tick=self._integer(10, int(500 * beyond)),
                        # All axes together take as long, or hardly any arming would end.
                        arm_axis_ms=self._integer(20, max(40, 400 // max(self.axes, 2))),
                    ),
                )
            case _:
                return m.SetCalibration(
                    session,
                    m.Calibration(
                        neutral_half_us=self._integers(2800, 3200),
                        per_90_deg_half_us=self._by_axis(
                            lambda: self._integer(100, 3000),
                            lambda: -self._integer(int(90 / beyond), 3000),
                        ),
                        pulse_min_half_us=self._by_axis(
                            lambda: 1000, lambda: self._integer(1000, 2000)
                        ),
                        pulse_max_half_us=self._by_axis(
                            lambda: 5000, lambda: self._integer(4000, int(5000 * beyond))
                        ),
                    ),
                )

    def _framed(self, message_id: int, payload: bytes) -> bytes:
        self._sequence = (self._sequence + 1) % 256
        self._last = encode_frame(message_id, self._sequence, payload)
        name = m.MESSAGES[message_id].NAME if message_id in m.MESSAGES else f"{message_id:#x}"
        return self._note(name, self._last)

    def _damaged(self, frame: bytes) -> bytes:
        data = bytearray(frame)
        at = self._integer(0, len(data) - 1)
        match self._integer(0, 3):
            case 0:
                data[at] ^= 1 << self._integer(0, 7)
            case 1:
                del data[at]
            case 2:
                data.insert(at, data[at])
            case _:
                del data[at:]
        return self._note("damaged", bytes(data))

    def _note(self, what: str, data: bytes) -> bytes:
        self.history.append(f"{what} {data.hex()}")
        return data

    def _chance(self, probability: float) -> bool:
        return bool(self.rng.random() < probability)

    def _integers(self, low: int, high: int) -> tuple[int, ...]:
        return tuple(self._integer(low, high) for _ in range(self.axes))

    def _by_axis(self, odd: Callable[[], int], even: Callable[[], int]) -> tuple[int, ...]:
        """Draw for each axis; the first one is an odd one."""
        return tuple(even() if axis % 2 else odd() for axis in range(self.axes))

    def _integer(self, low: int, high: int) -> int:
        return int(self.rng.integers(low, high + 1))
