"""Finds what has most likely changed in a robot that moved as described before.

Its static model is known by then. Each hypothesis leads the model otherwise (a motor that stands
still, slips or turns the other way, a tendon that no longer pulls), or changes what the camera sees
(turned, another scale, a marker that has shifted, a picture that is repeated), and has few
unknowns. The one that leaves the least unexplained is named.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from itertools import islice

import numpy as np
import scipy

from ccr_host.control.adaptive.misfit import RIVAL
from ccr_host.core.arrays import Array, BoolArray
from ccr_host.robot.workspace import MotorLimits

Predict = Callable[[Array], Array]
"""Ends of the segments relative to M1, mm, (N, S, 3), at motor angles, (N, n)."""
Weigh = Callable[[Array], Array]
"""Differences of these ends, (N, S, 3), weighed."""

_MODEL_MM = 2.0
"""What the model leaves unexplained anyway; differences below it tell nothing."""
_BENT_RAD = 0.1
"""Angle by which it may have a segment bent otherwise anyway, so that differences which a bending
explains tell less than others."""
_PRICE = 4.0
"""What each unknown adds to minus twice the log likelihood."""
_EXPLAINED, _BETTER = 0.3, 0.6
"""Shares of the deviation, RMS, as it is or weighed, that the likely cause, or a possible one, may
leave."""
_MOVED_RAD = math.radians(5.0)
"""Travel of a motor without which it is not known whether markers that rest should move, and two
poses are one."""
_SERVO = (
    "check its servo and the supply, its horn and its tendons, and that nothing holds the robot"
)
_CAMERA = "fix it again and find out how it stands: ccr-host register"


@dataclass(frozen=True)
class _Explained:
    """A hypothesis at the best value of its unknowns."""

    cause: str
    cure: str
    left_mm: Array
    """What it leaves unexplained, (N, S, 3)."""
    unknowns: int

    def cost(self, poses: int, weigh: Weigh) -> float:
        """Minus twice the log likelihood of looks at so many poses."""
        coordinates = poses * np.count_nonzero(np.isfinite(self.left_mm)) / len(self.left_mm)
        spread_mm2 = _MODEL_MM**2 + float(np.nanmean(weigh(self.left_mm) ** 2))
        return coordinates * math.log(spread_mm2) + _PRICE * self.unknowns


def likely_change(
    predict: Predict, limits: MotorLimits, q_rad: Array, seen_mm: Array, by_bending: Array
) -> tuple[str, str] | None:
    """Cause and cure of poses that the model does not explain, or None if nothing usual does.

    Another cause is named as well if it is nearly as likely, as where motors hardly move.

    Args:
        predict: the model of the robot as it was before.
        limits: of the motors.
        q_rad: commanded motor angles, (N, n).
        seen_mm: ends of the segments relative to M1, (N, S, 3); NaN where not seen.
        by_bending: their derivatives by the bending, mm/rad, (N, S, 3, D).
    """
    expected_mm, weigh = predict(q_rad), _weighing(by_bending, seen_mm)
    found = [*_of_camera(expected_mm, seen_mm), *_of_motors(predict, limits, q_rad, seen_mm)]
    if np.ptp(q_rad, axis=0).max() > _MOVED_RAD:
        found.append(_standing(seen_mm))
    poses, off_mm = _poses(q_rad), seen_mm - expected_mm
    best, *others = sorted(found, key=lambda one: one.cost(poses, weigh))
    share = min(_rms(best.left_mm) / _rms(off_mm), _rms(weigh(best.left_mm)) / _rms(weigh(off_mm)))
    if share > _BETTER:
        return None
    likely = "most likely" if share < _EXPLAINED else "no usual cause explains it; perhaps"
    rivals = (one for one in others if one.cure != best.cure)
    most = best.cost(poses, weigh) + RIVAL
    named = [best, *(one for one in islice(rivals, 1) if one.cost(poses, weigh) < most)]
    cause, cure = ", or ".join(o.cause for o in named), "; or ".join(o.cure for o in named)
    return f"{likely} {cause}", cure


def _weighing(by_bending: Array, seen_mm: Array) -> Weigh:
    """What multiplies differences of markers by `_MODEL_MM` over their deviation.

    Those which no bending explains stay as they are.
    """
    known = np.isfinite(seen_mm)
    slopes = np.where(known[..., None], by_bending, 0.0).reshape(len(known), known[0].size, -1)
    variances_mm2, axes = np.linalg.eigh(_BENT_RAD**2 * slopes @ np.swapaxes(slopes, 1, 2))
    shares = _MODEL_MM / np.sqrt(_MODEL_MM**2 + np.maximum(variances_mm2, 0.0))
    weights = (axes * shares[:, None]) @ np.swapaxes(axes, 1, 2)

    def weigh(off_mm: Array) -> Array:
        rows = np.where(known, off_mm, 0.0).reshape(len(off_mm), -1, 1)
        return np.where(known, (weights @ rows).reshape(off_mm.shape), np.nan)

    return weigh


def _poses(q_rad: Array) -> int:
    """Number of looks, (N, n), that are poses apart: at others the model's errors are the same."""
    apart: list[Array] = []
    for q in q_rad:
        if all(np.abs(q - other).max() > _MOVED_RAD for other in apart):
            apart.append(q)
    return len(apart)


