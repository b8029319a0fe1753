"""Checks whether a robot moves as described, and if not, finds the most likely cause.

The static model is fitted to rests under the description's prior. If the residual is too large, or
the parameters are implausible, it is fitted again under each of several hypotheses: motors reversed
or swapped, a wrong zero of a servo, loose tendons, other lengths, gravity from another side, a
turned camera. The hypothesis with the most likely rests and parameters is the cause that is
reported.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import islice, product
from typing import Any

import numpy as np

from ccr_host.control.adaptive.identification import Fit, StaticsFit
from ccr_host.control.adaptive.model import PlainModel, make_model
from ccr_host.control.adaptive.parameter_space import Gravity, ParameterSpace
from ccr_host.control.adaptive.parameters import (
    COUNT,
    ZEROS,
    Parameters,
    Scaling,
    numbers_of,
)
from ccr_host.control.adaptive.statics import zeros_rad
from ccr_host.core.arrays import Array
from ccr_host.core.errors import CcrError
from ccr_host.description.schema import Description
from ccr_host.robot.rests import Motors, Rests, numbered

_MOST_ZERO_RAD = math.radians(5.6)
"""Angle at which a zero is certainly wrong: half a tooth of the servo's spline is 7.2 deg."""
_ZERO_DOUBT_RAD = math.radians(1.2)
"""Minimum uncertainty of a zero: if lengths and radii are 10 % off, zeros have errors of up to 1.8
deg (0.9 RMS of 45 random robots), whatever their deviation."""
_DOUBT_DEVIATIONS = 2.0
_MOST_LEFT = 0.02
"""Fraction of the robot's motion that the model may leave unexplained, whatever the camera's noise,
as feedback corrects it."""
_TURN_DOUBT_RAD = math.radians(0.5)
"""Turn of a registered camera that cannot be told from bending planes that are turned."""
_LEAST_TOLD = 0.02
"""Fraction of a parameter's prior variance that rests must take for it to be judged."""
_FREEDOM = 8.0
"""Factor by which a hypothesis widens the prior deviation of its parameters."""
_START = 0.5
"""A freed zero starts at this fraction of its deviation, 8 deg, on either side, as slack may block
one way."""
_FIRST_STEPS = 8
_FINALISTS = 5
"""All hypotheses make the first steps of their fits, only the best ones the rest. After 5 steps the
right one was still among the last in one of forty misfits, after 8 it was first."""
RIVAL = 2.0 * math.log(100.0)
"""Minus twice the log odds up to which another cause than the likeliest is named as well."""
_ALSO = {
    "tendon_radius": "; check servo.pulse_per_90_deg_us and robot.pulley_radius_mm",
    "angle": "; check servo.pulse_per_90_deg_us, and how the camera stands: ccr-host register",
}
"""What else looks like a parameter, by the beginning of its name."""
STILL_MM, BEYOND_SLACK_RAD = 1.0, math.radians(30.0)
"""A motor that was turned beyond any slack and moved the tip by less does not move it."""
LEFT_HANDED = (
    "the tracker's axes are left-handed, so that it shows the robot mirrored",
    "let the tracker use right-handed axes",
)
REPEATED = (
    "the tracker repeats one picture",
    "start its program again; see with ccr-host monitor whether it follows a marker moved by hand",
)
_CALIBRATE = "ccr-host calibrate"
SWAP_CURE = "exchange the leads of the servos, or the tendons between the pulleys"
_PRICE = 6.0
"""Minus twice the log odds that a motor is reversed, or that two are swapped; a freed parameter is
penalised likewise."""


class MisfitError(CcrError):
    """The robot is not the described one (exit status 3)."""


def is_misfit(
    fit: Fit,
    rests: Rests,
    scaling: ParameterSpace[Any],
    *,
    zeros_are_known: bool = True,
) -> bool:
    """Whether the fitted model is far from the rests, or near only with implausible parameters.

    Unless ``zeros_are_known``, a zero that is far off is plausible.
    """
    most_zero_rad = _MOST_ZERO_RAD if zeros_are_known else math.inf
    return (
        (fit.surprise >= scaling.most_surprise and _leaves_much(fit, rests))
        or bool((_contradicted(fit, scaling) > scaling.most_deviations).any())
        or bool((_certain_zeros_rad(fit, scaling) > most_zero_rad).any())
    )


