"""The safety state machine: a table of transitions and one deadline, counted in control ticks."""

from __future__ import annotations

from typing import Final

from ccr_host.link.messages import BOOT_TICKS, TRANSITIONS, Event, Fault, ResetCause, State

PULSING_STATES: Final = frozenset(
    {State.ARMING, State.ACTIVE, State.HOLD, State.RELAXING, State.DISARMING}
)

_FAULT_AFTER_RESET: Final = {
    ResetCause.WATCHDOG: Fault.WATCHDOG_RESET,
    ResetCause.BROWN_OUT: Fault.BROWN_OUT_RESET,
}


class SafetyMachine:
    """State, first fault, and which axes may have pulses."""

    def __init__(self, reset_cause: ResetCause, had_pulses: bool, axes: int) -> None:
        self.state = State.BOOT
        self.fault = Fault.NONE
        self._fault_after_boot = _FAULT_AFTER_RESET.get(reset_cause)
        if reset_cause is ResetCause.UNKNOWN and had_pulses:
            self._fault_after_boot = Fault.RESET_WHILE_ARMED
        self._deadline_tick = BOOT_TICKS
        self._axes = axes
        self._axis_ticks: tuple[int, ...] = ()
        self._enabled = (False,) * axes

    @property
    def pulsing(self) -> bool:
        """Whether the state allows pulses at all."""
        return self.state in PULSING_STATES

    def arm(self, tick: int, axis_ticks: int) -> None:
        """Enable axis 1 at `tick` and each further one `axis_ticks` after the one before."""
        self._apply(Event.ARM_REQUESTED)
        self._axis_ticks = tuple(tick + axis * axis_ticks for axis in range(self._axes))
        self._enabled = tuple(axis == 0 for axis in range(self._axes))
        self._deadline_tick = tick + self._axes * axis_ticks

    def disarm(self) -> None:
        """Start the return to rest; axes without pulses are not enabled any more."""
        self._apply(Event.DISARM_REQUESTED)

    def stop(self) -> None:
        """Latch the emergency stop."""
        self._apply(Event.STOP_REQUESTED)

    def clear(self) -> None:
        self._apply(Event.CLEAR_REQUESTED)
        self.fault = Fault.NONE

    def accept_target(self, expiry_tick: int) -> None:
        """Follow a target until its validity expires."""
        self._apply(Event.TARGET_ACCEPTED)
        self._deadline_tick = expiry_tick

    def raise_fault(self, fault: Fault) -> None:
        """Latch a fault; only the first one is kept."""
        if self.fault is Fault.NONE:
            self.fault = fault
        self._apply(Event.FAULT_RAISED)

    def tick(self, tick: int, at_rest: bool, relax_after_ticks: int) -> Event | None:
        """Make the transition due by time or position, if any, and return its event."""
        event = self._due_event(tick, at_rest)
        if event is None:
            return None
        if event is Event.FAULT_RAISED and self._fault_after_boot:
            self.raise_fault(self._fault_after_boot)
            return event
        was_relaxing = self.state is State.RELAXING
        self._apply(event)
        if self.state is State.HOLD:
            self._deadline_tick = tick + relax_after_ticks
        if was_relaxing:
            self.fault = Fault.LINK_LOSS
        return event

    def rest_wanted(self, tick: int) -> bool:
        """Whether this state moves the setpoint to rest."""
        if self.state is State.ARMING:
            return tick >= self._deadline_tick
        return self.state in (State.RELAXING, State.DISARMING)

    def axes_with_pulses(self, tick: int) -> tuple[bool, ...]:
        """Whether each axis gets a pulse in the frame prepared by this tick."""
        if not self.pulsing:
            self._enabled = (False,) * self._axes
        elif self.state is State.ARMING:
            self._enabled = tuple(map(tick.__ge__, self._axis_ticks))
        return self._enabled

    def _due_event(self, tick: int, at_rest: bool) -> Event | None:
        due = tick >= self._deadline_tick
        match self.state:
            case State.BOOT if due:
                return Event.FAULT_RAISED if self._fault_after_boot else Event.SELF_TEST_PASSED
            case State.ARMING if due and at_rest:
                return Event.AXES_ENABLED
            case State.ACTIVE if due:
                return Event.TARGET_EXPIRED
            case State.HOLD if due:
                return Event.HOLD_EXPIRED
            case State.RELAXING | State.DISARMING if at_rest:
                return Event.REST_REACHED
            case _:
                return None

    def _apply(self, event: Event) -> None:
        self.state = TRANSITIONS.get((self.state, event), self.state)
