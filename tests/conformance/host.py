"""A host for the tests: queries a board, waits for its ticks, observes its pulses."""

from __future__ import annotations

from dataclasses import fields
from typing import TypeVar, cast

from ccr_host.link import messages as m
from ccr_host.link.board_config import BoardConfig
from ccr_host.link.framing import Frame, encode_frame
from tests.conformance.device import AXES, Device, SteppedDevice
from tests.conformance.observer import InStepObserver, Observer, PortObserver, Pulses, ask_report
from tests.conformance.talk import Talk

SESSION = 0x5E55
_ATTEMPTS = 10
R = TypeVar("R", bound=m.Message)

LIMITS = m.Limits((-8500, -6000), (8500, 6000), (0, 0))
SLEW = m.Slew((600, 500))
WATCHDOG = m.Watchdog(relax_after_ms=1000, relax_slew_cdeg_tick=100, arm_axis_ms=100)
"""Long enough for a test in real time to act while the board is in `arming` or `hold`."""
CALIBRATION = m.Calibration((3000, 3100), (2000, -1900), (1000, 1200), (5000, 4800))

RELAX_TICKS = WATCHDOG.relax_after_ms * 1000 // m.TICK_US
AXIS_TICKS = WATCHDOG.arm_axis_ms * 1000 // m.TICK_US


