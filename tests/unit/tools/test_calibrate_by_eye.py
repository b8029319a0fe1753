"""The dialogue of ``calibrate --by-eye``, on the emulated board in virtual time."""

from collections.abc import Iterator

import pytest
from rich.console import Console

from ccr_host.commands.jog import jog_panel
from ccr_host.description.schema import Servo
from ccr_host.run.observer import Observers
from ccr_host.run.open_rig import open_rig
from ccr_host.run.options import RigOptions
from ccr_host.tools.calibrate import calibrate_by_eye
from ccr_host.tools.jog import DOWN, LEFT, RIGHT, UP, JogView

pytestmark = pytest.mark.long

OPTIONS = RigOptions()
KEYS = ((UP, DOWN), (RIGHT, LEFT))
UNTIL_THERE = 20
"""Periods that the board takes for the longest move here."""
USUAL_DEG = (0.0, 45.0, -45.0, -60.0, 60.0)
HALF_DEG = (0.0, 25.0, -25.0, -30.0, 30.0)


def marks(axis: int, angles_deg: tuple[float, ...], here_deg: float = 0.0) -> Iterator[str]:
    """Keys, with a step of 5 deg, that move a motor to angles and mark them."""
    for angle_deg in angles_deg:
        steps = round((angle_deg - here_deg) / 5.0)
        yield from [KEYS[axis][steps < 0]] * abs(steps)
        yield from [""] * UNTIL_THERE
        yield "\r"
        here_deg = angle_deg


def calibrated(*keys: str) -> tuple[Servo | None, list[str]]:
    """The result, and all questions asked."""
    left, asked = iter(("+", "+", *keys, "q")), []

    def show(_: JogView, question: str) -> None:
        if not asked or asked[-1] != question:
            asked.append(question)

    with open_rig(OPTIONS, OPTIONS.description(), Observers()) as rig:
        found = calibrate_by_eye(rig, OPTIONS.description(), lambda: [next(left)], show)
    return found, asked


def test_usual_marks_are_taken_without_a_question() -> None:
    found, asked = calibrated(*marks(0, USUAL_DEG), *marks(1, USUAL_DEG))
    assert found is not None
    assert found.pulse_per_90_deg_us == (1000.0, 1000.0)
    assert [text.partition(" ")[0] for text in asked if text] == [str(n) for n in range(1, 11)]


def test_a_scale_far_from_the_other_motors_is_taken_only_if_the_user_says_so() -> None:
    keys = (*marks(0, USUAL_DEG), *marks(1, HALF_DEG))
    found, asked = calibrated(*keys, "", "q")
    assert found is None
    assert "1000 us for motor 1 but 556 us for motor 2" in asked[-1]
    found, _ = calibrated(*keys, "", "\r")
    assert found is not None
    assert found.pulse_per_90_deg_us == (1000.0, 556)


def test_there_is_a_way_back_to_every_question() -> None:
    wrong = (*marks(0, USUAL_DEG), *marks(1, HALF_DEG))
    again = [*(["b"] * 4), *marks(1, USUAL_DEG[1:], here_deg=30.0)]
    found, _ = calibrated(*wrong, "", *again)
    assert found is not None
    assert found.pulse_per_90_deg_us == (1000.0, 1000.0)
    found, asked = calibrated(*marks(0, (0.0,)), *["b"] * 20, "")
    assert found is None
    assert asked[-1].startswith("1 of 10")


def test_implausible_marks_are_asked_for_again_and_the_others_kept() -> None:
    crooked = marks(1, (0.0, 45.0, -20.0))
    rest = marks(1, USUAL_DEG[2:], here_deg=-20.0)
    found, asked = calibrated(*marks(0, USUAL_DEG), *crooked, "", *rest)
    assert any("motor 2" in question and "8 of 10" in question for question in asked)
    assert any("off a line" in question for question in asked)
    assert found is not None
    assert found.pulse_per_90_deg_us == (1000.0, 1000.0)


def shown(*, simulated_tip: bool) -> str:
    seen: list[JogView] = []
    keys = iter(["", "", "", "q"])

    def show(view: JogView, _: str) -> None:
        seen.append(view)

    with open_rig(OPTIONS, OPTIONS.description(), Observers()) as rig:
        calibrate_by_eye(rig, OPTIONS.description(), lambda: [next(keys)], show)
    console = Console(width=110)
    with console.capture() as captured:
        title = "calibrate by eye"
        console.print(jog_panel(seen[-1], simulated_tip=simulated_tip, title=title, asked="what?"))
    return captured.get()


def test_the_panel_says_what_it_is_for_and_how_to_go_back() -> None:
    panel = shown(simulated_tip=False)
    assert "calibrate by eye" in panel
    assert "Backspace" in panel
    assert "mm, " in panel, "the tip"


def test_a_simulated_tip_is_not_shown_beside_a_real_board() -> None:
    panel = shown(simulated_tip=True)
    assert " mm" not in panel
    assert "--tracker" in panel