def is_doubtful(fit: Fit, space: ParameterSpace[Any]) -> bool:
    """Whether more rests should decide if the fitted model is that of the robot."""
    return space.farther_moves_tell and (
        fit.surprise > 1.0
        or bool((_contradicted(fit, space) > _DOUBT_DEVIATIONS).any())
        or bool((np.abs(space.zero_rad @ fit.score) > _MOST_ZERO_RAD).any())
    )


def _leaves_much(fit: Fit, rests: Rests) -> bool:
    """Whether the model leaves a large share of the robot's motion unexplained."""
    tips_mm = rests.vectors_mm[:, -1]
    motion_mm = math.sqrt(3.0 * float(np.nanmean((tips_mm - np.nanmean(tips_mm, axis=0)) ** 2)))
    return fit.rms_mm > _MOST_LEFT * motion_mm


def _certain_zeros_rad(fit: Fit, space: ParameterSpace[Any]) -> Array:
    """Angles by which zeros are certainly off, (n,); less than 0 for those that may be right."""
    doubt_rad = np.maximum(space.zeros_deviation_rad(fit.covariance), _ZERO_DOUBT_RAD)
    return np.abs(space.zero_rad @ fit.score) - doubt_rad


def _contradicted(fit: Fit, space: ParameterSpace[Any]) -> Array:
    """Number of deviations by which the rests contradict the prior of each parameter, (COUNT,).

    Rests that take the share T = 1 - C of the prior's variance leave a score of covariance T, if
    robots scatter as the prior. What scatters more adds to it through T, for its own score and for
    those that the rests tell from it only by the prior.
    """
    taken = np.eye(len(fit.score)) - fit.covariance
    more = np.zeros_like(fit.score)
    more[space.roles.varying] = space.varying_by**2 - 1.0
    more[space.roles.turns] = (_TURN_DOUBT_RAD / space.deviation[space.roles.turns]) ** 2
    variance = np.maximum(np.diag(taken), _LEAST_TOLD) + taken**2 @ more
    contradicted: Array = np.abs(fit.score) / np.sqrt(variance)
    contradicted[space.roles.varying] = 0.0
    return contradicted


def misfit_of(fit: Fit, space: ParameterSpace[Any], *, zeros_are_known: bool = True) -> MisfitError:
    """Name the zero or parameter that is furthest off, without further fits; see `is_misfit`."""
    contradicted = _contradicted(fit, space) / space.most_deviations
    odd = int(contradicted.argmax())
    zeros = _certain_zeros_rad(fit, space) / _MOST_ZERO_RAD
    if zeros_are_known and zeros.max() > max(1.0, contradicted[odd]):
        found_rad = np.where(zeros > 0.5 * zeros.max(), space.zero_rad @ fit.score, 0.0)
        return not_as_described(f"most likely the zero {zeros_off(found_rad)}", _CALIBRATE)
    if fit.explains or contradicted[odd] > 1.0:
        found, described = (space.values(score)[odd] for score in (fit.score, 0.0 * fit.score))
        cause = f"{space.names[odd]} is {found:.3g} where {described:.3g} is described"
        cure = "measure it again, and correct [[robot.segments]]"
        cure += next(
            (also for kind, also in _ALSO.items() if space.names[odd].startswith(kind)), ""
        )
        return not_as_described(f"most likely {cause}", cure)
    cure = "check that nothing holds it, its tendons on the pulleys, and [[robot.segments]]"
    if zeros_are_known:
        cure += "; find out how the camera stands: ccr-host register"
    return not_as_described(f"no usual cause explains it: {fit.residual}", cure)


