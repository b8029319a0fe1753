"""Rest poses of the robot: two bending angles, slack elastic tendons, gravity, dry friction.

The equations are in docs/control-statics.md.

Each segment bends evenly by theta_j. Its pose minimises the energy of bending, gravity and the
tendons, which pull when taut and never push. All energies are divided by the bending stiffness k_1
of segment 1, so only ratios enter: they are the unknowns of ``Parameters``.
"""

from __future__ import annotations

from typing import NamedTuple

from ccr_host.control.adaptive.loads import Forces, loads_of
from ccr_host.control.adaptive.parameters import Parameters
from ccr_host.core.arrays import (
    Array,
    Number,
    Six,
    Two,
    anywhere,
    largest,
    positive,
    sign,
    split,
    stacked,
    within,
)

_NEWTON_LIMIT = 15
_LONGEST_STEP_RAD = 0.5
_REST_RAD = 1e-5
"""Newton's method ends with a step below this: the next one would be about its square."""
_CUTS = 5
_LEFT_SHARE = 0.3
_LEAST_STIFFNESS = 0.2
"""Fraction of k_1 that keeps Newton's steps downhill if gravity nearly buckles the robot."""

LEAST_CHANGE_OVER = 0.006
"""A tendon pair changes over when the other tendon would have to pull this much, in k_1 per radian
(0.3 deg of bending), or more, see ``ChangeOver``. Below that, the segment stays on the tendon that
held it, so that noise does not drive the servo to and fro through the slack, where no tendon damps
the segment."""

STICKING = 0.005
"""Yield of dry friction before a tendon slides, in units of r_c: 0.3 deg of bending, or a few
tenths of a mm at the tip, which is as little as feedback can distinguish from noise."""

_STILL_STICKS = STICKING * (1.0 - 1e-9)
"""A tendon that has just slid is at the limit and continues to slide in spite of rounding."""


def strains_of(p: Parameters, theta_1: Number, theta_2: Number) -> Six:
    """What friction and creep resist: the tendons' routes, in units of r_c, and both bends.

    First the lengthening of the routes of motor 1 on both sides, then of those of motor 2, which
    also pass segment 1.
    """
    sag_1 = p.sag_1 * theta_1 * theta_1
    sag_2 = p.sag_2 * theta_2 * theta_2 + sag_1
    led_2 = theta_2 + p.plane_1_rad * theta_1
    return theta_1 + sag_1, sag_1 - theta_1, led_2 + sag_2, sag_2 - led_2, theta_1, theta_2


def settled(p: Parameters, theta_1: Number, theta_2: Number, shafts: Two, anchors: Six) -> Two:
    """Bending angles at rest, found by Newton's method from a guess.

    Full steps across the kinks of tendons and friction can cycle, so a step that overshoots is
    shortened to where the forces along it vanish.
    """
    here = forces_of(p, theta_1, theta_2, shafts, anchors)
    for _ in range(_NEWTON_LIMIT):
        step_1, step_2 = _newton_step(here)
        if largest(step_1) < _REST_RAD and largest(step_2) < _REST_RAD:
            theta_1, theta_2 = theta_1 + step_1, theta_2 + step_2
            break
        share, here = _searched(p, theta_1, theta_2, step_1, step_2, here, shafts, anchors)
        theta_1, theta_2 = theta_1 + share * step_1, theta_2 + share * step_2
    return theta_1, theta_2


