"""The page's buttons as the control loop sees them: two bytes that both processes share.

No locks and no messages: the loop reads them every millisecond, and whatever becomes of the page
can neither delay nor block it.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from ctypes import c_bool
from multiprocessing.context import BaseContext
from typing import Any

from ccr_host.core.errors import CcrError


class SharedButtons:
    """Written by the page, read by the run; passed to the page's process when it is started."""

    def __init__(self, context: BaseContext) -> None:
        self._stop: Any = context.RawValue(c_bool, False)
        self._pause: Any = context.RawValue(c_bool, False)

    def press_stop(self) -> None:
        """For good."""
        self._stop.value = True

    def set_pause(self, paused: bool) -> None:
        """Pause, or continue."""
        self._pause.value = paused

    @property
    def stop_pressed(self) -> bool:
        return bool(self._stop.value)

    @property
    def paused(self) -> bool:
        return bool(self._pause.value)


class PageOperator:
    """The person before the page, as the run's :class:`~ccr_host.run.operator.Operator`.

    Args:
        buttons: of the page.
        page_is_alive: whether anybody can press them, now or when the page is back.
        heard: from the page's process, in order; filled by any thread.
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
