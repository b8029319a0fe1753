"""Somebody beside a run who may stop or pause it: the buttons of the live page."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Protocol

from ccr_host.core.clock import Clock
from ccr_host.link.client import Client
from ccr_host.link.messages import TICK_US
from ccr_host.run.observer import RunObserver

_UNTIL_SHOWN_US = 3 * TICK_US
"""After so long the board's reports show that the pulses are gone, and so does the log."""


class Operator(Protocol):
    """Asked in the control loop's own thread, every millisecond: answers at once."""

    @property
    def wants_stop(self) -> bool:
        """Whether the robot must stop now; once true, true for good."""
        ...

    @property
    def wants_pause(self) -> bool:
        """Whether the path has to wait.

        Raises:
            CcrError: nobody is there any more who could end the pause.
        """
        ...

    def news(self) -> str:
        """What has become of the operator's page since last asked, one thing; empty: nothing."""
        ...


class NoOperator:
    """Nobody is there."""

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
    """Obey the operator's stop wherever the run waits: the protocol's emergency stop.

    The operator's news are events of the run.

    Raises:
        OperatorStop: after the board has acknowledged.
        DeviceError: it does not.
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
    """Ends whatever waits on the clock, once: the emergency stop itself has to wait as well."""

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