def _searched(
    p: Parameters,
    theta_1: Number,
    theta_2: Number,
    step_1: Number,
    step_2: Number,
    here: Forces,
    shafts: Two,
    anchors: Six,
) -> tuple[Number, Forces]:
    """Fraction of a step at which the forces along it nearly vanish, and the forces there."""
    ahead = forces_of(p, theta_1 + step_1, theta_2 + step_2, shafts, anchors)
    first = step_1 * here.moment_1 + step_2 * here.moment_2
    last = step_1 * ahead.moment_1 + step_2 * ahead.moment_2
    enough = _LEFT_SHARE * abs(first) + _TINY
    too_far = last > enough
    if not anywhere(too_far):
        return 1.0, ahead
    low, high = 1.0 - too_far, 1.0 + 0.0 * last
    share = high
    for _ in range(_CUTS):
        share = high - too_far * (high - low) * last / (last - first + _TINY)
        ahead = forces_of(p, theta_1 + share * step_1, theta_2 + share * step_2, shafts, anchors)
        along = step_1 * ahead.moment_1 + step_2 * ahead.moment_2
        if not anywhere((abs(along) >= enough) & too_far):
            break
        beyond = along > 0.0
        # Illinois rule: halve the weight of an end that is kept.
        first, last = (
            beyond * 0.5 * first + (1 - beyond) * along,
            beyond * along + (1 - beyond) * 0.5 * last,
        )
        low, high = beyond * low + (1 - beyond) * share, beyond * share + (1 - beyond) * high
    return share, ahead


_TINY = 1e-18


def likely_of(p: Parameters, q_1: Number, q_2: Number) -> Two:
    """Bending angles at setpoints without gravity and sag, as initial guess."""
    q_1, q_2 = q_1 - p.zero_1_rad, q_2 - p.zero_2_rad
    taut_1, taut_2 = positive(abs(q_1) - p.slack_1_rad), positive(abs(q_2) - p.slack_2_rad)
    return (
        sign(q_1) * p.gain_1 * taut_1 / (1.0 + p.compliance_1),
        sign(q_2) * p.gain_1 * p.gain_ratio * taut_2 / (1.0 + p.compliance_2),
    )


def _newton_step(forces: Forces) -> tuple[Number, Number]:
    moment_1, moment_2, k_11, k_12, k_22 = forces
    k_11 = k_11 + _shortfall(k_11)
    k_22 = k_22 + _shortfall(k_22)
    determinant = k_11 * k_22 - k_12 * k_12
    determinant = determinant + _shortfall(determinant)
    return (
        within((k_12 * moment_2 - k_22 * moment_1) / determinant, _LONGEST_STEP_RAD),
        within((k_12 * moment_1 - k_11 * moment_2) / determinant, _LONGEST_STEP_RAD),
    )


def _shortfall(stiffness: Number) -> Number:
    return positive(_LEAST_STIFFNESS - stiffness)


class ShaftHold(NamedTuple):
    """Shaft angles, and which tendon of each pair pulls: 1 or -1."""

    shafts: Two
    sides: Two


def hold_of(
    p: Parameters,
    theta_1: Number,
    theta_2: Number,
    anchors: Six,
    sides: Two,
    change_over: Two = (LEAST_CHANGE_OVER, LEAST_CHANGE_OVER),
) -> ShaftHold:
    """The shaft angles that hold the robot at given bending angles, the exact inverse of rest.

    Args:
        p: parameters, floats.
        theta_1: bending angle of segment 1.
        theta_2: bending angle of segment 2.
        anchors: strains at which friction and creep exert no force.
        sides: which tendon of each pair has pulled so far; 0 for none.
        change_over: moment that the other tendon must have to supply before the pair changes over.
    """
    load = _loads_with_creep(p, theta_1, theta_2, anchors)
    routes = strains_of(p, theta_1, theta_2)
    rub_1, rub_2 = 0.5 * p.friction_1, 0.5 * p.friction_2
    held_11 = rub_1 * within((routes[0] - anchors[0]) / STICKING, 1.0)
    held_12 = rub_1 * within((routes[1] - anchors[1]) / STICKING, 1.0)
    held_21 = rub_2 * within((routes[2] - anchors[2]) / STICKING, 1.0)
    held_22 = rub_2 * within((routes[3] - anchors[3]) / STICKING, 1.0)
    slope_1, slope_2 = 2.0 * p.sag_1 * theta_1, 2.0 * p.sag_2 * theta_2
    sag_12 = p.sag_1 * theta_1 * theta_1
    pull_2 = load.moment_2 + held_21 * (1.0 + slope_2) + held_22 * (slope_2 - 1.0)
    side_2 = _side(pull_2, sides[1], change_over[1])
    tension_2 = positive(side_2 * pull_2) / (1.0 + side_2 * slope_2)
    pull_1 = (
        load.moment_1
        + held_11 * (1.0 + slope_1)
        + held_12 * (slope_1 - 1.0)
        + (held_21 + held_22 - tension_2) * slope_1
        + (held_21 - held_22 - side_2 * tension_2) * p.plane_1_rad
    )
    side_1 = _side(pull_1, sides[0], change_over[0])
    tension_1 = positive(side_1 * pull_1) / (1.0 + side_1 * slope_1)
    pressed = p.shortening * (tension_1 + tension_2)
    taken_1 = p.gain_1 * p.slack_1_rad + sag_12 + p.compliance_1 * tension_1 + pressed
    taken_2 = (
        p.gain_2 * p.slack_2_rad
        + p.sag_2 * theta_2 * theta_2
        + sag_12
        + (_yields_2(p) - p.shortening) * tension_2
        + pressed
    )
    shaft_1 = (theta_1 + side_1 * taken_1) / p.gain_1
    shaft_2 = (theta_2 + p.plane_1_rad * theta_1 + side_2 * taken_2) / p.gain_2
    return ShaftHold((shaft_1, shaft_2), (side_1, side_2))