def misfit(
    rests: Rests, description: Description, before_setup: Scaling | None = None
) -> MisfitError:
    """Find the most likely cause. Takes up to a minute, so the robot must already be safe.

    ``before_setup`` is the prior for a robot whose camera and zeros are not known yet, so that they
    are no cause; by default it is that of the description.
    """
    rests = rests.merged()  # Means tell as much, and each hypothesis is fitted in half the time.
    scaling = (before_setup or Scaling.of(description)).strict()
    model = make_model(description.control)
    if before_setup is None:
        hypotheses = _hypotheses(description)
    else:
        hypotheses = _hypotheses_before_setup(description)
    trials = [t for h in hypotheses for t in _trials(h, rests, scaling, model)]
    for trial in trials:
        for _ in range(_FIRST_STEPS):
            if not trial.fit.improve():
                break
    finalists = sorted(trials, key=_Trial.cost)[:_FINALISTS]
    for trial in finalists:
        trial.fit.finish()
    best = min(finalists, key=_Trial.cost)
    rivals = (
        trial
        for trial in finalists
        if trial.cost() < best.cost() + RIVAL
        and trial.hypothesis.kind != best.hypothesis.kind
        and trial.hypothesis.cure != _CALIBRATE  # Some zero is off in all robots.
    )
    named = [best, *islice(rivals, 1)]
    likely = "most likely" if best.fit.result().explains else "no usual cause explains it; perhaps"
    causes = ", or ".join(trial.cause() for trial in named)
    return not_as_described(f"{likely} {causes}", "; or ".join(t.hypothesis.cure for t in named))


def standing_still(rests: Rests) -> MisfitError | None:
    """The error for a picture that is repeated, or motors that move nothing; None if all do."""
    if rests.are_one_picture():
        return not_as_described(*REPEATED)
    is_led = np.ptp(rests.q_rad, axis=0) > BEYOND_SLACK_RAD
    still = np.flatnonzero(is_led & (rests.moved_mm() < STILL_MM))
    if not len(still):
        return None
    motor = f"motor {numbered(still)}"
    return not_as_described(
        f"{motor} moved nothing: its servo does not turn, or no tendon of {motor} pulls",
        "check the servo's supply and leads, and that its tendons are on its pulley; tighten them",
    )


def not_as_described(cause: str, cure: str) -> MisfitError:
    """The error with a cause that is known, or likely."""
    return MisfitError(f"the robot does not move as described; {cause}", cure)


def motors_exchanged(motors: Motors) -> MisfitError:
    """The error for exchanged motors, whatever their directions."""
    cause = motors._replace(signs=(1.0,) * len(motors.signs)).told()
    cure = f"{SWAP_CURE}; left-handed axes of the tracker may look alike"
    return not_as_described(f"most likely {cause}", cure)


_AS_DESCRIBED = Motors.as_described(2)


@dataclass(frozen=True)
class _Hypothesis:
    """A way in which the robot may differ from its description."""

    name: str
    """Text for the user, with fields of `Parameters` in braces, and `zeros`."""
    cure: str
    motors: Motors = _AS_DESCRIBED
    turned: bool = False
    mirrored: bool = False
    gravity: Gravity | None = None
    """Direction of gravity, if not the described one."""
    freed: tuple[str, ...] = ()
    """The freed fields of `Parameters`."""

    @property
    def kind(self) -> str:
        """What two hypotheses have in common that differ in numbers alone."""
        return self.name.partition("{")[0]


@dataclass(frozen=True, eq=False)
class _Trial:
    """A hypothesis and the fit of the parameters under it."""

    hypothesis: _Hypothesis
    fit: StaticsFit[Parameters]
    price: float

    def cost(self) -> float:
        """Minus twice the log likelihood so far."""
        return self.fit.result().cost + self.price

    def cause(self) -> str:
        """The hypothesis in words, with the parameters found."""
        p = self.fit.scaling.parameters(self.fit.result().score)
        found = p._asdict() | {"gain_2": p.gain_2, "zeros": zeros_off(zeros_rad(p))}
        return self.hypothesis.name.format(**found)


def zeros_off(zero_rad: Array) -> str:
    """Which motors' zeros are off and by how much: not always those that the hypothesis freed.

    ``zero_rad``, (n,), are those found; the prior allows some error of each, freed or not.
    """
    off = np.abs(zero_rad) > min(_ZERO_DOUBT_RAD, np.abs(zero_rad).max() / 2.0)
    return " and ".join(
        f"of motor {motor + 1} is off by {math.degrees(zero_rad[motor]):.0f} deg"
        for motor in np.flatnonzero(off)
    )


