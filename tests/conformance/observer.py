"""What can be seen of a board, tick by tick: in step with it, or from its port alone.

Both are exact to a tick. In step, because time stands still meanwhile. From the port, because the
board sends answers and one report a tick through one stream: what stands before and after an answer
was so before and after the request, however late a busy machine reads it.
"""

from __future__ import annotations

from typing import Protocol

from ccr_host.link import messages as m
from tests.conformance.device import Pulses, SteppedDevice
from tests.conformance.talk import Talk

_AFTER_TICK_US = 500
_LATE_US = 5_000_000
"""Time after which a report counts as lost, even on a loaded machine."""


class Observer(Protocol):
    """Ticks are numbered as in the spec: tick k makes the report that gives k + 1."""

    def session_opened(self, session: int) -> None:
        """Called once the board can be asked for a stream of reports."""

    def was_reset(self) -> None:
        """Called when the board restarts."""

    def next_tick(self) -> int:
        """The first tick after the last answer, or after the last observed tick."""

    def go_past(self, tick: int) -> None:
        """Return shortly after that tick."""

    def report_of_tick(self, tick: int) -> m.StateReport:
        """The state right after a tick."""

    def pulses_of_tick(self, tick: int) -> Pulses:
        """Pulses that the tick has prepared for the next frame."""

    def pulses_through(self, last_tick: int) -> set[Pulses]:
        """Those of the next tick and of all until that one."""


class InStepObserver:
    """Reads the pins, and queries the state after the tick."""

    def __init__(self, talk: Talk, device: SteppedDevice) -> None:
        self._talk = talk
        self._device = device

    def session_opened(self, session: int) -> None:
        pass

    def was_reset(self) -> None:
        pass

    def next_tick(self) -> int:
        return max(0, -(-(self._device.since_reset_us() + 1 - m.TICK_PHASE_US) // m.TICK_US))

    def go_past(self, tick: int) -> None:
        self._device.advance_to(m.TICK_PHASE_US + tick * m.TICK_US + _AFTER_TICK_US)

    def report_of_tick(self, tick: int) -> m.StateReport:
        self.go_past(tick)
        report = ask_report(self._talk)
        assert report.tick == tick + 1
        return report

    def pulses_of_tick(self, tick: int) -> Pulses:
        return self._device.pulses_in_frame(tick + 1)

    def pulses_through(self, last_tick: int) -> set[Pulses]:
        return {self.pulses_of_tick(tick) for tick in range(self.next_tick(), last_tick + 1)}


class PortObserver:
    """Reads a report of every tick; without a session it asks as often as it can.

    Pulses are those that the board says it has computed.
    """

    def __init__(self, talk: Talk) -> None:
        self._talk = talk
        self._streaming = False

    def session_opened(self, session: int) -> None:
        self._talk.ask_frame(m.SetTelemetry.ID, 0, m.SetTelemetry(session, 1).pack())
        self._streaming = True
        self._read_report()

    def was_reset(self) -> None:
        self._streaming = False

    def next_tick(self) -> int:
        newest = self._talk.stream[-1][1] if self._streaming else ask_report(self._talk)
        return newest.tick

    def go_past(self, tick: int) -> None:
        while self.next_tick() <= tick:
            if self._streaming:
                self._read_report()

    def report_of_tick(self, tick: int) -> m.StateReport:
        assert self._streaming, "without a session there is no report of each tick"
        self.go_past(tick)
        for _, report in reversed(self._talk.stream):
            if report.tick == tick + 1:
                return report
        raise AssertionError(f"the report of tick {tick} was lost")

    def pulses_of_tick(self, tick: int) -> Pulses:
        return self.report_of_tick(tick).pulse_half_us

    def pulses_through(self, last_tick: int) -> set[Pulses]:
        if self._streaming:
            return {self.pulses_of_tick(tick) for tick in range(self.next_tick(), last_tick + 1)}
        first_tick = self.next_tick()
        seen = set()
        while (report := ask_report(self._talk)).tick <= last_tick:
            if report.tick > first_tick:
                seen.add(report.pulse_half_us)
        return seen

    def _read_report(self) -> None:
        device = self._talk.device
        known = len(self._talk.stream)
        deadline_us = device.since_reset_us() + _LATE_US
        while len(self._talk.stream) == known:
            frame = self._talk.read_frame(deadline_us)
            assert frame, "the board has ceased to report"
            assert frame.id == m.Telemetry.ID, "the board says what it was not asked for"


def ask_report(talk: Talk) -> m.StateReport:
    """The state now, without a session."""
    answer = talk.ask_frame(m.GetState.ID, 0, b"")
    assert answer.id == m.StateReply.ID
    return m.StateReply.unpack(answer.payload).report