def _side(pull: Number, before: Number, change_over: Number) -> Number:
    stays = (before != 0.0) & (before * pull > -change_over)
    return stays * before + (1 - stays) * (1.0 - 2.0 * (pull < 0.0))


def unhindered_setpoints_for(p: Parameters, theta_rad: Array) -> Array:
    """Setpoints that hold given bending angles without friction and backlash, (..., 2)."""
    theta_1, theta_2 = split(theta_rad)
    routes = strains_of(p, theta_1, theta_2)
    shaft_1, shaft_2 = hold_of(p, theta_1, theta_2, routes, (0.0, 0.0)).shafts
    return stacked(shaft_1 + p.zero_1_rad, shaft_2 + p.zero_2_rad)


def zeros_rad(p: Parameters) -> Array:
    """Setpoints at which the shafts are at 0, (..., 2)."""
    return stacked(p.zero_1_rad, p.zero_2_rad)


def shafts_of(p: Parameters, q: Two, lag: Two) -> Two:
    """Angles of the shafts at setpoints, which they follow with backlash."""
    return (
        q[0] - p.backlash_rad * lag[0] - p.zero_1_rad,
        q[1] - p.backlash_rad * lag[1] - p.zero_2_rad,
    )


def forces_of(p: Parameters, theta_1: Number, theta_2: Number, shafts: Two, anchors: Six) -> Forces:
    """Forces at bending and shaft angles.

    ``anchors`` are the strains, see ``strains_of``, at which friction and creep exert no force.
    """
    load = _loads_with_creep(p, theta_1, theta_2, anchors)
    moment_1, moment_2, stiffness_11, stiffness_12, stiffness_22 = load
    stick_1 = 0.5 * p.friction_1 / STICKING
    stick_2 = stick_1 * p.friction_ratio
    sag_1 = p.sag_1 * theta_1 * theta_1
    sag_1_slope = 2.0 * p.sag_1 * theta_1
    sag_2 = p.sag_2 * theta_2 * theta_2 + sag_1
    sag_2_slope = 2.0 * p.sag_2 * theta_2
    gain_2 = p.gain_1 * p.gain_ratio
    # The two tendons of a pair are never both taut.
    led_2 = theta_2 + p.plane_1_rad * theta_1
    ahead_1, ahead_2 = p.gain_1 * shafts[0] - theta_1, gain_2 * shafts[1] - led_2
    lever_1, lever_2 = sign(ahead_1) + sag_1_slope, sign(ahead_2) + sag_2_slope
    tension_1, tension_2, spring_11, spring_12, spring_22 = _taut(
        p,
        abs(ahead_1) - p.gain_1 * p.slack_1_rad - sag_1,
        abs(ahead_2) - gain_2 * p.slack_2_rad - sag_2,
    )
    lever_21 = sag_1_slope + sign(ahead_2) * p.plane_1_rad
    along_1 = spring_11 * lever_1 + spring_12 * lever_21
    along_2 = spring_12 * lever_1 + spring_22 * lever_21
    moment_1 = moment_1 - tension_1 * lever_1 - tension_2 * lever_21
    moment_2 = moment_2 - tension_2 * lever_2
    pull = 2.0 * p.sag_1 * (tension_1 + tension_2)
    stiffness_11 = stiffness_11 + along_1 * lever_1 + along_2 * lever_21 - pull
    stiffness_12 = stiffness_12 + along_2 * lever_2
    stiffness_22 = stiffness_22 + spring_22 * lever_2 * lever_2 - 2.0 * p.sag_2 * tension_2
    for side, anchor_1, anchor_2 in ((1.0, anchors[0], anchors[2]), (-1.0, anchors[1], anchors[3])):
        lever = side + sag_1_slope
        slid = side * theta_1 + sag_1 - anchor_1
        pull = stick_1 * within(slid, STICKING)
        stiff = stick_1 * (abs(slid) < _STILL_STICKS)
        moment_1 = moment_1 + pull * lever
        stiffness_11 = stiffness_11 + stiff * lever * lever + 2.0 * p.sag_1 * pull

        lever = side + sag_2_slope
        lever_21 = sag_1_slope + side * p.plane_1_rad
        slid = side * led_2 + sag_2 - anchor_2
        pull = stick_2 * within(slid, STICKING)
        stiff = stick_2 * (abs(slid) < _STILL_STICKS)
        moment_1 = moment_1 + pull * lever_21
        moment_2 = moment_2 + pull * lever
        stiffness_11 = stiffness_11 + stiff * lever_21 * lever_21 + 2.0 * p.sag_1 * pull
        stiffness_12 = stiffness_12 + stiff * lever_21 * lever
        stiffness_22 = stiffness_22 + stiff * lever * lever + 2.0 * p.sag_2 * pull
    return Forces(moment_1, moment_2, stiffness_11, stiffness_12, stiffness_22)


