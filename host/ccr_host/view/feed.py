"""What passes between the control loop's process and the page's: observations there, buttons back.

The loop hands on what it sees, or drops it. The buttons are two bytes that both processes share: no
locks and no messages, the loop reads them every millisecond, and whatever becomes of the page can
neither delay nor block it.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Sequence
from ctypes import c_bool
from multiprocessing.context import BaseContext
from pathlib import Path
from typing import Any, NamedTuple

from ccr_host.control.base import Command, Observation, Phase
from ccr_host.core.errors import CcrError
from ccr_host.run.observer import RunObserver, RunSetup, StepRecord
from ccr_host.tracking.tracker import Sample

Item = tuple[str, tuple[Any, ...]]
"""A method of :class:`RunObserver` and its arguments."""


class Batch(NamedTuple):
    """A batch of events, in order."""

    items: Sequence[Item]
    dropped_batches: int
    """Number of batches dropped so far."""


class RunEnded(NamedTuple):
    """The last message of a run."""

    folder: Path
    """Folder with the complete log."""


_REAL_TIME_US = 40_000
"""Time on the run's clock between two batches: a little more often than the page draws."""
_VIRTUAL_TIME_US = 1_000_000
"""The same where a second passes in a few hundredths."""
_STEP_EVERY_US = 5_000
"""Steps of faster controllers are thinned out: a viewer would not see more."""


class ViewFeed(RunObserver):
    """Observer that collects what happens and hands it on in batches.

    ``put`` takes a batch and returns at once; False if there was no room for it.
    """

    def __init__(self, put: Callable[[Batch], bool], *, realtime: bool) -> None:
        self._put = put
        self._items: list[Item] = []
        self._batch_us = _REAL_TIME_US if realtime else _VIRTUAL_TIME_US
        self._handed_on_us = 0
        self._step_us = self._command_us = -_STEP_EVERY_US
        self._dropped_batches = 0
        self._phase = ""
        self._known: dict[str, Item] = {}

    def begin(self, setup: RunSetup) -> None:
        self._items.append(self._kept("begin", setup))
        self._hand_on(0)

    def frame(self, direction: str, time_us: int, data: bytes) -> None:
        self._items.append(("frame", (direction, time_us, data)))
        if time_us - self._handed_on_us >= self._batch_us:
            self._hand_on(time_us)

    def tracker_sample(self, time_us: int, sample: Sample) -> None:
        self._items.append(("tracker_sample", (time_us, sample)))

    def control(self, time_us: int, observation: Observation | None, command: Command) -> None:
        if time_us - self._command_us >= _STEP_EVERY_US:
            self._command_us = time_us
            self._items.append(("control", (time_us, None, command)))

    def step(self, record: StepRecord) -> None:
        if record.end_us - self._step_us >= _STEP_EVERY_US:
            self._step_us = record.end_us
            self._items.append(("step", (record,)))

    def event(self, time_us: int, text: str) -> None:
        self._items.append(("event", (time_us, text)))
        self._hand_on(time_us)

    def phase(self, time_us: int, phase: Phase) -> None:
        self._items.append(self._kept("phase", time_us, phase))
        if phase.name != self._phase:
            self._phase = phase.name
            self._hand_on(time_us)

    def resumed(self) -> Batch:
        """State of the run, for a page that has seen none of it; callable from any thread."""
        return Batch(list(self._known.values()), self._dropped_batches)

    def _kept(self, method: str, *arguments: object) -> Item:
        self._known[method] = method, arguments
        return self._known[method]

    def _hand_on(self, time_us: int) -> None:
        if not self._put(Batch(self._items, self._dropped_batches)):
            self._dropped_batches += 1
        self._items = []
        self._handed_on_us = time_us


def play(items: Sequence[Item], observer: RunObserver) -> None:
    """Let an observer see a batch."""
    for method, arguments in items:
        getattr(observer, method)(*arguments)


class SharedButtons:
    """Written by the page, read by the run; passed to the page's process when it is started."""

    def __init__(self, context: BaseContext) -> None:
        self._stop: Any = context.RawValue(c_bool, False)
        self._pause: Any = context.RawValue(c_bool, False)

    def press_stop(self) -> None:
        """Stop the robot; cannot be undone."""
        self._stop.value = True

    def set_pause(self, paused: bool) -> None:
        self._pause.value = paused

    @property
    def stop_pressed(self) -> bool:
        return bool(self._stop.value)

    @property
    def paused(self) -> bool:
        return bool(self._pause.value)


class PageOperator:
    """The person before the page, as the run's :class:`~ccr_host.run.rig.Operator`.

    ``page_is_alive`` is whether anybody can press the buttons, now or when the page is back;
    ``heard`` comes from the page's process, in order, and is filled by any thread.
    """

    def __init__(
        self, buttons: SharedButtons, page_is_alive: Callable[[], bool], heard: deque[str]
    ) -> None:
        self._buttons = buttons
        self._page_is_alive = page_is_alive
        self._heard = heard

    @property
    def wants_stop(self) -> bool:
        return self._buttons.stop_pressed

    @property
    def wants_pause(self) -> bool:
        """Whether the path has to wait.

        Raises:
            CcrError: paused, and the page that could continue is gone.
        """
        if not self._buttons.paused:
            return False
        if not self._page_is_alive():
            raise CcrError("the live page ended during a pause", "start the run again")
        return True

    def news(self) -> str:
        return self._heard.popleft() if self._heard else ""
