"""An operator who can stop or pause a run, with the buttons of the live page."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Protocol

from ccr_host.core.clock import Clock
from ccr_host.link.client import Client
from ccr_host.link.messages import TICK_US
from ccr_host.run.observer import RunObserver

_UNTIL_SHOWN_US = 3 * TICK_US
"""Time until reports, and so the log, show that the pulses have ended."""


class Operator(Protocol):
    """Asked every millisecond in the control loop's thread; must answer at once."""

    @property
    def wants_stop(self) -> bool:
        """Whether the robot must stop now; once true, it stays true."""
        ...

    @property
    def wants_pause(self) -> bool:
        """Whether the path must wait.

        Raises:
            CcrError: the operator who could end the pause is gone.
        """
        ...

    def news(self) -> str:
        """One change of the operator's page since the last call; empty if there is none."""
        ...


class NoOperator:
    """No operator."""

    wants_stop = False
    wants_pause = False

    def news(self) -> str:
        return ""


class OperatorStop(KeyboardInterrupt):
    """The operator has ended the run; like Ctrl-C, but the robot is stopped, not disarmed."""

    def __init__(self) -> None:
        super().__init__("stopped by the operator")


@contextmanager
def stopping_at_once(
    operator: Operator, clock: Clock, client: Client, observer: RunObserver
) -> Iterator[None]:
    """Execute the operator's stop, an emergency stop, wherever the run waits.

    The operator's news becomes events of the run.

    Raises:
        OperatorStop: after the board has acknowledged.
        DeviceError: the board does not acknowledge.
    """
    if not isinstance(operator, NoOperator):
        clock.attach(_StopKey(operator, observer))
    try:
        yield
    except OperatorStop:
        client.stop()
        clock.sleep_until_us(clock.now_us() + _UNTIL_SHOWN_US)
        raise


class _StopKey:
    """Ends a wait on the clock, but only once, as the emergency stop itself must also wait."""

    def __init__(self, operator: Operator, observer: RunObserver) -> None:
        self._operator = operator
        self._observer = observer
        self._pressed = False

    def advance_to(self, time_us: int) -> None:
        if news := self._operator.news():
            self._observer.event(time_us, news)
        if self._operator.wants_stop and not self._pressed:
            self._pressed = True
            raise OperatorStop
