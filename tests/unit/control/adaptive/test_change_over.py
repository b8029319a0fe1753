"""A pair of tendons changes over when it has to, and does not go to and fro."""

from functools import partial

import numpy as np

from ccr_host.control.adaptive.law import ChangeOver
from ccr_host.control.adaptive.parameters import COUNT, Scaling
from ccr_host.control.adaptive.statics import hold_of, strains_of
from ccr_host.description.schema import Robot

PRIOR = Scaling(Robot()).parameters(np.zeros(COUNT))
PERIOD_S = 0.05


ONCE = "motor 2 changes over to its other tendon"


def _sides(
    change_over: ChangeOver, bends: np.ndarray, begin_s: float = 0.0
) -> tuple[list[float], list[str]]:
    """The side of motor 2 at each bending angle of segment 2, and what was told of jumps.

    Segment 1 hangs level.
    """
    sides, told = [], []
    for number, bend in enumerate(bends.tolist()):
        time_s = begin_s + number * PERIOD_S
        hold_pose = partial(hold_of, PRIOR, 0.5, bend, strains_of(PRIOR, 0.5, bend))
        hold = change_over.hold(hold_pose, time_s)
        sides.append(hold.sides[1])
        told += [change_over.told] if change_over.told else []
    return sides, told


def test_a_pair_changes_over_once_on_the_way_to_the_other_side() -> None:
    sides, told = _sides(ChangeOver(2), np.linspace(0.5, -0.5, 100))
    assert (sides[0], sides[-1]) == (1.0, -1.0)
    assert told == [ONCE]


def test_an_estimate_that_is_noisy_after_the_jump_does_not_cause_the_next_one() -> None:
    """The noise of 1.2 deg is six times the least hysteresis."""
    noisy = np.concatenate([[0.2], 0.02 * (-1.0) ** np.arange(1, 20)])
    _, told = _sides(ChangeOver(2), noisy)
    without, sides = [], (0.0, 0.0)
    for bend in noisy.tolist():
        sides = hold_of(PRIOR, 0.5, bend, strains_of(PRIOR, 0.5, bend), sides).sides
        without.append(sides[1])
    assert np.count_nonzero(np.diff(without)) > 10
    assert told == [ONCE]


def test_a_pair_that_has_to_goes_back_at_once_and_that_is_told() -> None:
    sides, told = _sides(ChangeOver(2), np.array([0.2, -0.2, 0.2]))
    assert sides == [1.0, -1.0, 1.0]
    assert told == [ONCE, f"{ONCE} again"]


def test_some_seconds_later_a_pair_changes_back_as_easily_as_ever() -> None:
    change_over = ChangeOver(2)
    _sides(change_over, np.array([0.2, -0.2]))
    assert _sides(change_over, np.array([0.02]), begin_s=3.0) == ([1.0], [ONCE])