def _mounted(gravity: Gravity) -> _Hypothesis:
    shown = "[{:.0f}, {:.0f}, {:.0f}]".format(*gravity)
    return _Hypothesis(
        f"the robot is mounted with gravity along {shown} of its own frame",
        f"set robot.gravity_direction = {shown}, or mount it as described",
        gravity=gravity,
    )


def wrongly_mounted(gravity: Gravity) -> MisfitError:
    """The error for a robot under gravity in another direction than described."""
    hypothesis = _mounted(gravity)
    return not_as_described(f"most likely {hypothesis.name}", hypothesis.cure)


def _hypotheses(description: Description) -> Iterator[_Hypothesis]:
    geometry = description.robot
    servo_cure = "negate its servo.pulse_per_90_deg_us, or exchange its tendons on the pulley"
    for order, *signs in product(((0, 1), (1, 0)), (1.0, -1.0), (1.0, -1.0)):
        motors = Motors(tuple(signs), order)
        if motors != _AS_DESCRIBED:
            cure = SWAP_CURE if motors.exchanged else servo_cure
            yield _Hypothesis(motors.told(), cure, motors)
    zeros = ("zero_1_rad", "zero_2_rad")
    for freed in (zeros[:1], zeros[1:], zeros):
        yield _Hypothesis("the zero {zeros}", _CALIBRATE, freed=freed)
    for motor in (1, 2):
        yield _Hypothesis(
            f"a tendon of motor {motor} is loose, crossed or off its pulley",
            "put the tendons on at rest, without tension and without slack",
            freed=(f"zero_{motor}_rad", f"slack_{motor}_rad"),
        )
    yield _Hypothesis(
        "its segments are {length_1_mm:.0f} and {length_2_mm:.0f} mm long",
        "measure robot.segment_lengths_mm",
        freed=("length_1_mm", "length_2_mm"),
    )
    yield _Hypothesis(
        "the markers are {marker_offset_mm:.0f} mm beside the backbone",
        "measure robot.marker_offset_mm",
        freed=("marker_offset_mm",),
    )
    yield _Hypothesis(
        "its segments bend {gain_1:.1f} and {gain_2:.1f} times as far as their motors turn",
        f"{geometry.pulley_radius_mm / geometry.tendon_radius_mm:.1f} is described: check "
        "servo.pulse_per_90_deg_us, robot.pulley_radius_mm and robot.tendon_radius_mm",
        freed=("gain_1", "gain_ratio"),
    )
    yield from map(_mounted, Scaling.of(description).mountings())
    known = "otherwise than registered" if description.registration else "turned and unregistered"
    yield _Hypothesis(
        f"the camera stands {known}, or the markers are exchanged",
        "ccr-host register; check which marker is which with ccr-host monitor",
        turned=True,
    )
    yield _Hypothesis(*LEFT_HANDED, turned=True, mirrored=True)


def _hypotheses_before_setup(description: Description) -> Iterator[_Hypothesis]:
    """Those that a survey does not correct; the rests are turned to suit each of them."""
    for hypothesis in _hypotheses(description):
        is_corrected = hypothesis.motors.reversed or hypothesis.turned
        if not is_corrected and hypothesis.cure != _CALIBRATE:
            yield replace(hypothesis, turned=True)


def _trials(
    hypothesis: _Hypothesis, rests: Rests, scaling: Scaling, model: PlainModel
) -> Iterator[_Trial]:
    freed = numbers_of(*hypothesis.freed)
    under = scaling.freed(freed, _FREEDOM)
    if hypothesis.gravity is not None:
        under = under.mounted(hypothesis.gravity)
    motors = hypothesis.motors
    supposed = motors.drive(rests)
    if hypothesis.turned:
        expected_mm = model.predicted_mm(under.parameters(np.zeros(COUNT)), supposed)
        supposed = supposed.turned_onto(expected_mm, mirrored=hypothesis.mirrored)
    odd = len(motors.reversed) + bool(motors.exchanged)
    odd += hypothesis.turned + hypothesis.mirrored + (hypothesis.gravity is not None)
    price = _PRICE * odd + 2.0 * math.log(_FREEDOM) * len(freed)
    for scores in product(*((-_START, _START) if i in ZEROS else (0.0,) for i in freed)):
        start = np.zeros(COUNT)
        start[freed] = scores
        yield _Trial(hypothesis, StaticsFit(under, supposed, model, start), price)