class Host:
    """The board may have been used before: it counts from zero again, but keeps its state."""

    def __init__(self, device: Device) -> None:
        self.device = device
        self.talk = Talk(device)
        self._observer: Observer = (
            InStepObserver(self.talk, cast(SteppedDevice, device))
            if device.in_step
            else PortObserver(self.talk)
        )
        self._sequence = 100
        self._counted_before: m.CountersReply | None = None
        self._errors_before = 0
        if not device.in_step:
            self._errors_before = self.report().link_errors
            self._counted_before = self.told(m.GetCounters(), m.CountersReply)

    # Frames

    def exchange(self, data: bytes, wait_us: int = m.TICK_US) -> list[Frame]:
        """All that the board answers to raw bytes, the last of them a zero."""
        return self.talk.exchange(data, wait_us)

    def listen(self, wait_us: int) -> list[Frame]:
        return self.talk.listen(wait_us)

    def ask_frame(self, message_id: int, sequence: int, payload: bytes) -> Frame:
        """The answer to a frame, as soon as it is there."""
        return self.talk.ask_frame(message_id, sequence, payload)

    def ask(self, request: m.Request, sequence: int | None = None) -> m.Message:
        if sequence is None:
            self._sequence = sequence = (self._sequence + 1) % 256
        answer = self.ask_frame(request.ID, sequence, request.pack())
        assert answer.sequence == sequence
        return m.MESSAGES[answer.id].unpack(answer.payload)

    def told(self, request: m.Request, reply: type[R]) -> R:
        """The answer, which must be of that kind."""
        answer = self.ask(request)
        assert isinstance(answer, reply), answer
        return answer

    def done(self, request: m.Request, sequence: int | None = None) -> m.Message:
        """The answer, which must not be a refusal."""
        answer = self.ask(request, sequence)
        assert not isinstance(answer, m.Nack), answer
        return answer

    def refusal(self, request: m.Request, sequence: int | None = None) -> tuple[m.NackCode, int]:
        """Code and detail of the refusal that the request must get."""
        answer = self.ask(request, sequence)
        assert isinstance(answer, m.Nack), answer
        assert answer.request == request.ID
        return answer.code, answer.detail

    def stream(self, reports: int) -> list[tuple[int, m.StateReport]]:
        """The first reports of the stream since the last answer, with their sequence numbers."""
        while len(self.talk.stream_since_answer) < reports:
            self.listen(m.TICK_US)
        return self.talk.stream_since_answer[:reports]

    # Ticks; see Observer

    def next_tick(self) -> int:
        """The first tick after the last answer, or after the last tick that was looked at."""
        return self._observer.next_tick()

    def go_past(self, tick: int) -> None:
        self._observer.go_past(tick)

    def wait_ticks(self, ticks: int) -> None:
        """Let so many more ticks pass."""
        self.go_past(self.next_tick() + ticks - 1)

    def report_of_tick(self, tick: int) -> m.StateReport:
        return self._observer.report_of_tick(tick)

    def pulses_of_tick(self, tick: int) -> Pulses:
        return self._observer.pulses_of_tick(tick)

    def pulses_through(self, last_tick: int) -> set[Pulses]:
        return self._observer.pulses_through(last_tick)

    def wait_for(self, state: m.State, ticks: int = 1000) -> int:
        """Go on tick by tick until the state is reached; gives the tick that made it."""
        first = self.next_tick()
        for tick in range(first, first + ticks):
            if self.report_of_tick(tick).state is state:
                return tick
        raise AssertionError(f"{state.name} was not reached in {ticks} ticks")

    # Reading

    def hello(self) -> m.HelloReply:
        return self.told(m.Hello(m.PROTOCOL_VERSION, m.SPEC_HASH), m.HelloReply)

    def report(self) -> m.StateReport:
        """The state now."""
        return ask_report(self.talk)

    def state(self) -> m.State:
        return self.report().state

    def link_errors(self) -> int:
        """Since the start of the test."""
        return self.report().link_errors - self._errors_before

    def counters(self) -> m.CountersReply:
        """What has been counted since the start of the test."""
        counted = self.told(m.GetCounters(), m.CountersReply)
        before = self._counted_before
        if before is None:
            return counted
        names = [field.name for field in fields(counted)]
        return m.CountersReply(**{n: getattr(counted, n) - getattr(before, n) for n in names})

    def config(self) -> BoardConfig:
        return BoardConfig(
            limits=self.told(m.GetLimits(), m.LimitsReply).limits,
            slew=self.told(m.GetSlew(), m.SlewReply).slew,
            watchdog=self.told(m.GetWatchdog(), m.WatchdogReply).watchdog,
            calibration=self.told(m.GetCalibration(), m.CalibrationReply).calibration,
            acceleration=self.told(m.GetAcceleration(), m.AccelerationReply).acceleration,
        )

    # Doing

    def reset(self, cause: m.ResetCause = m.ResetCause.EXTERNAL) -> None:
        """Returns as soon as the board listens, in `boot`."""
        self.device.reset(cause)
        self.talk.forget()
        self._observer.was_reset()
        self._counted_before = None
        self._errors_before = 0

    def reset_into_boot(self) -> None:
        """Again if a busy machine has noticed too late that the board listens."""
        for _ in range(_ATTEMPTS):
            self.reset()
            if self.state() is m.State.BOOT:
                return
        raise AssertionError("the board was never seen in boot")

    def boot(self) -> None:
        """Wait until `boot` is over."""
        self.go_past(m.BOOT_TICKS)

    def open_session(self, session: int = SESSION) -> None:
        self.told(m.OpenSession(m.SPEC_HASH, session), m.SessionReply)
        self._observer.session_opened(session)

    def clear_latch(self) -> None:
        """Out of `fault` and `stopped`."""
        if self.state() in (m.State.FAULT, m.State.STOPPED):
            self.wait_ticks(1)
            self.done(m.ClearFault(SESSION))

    def configure(
        self,
        limits: m.Limits = LIMITS,
        slew: m.Slew = SLEW,
        watchdog: m.Watchdog = WATCHDOG,
        calibration: m.Calibration = CALIBRATION,
    ) -> None:
        self.done(m.SetLimits(SESSION, limits))
        self.done(m.SetSlew(SESSION, slew))
        self.done(m.SetWatchdog(SESSION, watchdog))
        self.done(m.SetCalibration(SESSION, calibration))

    def forget_setpoint(self) -> None:
        """Clamp the setpoint that the board remembers to 0, between two sets of limits."""
        for least, greatest in ((0, 1), (-1, 0)):
            limits = m.Limits((least, least), (greatest, greatest), (0, 0))
            self.done(m.SetLimits(SESSION, limits))

    def arm(self) -> int:
        """Arm and wait for `hold`; gives the tick that made it."""
        self.done(m.Arm(SESSION))
        return self.wait_for(m.State.HOLD)

    def target(
        self, first_cdeg: int, second_cdeg: int = 0, *, ramp_ms: int = 0, validity_ms: int = 1000
    ) -> m.TargetReply:
        request = m.SetTarget(SESSION, (first_cdeg, second_cdeg), ramp_ms, validity_ms)
        return self.told(request, m.TargetReply)

    def save(self) -> None:
        """Save and wait until it is done."""
        self.done(m.SaveConfig(SESSION))
        self.wait_ticks(m.eeprom_slot_size(AXES) + 1)
        assert not self.report().flags & m.StatusFlags.EEPROM_BUSY

    def make_safe(self) -> None:
        """Stop, and let the board fall silent, whatever was going on."""
        answers = self.exchange(bytes([m.FRAME_DELIMITER]) + encode_frame(m.Stop.ID, 0, b""))
        stopped = m.Ack(m.Stop.ID, m.State.STOPPED).pack()
        assert stopped in [answer.payload for answer in answers], "the board does not stop"
        self.ask(m.OpenSession(m.SPEC_HASH, SESSION + 1))  # which ends the stream; not during boot
        self.listen(m.TICK_US)