def _of_motors(
    predict: Predict, limits: MotorLimits, q_rad: Array, seen_mm: Array
) -> Iterator[_Explained]:
    for motor, (lower_rad, upper_rad) in enumerate(
        zip(limits.lower_rad, limits.upper_rad, strict=True)
    ):
        span_rad = upper_rad - lower_rad
        own_rad = q_rad[:, motor]

        def acting(changed_rad: Array, motor: int = motor) -> Array:
            led_rad = q_rad.copy()
            led_rad[:, motor] = changed_rad
            return seen_mm - predict(led_rad)

        name = f"motor {motor + 1}"
        # It has no unknown, but pays for one, as leads are rarely exchanged under way.
        yield _Explained(f"{name} turns the other way than before", _SERVO, acting(-own_rad), 1)
        for change, least_rad, most_rad, cause in (
            (
                np.full_like,
                lower_rad,
                upper_rad,
                "no longer turns, or turns in vain: it acts as if at",
            ),
            (np.add, -span_rad / 2.0, span_rad / 2.0, "or its horn has slipped, by"),
            (np.minimum, own_rad.min(), own_rad.max(), "or its tendon no longer pulls beyond"),
            (np.maximum, own_rad.min(), own_rad.max(), "or its tendon no longer pulls below"),
        ):
            changed = partial(change, own_rad)

            def left(unknown: float, changed: Callable[[float], Array] = changed) -> float:
                return _rms(acting(changed(unknown)))

            best = scipy.optimize.brute(
                left, ((least_rad, most_rad),), Ns=9, finish=None, full_output=False
            )
            step_rad = (most_rad - least_rad) / 8.0
            bounds = (float(best) - step_rad, float(best) + step_rad)
            fit = scipy.optimize.minimize_scalar(
                left, bounds=bounds, method="bounded", options={"maxiter": 12}
            )
            told = f"{name} {cause} {math.degrees(fit.x):.0f} deg"
            yield _Explained(told, _SERVO, acting(changed(float(fit.x))), 1)


def _of_camera(expected_mm: Array, seen_mm: Array) -> Iterator[_Explained]:
    known: BoolArray = np.isfinite(seen_mm[:, :, 0])
    # Unlike scipy's, without a warning where all markers are on one line.
    left, _, right = np.linalg.svd(seen_mm[known].T @ expected_mm[known])
    handed = np.diag([1.0, 1.0, np.linalg.det(left @ right)])
    turn = scipy.spatial.transform.Rotation.from_matrix(left @ handed @ right)
    yield _Explained(
        f"the camera has been turned by {math.degrees(turn.magnitude()):.0f} deg",
        _CAMERA,
        seen_mm - expected_mm @ turn.as_matrix().T,
        3,
    )
    scale = float((seen_mm[known] * expected_mm[known]).sum() / (expected_mm[known] ** 2).sum())
    if scale > 0.0:
        yield _Explained(
            f"distances are seen {scale:.3g} times as long as before",
            "check the camera's calibration and the unit of its lengths",
            seen_mm - scale * expected_mm,
            1,
        )
    shift_mm = seen_mm - expected_mm
    last = seen_mm.shape[1] - 1
    markers = [("M1", [*range(last + 1)])]
    markers += [(f"M{number + 2}", [number]) for number in range(last)]
    markers += [("the last marker", [last])]
    for name, of_marker in markers if last else [("M1 or the last marker", [0])]:
        shifts_mm = shift_mm[:, of_marker][known[:, of_marker]]
        if not len(shifts_mm):
            continue
        mean_mm = np.zeros_like(seen_mm)
        mean_mm[:, of_marker] = shifts_mm.mean(axis=0)
        by_mm = float(np.linalg.norm(mean_mm[0, of_marker[0]]))
        yield _Explained(
            f"{name} has shifted on the robot by {by_mm:.0f} mm, or another marker is taken for it",
            "fix the marker, remove others; then ccr-host register",
            shift_mm - mean_mm,
            3,
        )


def _standing(seen_mm: Array) -> _Explained:
    known = np.isfinite(seen_mm)
    return _Explained(
        "the markers stand still: the tracker repeats its picture, no servo turns any more, or the "
        "robot is held, as by tendons that pull against each other",
        "see with ccr-host monitor whether the tracker follows a marker moved by hand; check the "
        "supply of the servos, and that nothing holds the robot",
        seen_mm - np.where(known, seen_mm, 0.0).sum(axis=0) / known.sum(axis=0).clip(1),
        6,
    )


def _rms(vectors_mm: Array) -> float:
    return math.sqrt(float(np.nanmean(vectors_mm**2)))
