"""The compiled model against the plain one."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ccr_host.control.adaptive.model import PLAIN
from ccr_host.control.adaptive.motion import first_pose
from ccr_host.control.adaptive.parameters import COUNT, Scaling
from ccr_host.control.adaptive.static_model import PROBE
from ccr_host.description.schema import Robot
from ccr_host.robot.rests import Rests

pytestmark = pytest.mark.long  # Without numba's cache, compiling takes 20 s.

SCALING = Scaling(Robot())
LONGEST_RAD = 1.2
_NOT_BUCKLED_MM = 200.0

seeds = st.integers(0, 2**32 - 1)
same = settings(max_examples=60, deadline=None)


def _drawn(seed):
    """A generator and a believable robot; every other one without friction."""
    rng = np.random.default_rng(seed)
    p = SCALING.parameters(SCALING.bounded(rng.standard_normal(COUNT)))
    return rng, p if seed % 2 else p._replace(friction_1=0.0)


def _drawn_rests(rng: np.random.Generator) -> Rests:
    from_rad, stops_rad = rng.uniform(-LONGEST_RAD, LONGEST_RAD, (2, 8, 2))
    time_s = rng.uniform(0.3, 5.0, 8).cumsum()
    return Rests(from_rad, stops_rad, np.zeros((8, 3, 3)), np.ones(8), time_s)


@same
@given(seed=seeds)
def test_both_models_move_alike(compiled, seed):
    rng, p = _drawn(seed)
    plain = again = first_pose(p, *rng.uniform(-LONGEST_RAD, LONGEST_RAD, 2).tolist())
    for setpoint_rad in rng.uniform(-LONGEST_RAD, LONGEST_RAD, (3, 2)):
        way = rng.uniform(0.0, 5.0), setpoint_rad
        plain, again = PLAIN.moved(p, plain, *way), compiled.moved(p, again, *way)
        for ours, theirs in zip(again, plain, strict=True):
            assert ours == pytest.approx(theirs, abs=1e-7)


@same
@given(seed=seeds)
def test_both_models_have_the_same_slopes(compiled, seed):
    rng, _ = _drawn(seed)
    score = SCALING.bounded(rng.standard_normal(COUNT))
    q_rad = rng.uniform(-LONGEST_RAD, LONGEST_RAD, 2)
    p = SCALING.parameters(score)
    pose = first_pose(p, *q_rad.tolist())
    rate_rad_s = rng.uniform(-1.0, 1.0, 2)
    plain = PLAIN.sensitivity(SCALING, score, range(COUNT), p, pose, rate_rad_s)
    again = compiled.sensitivity(SCALING, score, range(COUNT), p, pose, rate_rad_s)
    assert again.tip == pytest.approx(plain.tip, abs=1e-6)
    assert again.theta_rad == pytest.approx(plain.theta_rad, abs=1e-6)


@settings(max_examples=10, deadline=None)
@given(seed=seeds)
def test_both_models_predict_the_same_rests(compiled, seed):
    rng, p = _drawn(seed)
    rests = _drawn_rests(rng)
    plain_mm, again_mm = PLAIN.predicted_mm(p, rests), compiled.predicted_mm(p, rests)
    assert again_mm.shape == (8, 2, 3)
    assert again_mm == pytest.approx(plain_mm, abs=1e-5)


@settings(max_examples=10, deadline=None)
@given(seed=seeds)
def test_robots_moved_at_once_rest_where_each_alone_does(compiled, seed):
    """The plain model moves several robots at once, the compiled one each for itself.

    Robots far from each other do not creep here: a step in which Newton's method ends early for one
    of them is forgotten with the next one then.
    """
    rng, _ = _drawn(seed)
    rests = _drawn_rests(rng)
    far = SCALING.each(SCALING.bounded(rng.standard_normal((4, COUNT))))
    far = far._replace(creep=0.0 * far.creep)
    near = SCALING.perturbed(SCALING.bounded(rng.standard_normal(COUNT)), PROBE)
    for p, most_mm in (far, 1e-4), (near, 1e-7):
        alone_mm = compiled.predicted_mm(p, rests)
        assert alone_mm.shape == (8, len(p.gain_1), 2, 3)
        # A robot that buckles ends as far as 1e11 mm away, by either model's rounding.
        sound = np.abs(alone_mm).max(axis=(0, 2, 3)) < _NOT_BUCKLED_MM
        found_mm = PLAIN.predicted_mm(p, rests)[:, sound]
        assert found_mm == pytest.approx(alone_mm[:, sound], abs=most_mm)


@settings(max_examples=10, deadline=None)
@given(seed=seeds)
def test_both_models_find_the_same_slopes_of_rests(compiled, seed):
    rng, _ = _drawn(seed)
    rests, score = _drawn_rests(rng), SCALING.bounded(0.5 * rng.standard_normal(COUNT))
    plain = PLAIN.predicted_and_slopes(SCALING, score, rests)
    again = compiled.predicted_and_slopes(SCALING, score, rests)
    assert again[0] == pytest.approx(plain[0], abs=1e-5)
    assert again[1] == pytest.approx(plain[1], abs=1e-3)


@same
@given(seed=seeds)
def test_both_models_polish_alike(compiled, seed):
    rng, p = _drawn(seed)
    theta_rad, target_mm = rng.uniform(-2.0, 2.0, (2, 3, 2)), rng.uniform(-90.0, 90.0, (2, 3, 3))
    for at in (np.s_[:], np.s_[0, 0]):
        arguments = p, theta_rad[at], target_mm[at], 4
        assert compiled.polished(*arguments) == pytest.approx(PLAIN.polished(*arguments), abs=1e-9)
