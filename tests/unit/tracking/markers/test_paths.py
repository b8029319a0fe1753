"""Whole paths in front of a hostile camera; bench/labelling.py has more and longer ones."""

import pytest

from bench.labelling import Hostility, Motion, Score, judge

HOSTILE = Hostility(occlusion=0.2, phantoms=3, kinds="unm")


def label(motion, hostility, seed, **keys) -> Score:
    score = Score()
    judge(motion, hostility, seed, score, **keys)
    return score


@pytest.mark.long
@pytest.mark.parametrize("kinds", ["unm", "n"])
def test_no_swap_and_no_false_tip_with_a_fifth_hidden_and_phantoms_nearby(slow_motion, kinds):
    score = label(slow_motion, Hostility(kinds=kinds), seed=11)
    assert (score.swaps, score.false_tips) == (0, 0)
    assert score.tips > 0.8 * score.visible


@pytest.mark.long
def test_no_swap_and_no_false_tip_while_the_robot_jumps_and_rings(jerky_motion):
    score = label(jerky_motion, HOSTILE, seed=12)
    assert (score.swaps, score.false_tips) == (0, 0)
    assert score.tips > 0.35 * score.visible


@pytest.mark.long
def test_a_clear_view_of_a_robot_that_has_settled_gives_nearly_every_tip(slow_motion):
    settled = Motion(slow_motion.q_rad[80:], slow_motion.markers_mm[80:])
    score = label(settled, Hostility(occlusion=0.0, phantoms=0), seed=13)
    assert score.tips > 0.97 * score.frames


@pytest.mark.long
def test_before_registration_labels_are_right_too_only_fewer(slow_motion):
    score = label(slow_motion, HOSTILE, seed=14, registered=False)
    assert (score.swaps, score.false_tips) == (0, 0)
    assert score.tips > 0.03 * score.visible


@pytest.mark.long
def test_phantoms_that_come_after_a_long_clear_view_give_no_false_tip(jerky_motion):
    """A clear view makes the labeller bold; the first phantoms must not profit from it."""
    score = Score()
    for start in range(0, len(jerky_motion.q_rad) - 90, 60):
        part = slice(start, start + 90)
        motion = Motion(jerky_motion.q_rad[part], jerky_motion.markers_mm[part])
        judge(motion, Hostility(kinds="nm", first_frame=60), start, score)
    assert (score.swaps, score.false_tips) == (0, 0)
    assert score.tips > 0.6 * score.visible