def _loads_with_creep(p: Parameters, theta_1: Number, theta_2: Number, anchors: Six) -> Forces:
    """``loads_of``, and the resistance to bends that are new."""
    moment_1, moment_2, stiffness_11, stiffness_12, stiffness_22 = loads_of(p, theta_1, theta_2)
    creep_1, creep_2 = p.creep, p.creep * p.stiffness_ratio
    return Forces(
        moment_1 + creep_1 * (theta_1 - anchors[4]),
        moment_2 + creep_2 * (theta_2 - anchors[5]),
        stiffness_11 + creep_1,
        stiffness_12,
        stiffness_22 + creep_2,
    )


def _taut(
    p: Parameters, excess_1: Number, excess_2: Number
) -> tuple[Number, Number, Number, Number, Number]:
    """Tensions at lengths by which the tendons of motors 1 and 2 are wound too short; at least 0.

    Each stretches its tendon and shortens the segments that it passes, which slackens both.

    Returns:
        Both tensions, then their derivatives in both excesses: 11, 12 and 22.
    """
    yields_1 = p.compliance_1 + p.shortening
    yields_2 = _yields_2(p)
    both = p.shortening
    alone = 1.0 / yields_1
    first_2 = (excess_2 - both * alone * positive(excess_1)) / (yields_2 - both * both * alone)
    tension_1 = positive(excess_1 - both * positive(first_2)) * alone
    tension_2 = positive(excess_2 - both * tension_1) / yields_2
    pulls_1, pulls_2 = 1.0 * (tension_1 > 0.0), 1.0 * (tension_2 > 0.0)
    share = 1.0 / (yields_1 * yields_2 - pulls_1 * pulls_2 * both * both)
    return (
        tension_1,
        tension_2,
        pulls_1 * yields_2 * share,
        -pulls_1 * pulls_2 * both * share,
        pulls_2 * yields_1 * share,
    )


def _yields_2(p: Parameters) -> Number:
    """Length by which a unit tension stretches a tendon of motor 2 and shortens its segments."""
    shortening_2 = p.shortening * p.length_2_mm / p.length_1_mm
    return p.compliance_2 / p.stiffness_ratio + p.shortening + shortening_2
