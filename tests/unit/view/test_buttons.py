import multiprocessing
from collections import deque

import pytest

from ccr_host.core.errors import CcrError
from ccr_host.view.feed import PageOperator, SharedButtons


def press_both(buttons: SharedButtons) -> None:
    buttons.set_pause(True)
    buttons.press_stop()


def test_what_is_pressed_in_another_process_is_seen_in_this_one() -> None:
    context = multiprocessing.get_context("spawn")
    buttons = SharedButtons(context)
    operator = PageOperator(buttons, page_is_alive=lambda: True, heard=deque())
    assert not operator.wants_stop
    assert not operator.wants_pause
    process = context.Process(target=press_both, args=(buttons,))
    process.start()
    process.join()
    assert operator.wants_stop
    assert operator.wants_pause


def test_a_dead_page_cannot_leave_the_robot_paused_for_ever() -> None:
    buttons = SharedButtons(multiprocessing.get_context("spawn"))
    operator = PageOperator(buttons, page_is_alive=lambda: False, heard=deque())
    assert not operator.wants_pause, "nor does it disturb a run that goes on"
    buttons.set_pause(True)
    with pytest.raises(CcrError, match="page ended"):
        _ = operator.wants_pause
