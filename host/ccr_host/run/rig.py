"""What a control loop works with on hardware, the twin or a recording: its rig, and an operator."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections import deque
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol

from ccr_host.core.arrays import Array
from ccr_host.core.clock import Clock
from ccr_host.link.client import Client
from ccr_host.link.messages import TICK_US
from ccr_host.run.observer import RunObserver
from ccr_host.tracking.tracker import Sample

if TYPE_CHECKING:
    from ccr_host.run.recording import Tape

MOST_ARRIVED = 1024
"""Ten seconds of a fast camera, the longest control period."""


class RunTracker(ABC):
    """A tracker that keeps the samples that arrive between two looks."""

    name: str

    def __init__(self) -> None:
        self._newest: Sample | None = None
        self._arrived: deque[Sample] = deque(maxlen=MOST_ARRIVED)

    def newest(self) -> Sample | None:
        """Newest sample that has arrived, whatever its age; None before the first."""
        return self._newest

    def arrived(self) -> list[Sample]:
        """The samples that have arrived since the last call, oldest first."""
        arrived = list(self._arrived)
        self._arrived.clear()
        return arrived

    @abstractmethod
    def trouble(self) -> str:
        """Why there may be no newer sample, for users; empty if unknown."""

    def _take(self, sample: Sample) -> None:
        self._newest = sample
        self._arrived.append(sample)


@dataclass(frozen=True)
class Rig:
    """A connected board and a tracker, and the clock of both."""

    clock: Clock
    client: Client
    tracker: RunTracker
    tape: Tape
    """Records the inputs of the host through this rig."""
    start_path_clock: Callable[[int], None] = lambda _: None
    """Sets the time in us from which the description's timed disturbances count."""
    true_tip_mm: Callable[[], Array | None] = lambda: None
    """True f, (3,), for the metrics only; None if the robot is real or recorded."""


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
    """An operator who never wants anything."""

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
