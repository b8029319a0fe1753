"""A host that speaks to a device and looks at its pins, tick by tick."""

from __future__ import annotations

from dataclasses import fields
from typing import TypeVar

import pytest

from ccr_host.link import messages as m
from ccr_host.link.framing import Frame, FrameDecoder, encode_frame
from tests.conformance.device import Device

SESSION = 0x5E55
_STEP_US = 100
_ANSWER_TIMEOUT_US = 15_000
_REAL_ANSWER_TIMEOUT_US = 200_000
"""Of a board in real time, which answers through this machine's scheduler."""
_AFTER_TICK_US = 500
R = TypeVar("R", bound=m.Message)

LIMITS = m.Limits((-8500, -6000), (8500, 6000), (0, 0))
SLEW = m.Slew((600, 500))
WATCHDOG = m.Watchdog(relax_after_ms=200, relax_slew_cdeg_tick=100, arm_axis_ms=60)
CALIBRATION = m.Calibration((3000, 3100), (2000, -1900), (1000, 1200), (5000, 4800))


class Host:
    """Speaks to a device and looks at its pins, tick by tick."""

    def __init__(self, device: Device) -> None:
        self.device = device
        self.telemetry: list[tuple[int, m.StateReport]] = []
        self._decoder = FrameDecoder()
        self._sequence = 100
        self._answer_timeout_us = _ANSWER_TIMEOUT_US if device.in_step else _REAL_ANSWER_TIMEOUT_US
        self._counted_before: m.CountersReply | None = None
        if not device.in_step:  # a real board was asked for its clock already
            self._counted_before = self.told(m.GetCounters(), m.CountersReply)

    # Bytes

    def exchange(self, data: bytes, wait_us: int = 0) -> list[Frame]:
        """Everything but telemetry that the board answers to raw bytes."""
        self.device.send(data)
        return self.listen(max(wait_us, self._answer_timeout_us))

    def listen(self, wait_us: int) -> list[Frame]:
        self.device.advance_to(self.device.since_reset_us() + wait_us)
        return self._answers()

    def ask_frame(self, message_id: int, sequence: int, payload: bytes) -> Frame:
        """The one answer to a frame, as soon as it is there."""
        self.device.send(encode_frame(message_id, sequence, payload))
        deadline_us = self.device.since_reset_us() + self._answer_timeout_us
        while self.device.since_reset_us() < deadline_us:
            self.device.advance_to(self.device.since_reset_us() + _STEP_US)
            answers = self._answers()
            if answers:
                (answer,) = answers
                return answer
        raise AssertionError(f"no answer to {message_id:#x}")

    def ask(self, request: m.Request, sequence: int | None = None) -> m.Message:
        if isinstance(request, m.SaveConfig) and not self.device.in_step:
            pytest.skip("a test neither wears nor changes the EEPROM of a board")
        if sequence is None:
            self._sequence = sequence = (self._sequence + 1) % 256
        answer = self.ask_frame(request.ID, sequence, request.pack())
        assert answer.sequence == sequence
        return m.MESSAGES[answer.id].unpack(answer.payload)

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

    # Time

    def next_tick(self) -> int:
        """Index of the control tick that comes next."""
        return max(0, -(-(self.device.since_reset_us() + 1 - m.TICK_PHASE_US) // m.TICK_US))

    def to_after_tick(self, tick: int) -> None:
        """Go to shortly after a control tick."""
        self.device.advance_to(m.TICK_PHASE_US + tick * m.TICK_US + _AFTER_TICK_US)

    def pulses_of_tick(self, tick: int) -> tuple[int, int]:
        """What is on the pins in the frame for which the tick has computed."""
        return self.device.pulses_in_frame(tick + 1)

    def pulses_now(self) -> tuple[int, int]:
        """What is on the pins in the current frame."""
        return self.device.pulses_in_frame(self.device.since_reset_us() // m.TICK_US)

    def report_of_tick(self, tick: int) -> m.StateReport:
        """The state shortly after a tick."""
        if not self.device.in_step:
            pytest.skip("single ticks take a simulator")
        self.to_after_tick(tick)
        report = self.report()
        assert report.tick == tick + 1
        return report

    # Shorthands

    def report(self) -> m.StateReport:
        return self.told(m.GetState(), m.StateReply).report

    def counters(self) -> m.CountersReply:
        """What has been counted since the start of the test."""
        counted = self.told(m.GetCounters(), m.CountersReply)
        before = self._counted_before
        if before is None:
            return counted
        names = [field.name for field in fields(counted)]
        return m.CountersReply(**{n: getattr(counted, n) - getattr(before, n) for n in names})

    def told(self, request: m.Request, reply: type[R]) -> R:
        answer = self.ask(request)
        assert isinstance(answer, reply), answer
        return answer

    def state(self) -> m.State:
        return self.report().state

    def boot(self) -> None:
        self.to_after_tick(m.BOOT_TICKS)

    def open_session(self, session: int = SESSION) -> None:
        self.told(m.OpenSession(m.SPEC_HASH, session), m.SessionReply)

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

    def arm(self) -> int:
        """Arm and wait for `hold`; gives the tick that made it."""
        self.done(m.Arm(SESSION))
        return self.wait_for(m.State.HOLD)

    def target(
        self, first_cdeg: int, second_cdeg: int = 0, *, ramp_ms: int = 0, validity_ms: int = 1000
    ) -> m.TargetReply:
        request = m.SetTarget(SESSION, (first_cdeg, second_cdeg), ramp_ms, validity_ms)
        return self.told(request, m.TargetReply)

    def wait_for(self, state: m.State, ticks: int = 1000) -> int:
        """Go on tick by tick until the state is reached; gives the tick that made it."""
        if not self.device.in_step:
            return self._poll_for(state, ticks)
        for tick in range(self.next_tick(), self.next_tick() + ticks):
            if self.report_of_tick(tick).state is state:
                return tick
        raise AssertionError(f"{state.name} was not reached in {ticks} ticks")

    def _poll_for(self, state: m.State, ticks: int) -> int:
        end = self.next_tick() + ticks
        while self.next_tick() < end:
            if self.state() is state:
                return self.next_tick() - 1
        raise AssertionError(f"{state.name} was not reached in {ticks} ticks")

    def save(self) -> None:
        """Save and wait until it is done."""
        self.done(m.SaveConfig(SESSION))
        self.to_after_tick(self.next_tick() + m.EEPROM_SLOT_SIZE)
        assert not self.report().flags & m.StatusFlags.EEPROM_BUSY

    def _answers(self) -> list[Frame]:
        answers = []
        for frame in self._decoder.feed(self.device.read()):
            assert isinstance(frame, Frame), "the board has sent what is no frame"
            if frame.id == m.Telemetry.ID:
                report = m.Telemetry.unpack(frame.payload).report
                self.telemetry.append((frame.sequence, report))
            else:
                answers.append(frame)
        return answers
