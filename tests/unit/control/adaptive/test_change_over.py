"""A pair of tendons changes over when it has to, and does not go to and fro."""

from functools import partial

import numpy as np

from ccr_host.control.adaptive.law import ChangeOver
from ccr_host.control.adaptive.parameters import COUNT, Scaling
from ccr_host.control.adaptive.statics import hold_of, strains_of
from ccr_host.description.schema import Robot

PRIOR = Scaling(Robot()).parameters(np.zeros(COUNT))
PERIOD_S = 0.05


def _sides(change_over: ChangeOver, bends: np.ndarray, begin_s: float = 0.0) -> list[float]:
    """The side of motor 2 at each bending angle of segment 2; segment 1 hangs level."""
    sides = []
    for number, bend in enumerate(bends.tolist()):
        time_s = begin_s + number * PERIOD_S
        hold_pose = partial(hold_of, PRIOR, 0.5, bend, strains_of(PRIOR, 0.5, bend))
        hold = change_over.hold(hold_pose, time_s)
        sides.append(hold.sides[1])
    return sides


def test_a_pair_changes_over_once_on_the_way_to_the_other_side() -> None:
    change_over = ChangeOver(2)
    sides = _sides(change_over, np.linspace(0.5, -0.5, 100))
    assert (sides[0], sides[-1]) == (1.0, -1.0)
    assert change_over.changes == [0, 1]
    assert change_over.reversals == 0


def test_an_estimate_that_is_noisy_after_the_jump_does_not_cause_the_next_one() -> None:
    """The noise of 1.2 deg is six times the least hysteresis."""
    noisy = np.concatenate([[0.2], 0.02 * (-1.0) ** np.arange(1, 20)])
    change_over, sides = ChangeOver(2), (0.0, 0.0)
    _sides(change_over, noisy)
    without = []
    for bend in noisy.tolist():
        sides = hold_of(PRIOR, 0.5, bend, strains_of(PRIOR, 0.5, bend), sides).sides
        without.append(sides[1])
    assert np.count_nonzero(np.diff(without)) > 10
    assert change_over.changes[1] == 1


def test_a_pair_that_has_to_goes_back_at_once_and_that_counts_as_a_reversal() -> None:
    change_over = ChangeOver(2)
    assert _sides(change_over, np.array([0.2, -0.2, 0.2])) == [1.0, -1.0, 1.0]
    assert change_over.reversals == 1


def test_some_seconds_later_a_pair_changes_back_as_easily_as_ever() -> None:
    change_over = ChangeOver(2)
    _sides(change_over, np.array([0.2, -0.2]))
    assert _sides(change_over, np.array([0.02]), begin_s=3.0) == [1.0]
    assert change_over.reversals == 0
