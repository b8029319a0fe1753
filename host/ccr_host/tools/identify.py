"""``ccr-host identify``: fit the static model to measurements of a robot, and judge the fit.

The model is that of controller `adaptive` for a robot with two motors, and ``chain_fit``'s for one
described by ``robot.segments``. It is fitted to the first part of the time and judged by the rest.
"""

from __future__ import annotations

import datetime
import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ccr_host.control.adaptive.identification import StaticsFit, identification_of
from ccr_host.control.adaptive.misfit import misfit
from ccr_host.control.adaptive.model import make_model
from ccr_host.control.adaptive.parameters import COUNT, PUSHES, Parameters, Scaling
from ccr_host.core.arrays import Array, IntArray
from ccr_host.core.errors import CcrError, ConfigError
from ccr_host.description.file import Sections
from ccr_host.description.schema import Description, Segment
from ccr_host.robot.rest_model import Markers
from ccr_host.robot.rests import Rests
from ccr_host.robot.workspace import MotorLimits
from ccr_host.tools.chain_fit import ChainFit, ChainModel, fit_chain
from ccr_host.tools.measured import FEWEST_ROWS, Measured, home_of
from ccr_host.tools.survey import IDENTIFIED, identified_section

_LEARNT = 0.5
"""A parameter is identified if its deviation is at most this share of the prior's."""
_CONFOUNDED = 0.7
"""Correlation from which two parameters cannot be told apart."""
_MOST_RESTS = 60
"""Rests kept in a description; `adaptive` fits to them before each path."""
_RESTS_FOR_CAUSE = 30
_EXPLAINED = 0.25
"""A model that leaves more than this share of the tip's motion is not that of this robot."""
_SCATTERS = 2.0
"""So many times what the robot scatters by at home a model may leave anyway: a robot that hangs in
its slack comes to rest elsewhere each time."""
_MOST_ASIDE_RAD = math.radians(40.0)
"""A third of the angle between three tendons: beyond it a description names the wrong one."""
_MOST_RATIO = 1.5
_TIP_MOVES = (0.02, 2.5)
"""Shares of the robot's length between which the tip's motion lies, at most twice its length."""
_MOTORS_TURN = (0.05, 8.0)
"""Shares of the motors' limits: degrees taken for radians, or the reverse, are 57 times off."""
_CURE = (
    "check robot.segments: which motor winds which tendon, its angle and its winding; and that no "
    "motors pulled against each other"
)


class WrongRobotError(CcrError):
    """The measurements are not those of the described robot (exit status 3)."""


@dataclass(frozen=True)
class Residual:
    """Distances between measured and modelled tips."""

    rows: int
    rmse_mm: float
    median_mm: float
    p95_mm: float

    @classmethod
    def of(cls, off_mm: Array) -> Residual:
        """Statistics of differences, (n, 3)."""
        distance_mm = np.linalg.norm(off_mm.reshape(-1, 3), axis=1)
        return cls(
            len(distance_mm),
            float(np.sqrt((distance_mm**2).mean())),
            float(np.median(distance_mm)),
            float(np.percentile(distance_mm, 95)),
        )


@dataclass(frozen=True)
class Found:
    """A parameter with its deviation after the fit and before."""

    name: str
    value: float
    deviation: float
    prior_deviation: float
    confounded_with: str
    """The parameter with which it is correlated most, if it cannot be told from that; or empty."""
    correlation: float

    @property
    def identified(self) -> bool:
        """Whether the measurements say more about it than the prior."""
        return self.deviation <= _LEARNT * self.prior_deviation


@dataclass(frozen=True)
class Identification:
    """Result of a fit, and what is worth keeping in the description."""

    train: Residual
    held_out: Residual
    parameters: list[Found]
    sections: Sections


def identify(
    description: Description,
    measured: Measured,
    *,
    date: datetime.date,
    train_share: float = 0.5,
    one_plane: bool = False,
) -> Identification:
    """Fit to the first part of the time, judge by the rest, then fit to everything.

    ``one_plane`` takes only rows in which the description bends all segments within one plane.

    Raises:
        ConfigError: another number of motors, or too few rows on either side.
        MisfitError, WrongRobotError: these are not measurements of this robot.
    """
    segments, motors = description.robot.segments, description.robot.motors
    if measured.command.shape[1] != motors:
        raise ConfigError(
            f"measurements of {measured.command.shape[1]} motors, but the described robot has "
            f"{motors}",
            "give the description of the measured robot with --robot",
        )
    rows = len(measured.time_s)
    if rows < FEWEST_ROWS or not np.ptp(measured.command, axis=0).all():
        raise ConfigError(
            f"{rows} rows are left, too few or without motion of some motor",
            "leave out fewer patterns with --leave-out",
        )
    if slip := _wrong_unit(description, measured):
        raise ConfigError(slip, "correct the unit in the header, or the description")
    if segments:
        return _identify_chain(description, measured, train_share, one_plane=one_plane)
    if one_plane:
        raise ConfigError(
            "--one-plane is for robots described by robot.segments", "omit --one-plane"
        )
    return _identify_two_motors(description, measured, train_share, date)


def _wrong_unit(description: Description, measured: Measured) -> str:
    """What no such robot does, as if it were in another unit; empty if all is plausible."""
    length_mm = sum(segment.length_mm for segment in description.robot.chain)
    moved_mm = float(np.ptp(measured.tip_mm, axis=0).max())
    least, most = _TIP_MOVES
    if not least * length_mm < moved_mm < most * length_mm:
        return f"the tip moves by {moved_mm:.3g} mm, of a robot that is {length_mm:g} mm long"
    limits = MotorLimits.of(description.servo)
    limit_rad = float(np.abs([limits.lower_rad, limits.upper_rad]).max())
    turned_rad = float(np.abs(measured.command).max())
    least, most = _MOTORS_TURN
    if measured.unit == "rad" and not least * limit_rad < turned_rad < most * limit_rad:
        turned_deg, limit_deg = np.degrees([turned_rad, limit_rad])
        return f"motors turn by up to {turned_deg:.3g} deg, where the limit is {limit_deg:.3g} deg"
    return ""


def _split(time_s: Array, rows: IntArray, train_share: float) -> tuple[IntArray, IntArray]:
    first, last = time_s[rows[0]], time_s[rows[-1]]
    until = first + train_share * (last - first)
    train, held = rows[time_s[rows] < until], rows[time_s[rows] >= until]
    if min(len(train), len(held)) < FEWEST_ROWS // 2:
        raise ConfigError(
            f"{len(train)} rows to fit and {len(held)} to judge by",
            f"give {FEWEST_ROWS // 2} rows or more on either side: a longer recording, or another "
            "--train",
        )
    return train, held


def _identify_two_motors(
    description: Description, measured: Measured, train_share: float, date: datetime.date
) -> Identification:
    pulley_mm = description.robot.pulley_radius_mm
    q_rad = measured.command / (pulley_mm if measured.unit == "mm" else 1.0)
    train, held = _split(measured.time_s, np.arange(len(q_rad)), train_share)
    model, ends_mm = make_model(description.control), measured.ends_mm(2)

    def rests_at(rows: IntArray) -> Rests:
        before_rad = q_rad[np.maximum(rows - 1, 0)]
        time_s, count = measured.time_s[rows], np.ones(len(rows))
        return Rests.of_vectors(before_rad, q_rad[rows], ends_mm[rows], count, time_s)

    def fitted(rows: IntArray) -> StaticsFit[Parameters]:
        found = identification_of(Scaling.of(description), rests_at(rows), model)
        if found is None:
            raise misfit(rests_at(rows[:: -(-len(rows) // _RESTS_FOR_CAUSE)]), description)
        return found.finish()

    fit, everything = fitted(train), np.arange(len(q_rad))
    p = fit.scaling.parameters(fit.result().score)
    model_mm = model.predicted_mm(p, rests_at(everything))[:, 1]
    off_mm = measured.tip_mm - model_mm
    fit = fitted(everything)
    scaling, found = fit.scaling, fit.result()
    covariance = found.covariance * max(1.0, found.surprise) ** 2
    kept = rests_at(_rests_to_keep(q_rad))
    section = identified_section(kept, description, date)
    if not np.isfinite(kept.vectors_mm).all():
        del section["middle_mm"]
    mean, ahead = (np.array(scaling.parameters(np.full(COUNT, s))) for s in (0.0, 1.0))
    seen = bool(np.isfinite(ends_mm[:, 0]).any())
    shown = [
        number
        for number, name in enumerate(Parameters._fields[:COUNT])
        if number not in PUSHES and (seen or not name.startswith("middle"))
    ]
    return Identification(
        Residual.of(off_mm[train]),
        Residual.of(off_mm[held]),
        _found(
            [Parameters._fields[i] for i in shown],
            np.array(scaling.parameters(found.score))[shown],
            (ahead - mean)[shown],
            covariance[np.ix_(shown, shown)],
        ),
        {IDENTIFIED: section},
    )


def _rests_to_keep(q_rad: Array) -> IntArray:
    """Rows that tell most: all turns of a motor, as the friction remembers them, and some between.

    A row is a turn if a motor goes on in the other direction, or begins or ceases to move.
    """
    steps = np.sign(np.diff(q_rad, axis=0))
    turns = np.flatnonzero((steps[1:] != steps[:-1]).any(axis=1)) + 1
    every = np.linspace(0, len(q_rad) - 1, _MOST_RESTS).round().astype(np.intp)
    if len(turns) >= _MOST_RESTS:
        return turns[:_MOST_RESTS]
    between = every[:: max(1, math.ceil(len(every) / (_MOST_RESTS - len(turns))))]
    return np.union1d(turns, between)


def _identify_chain(
    description: Description, measured: Measured, train_share: float, *, one_plane: bool
) -> Identification:
    robot = description.robot
    travel_mm = measured.command * (1.0 if measured.unit == "mm" else robot.pulley_radius_mm)
    ends_mm = measured.ends_mm(len(robot.segments))
    seen = np.flatnonzero(np.isfinite(ends_mm).any(axis=(0, 2)))
    offset_mm = np.array([0.0, robot.marker_offset_mm, 0.0])
    markers = Markers(tuple(seen.tolist()), offset_mm, are_from_base=False)
    model = ChainModel(robot.segments, travel_mm, markers)
    rows = np.arange(len(travel_mm))
    if one_plane:
        rows = rows[model.in_one_plane(rows)]
    if one_plane and len(rows) < FEWEST_ROWS:
        raise ConfigError(f"{len(rows)} rows in one plane, too few for a fit", "omit --one-plane")
    train, held = _split(measured.time_s, rows, train_share)
    tip_mm, seen_mm = measured.tip_mm, ends_mm[:, seen]
    fit = fit_chain(model, seen_mm, train)
    of_train = Residual.of(fit.predicted_mm(train)[:, -1] - tip_mm[train])
    of_held = Residual.of(fit.predicted_mm(held)[:, -1] - tip_mm[held])
    spread_mm = Residual.of(tip_mm[train] - tip_mm[train].mean(axis=0)).rmse_mm
    home = home_of(measured)
    scatter_mm = 0.0 if home is None else home.rms_mm
    if of_train.rmse_mm > max(_EXPLAINED * spread_mm, _SCATTERS * scatter_mm):
        raise WrongRobotError(
            f"the robot does not move as described: the model leaves {of_train.rmse_mm:.1f} mm "
            f"RMS of a motion of {spread_mm:.1f} mm",
            _CURE,
        )
    final = fit_chain(model, seen_mm, rows)
    if cause := _implausible(fit) or _implausible(final):
        raise WrongRobotError(f"the robot does not move as described, but as if {cause}", _CURE)
    return Identification(
        of_train,
        of_held,
        _found(
            [unknown.name for unknown in model.unknowns],
            model.values(final.score),
            model.deviation,
            final.covariance,
        ),
        {"robot": {"segments": _segments_found(robot.segments, final)}},
    )


def _implausible(fit: ChainFit) -> str:
    """What no error of the description explains; empty if all is plausible."""
    values = fit.model.values(fit.score)
    for unknown, value in zip(fit.model.unknowns, values, strict=True):
        if unknown.kind in ("angle", "clocking") and abs(value) > _MOST_ASIDE_RAD:
            what = "tendon" if unknown.kind == "angle" else "the holes of segment"
            return f"{what} {unknown.of} stood {math.degrees(value):+.0f} deg aside"
        if unknown.kind in ("length", "tendon_radius"):
            ratio = value / unknown.mean
            if not 1.0 / _MOST_RATIO < ratio < _MOST_RATIO:
                named = unknown.kind.replace("_", " ")
                return f"the {named} of segment {unknown.of} were {value:.1f} {unknown.unit}"
    return ""


def _found(
    names: list[str], values: Array, prior_deviation: Array, covariance: Array
) -> list[Found]:
    """All parameters, with the covariance of their scores, (P, P)."""
    share = np.sqrt(np.diag(covariance))
    correlation = covariance / np.outer(share, share) - np.eye(len(names))
    found = []
    for row, name in enumerate(names):
        partner = int(np.argmax(np.abs(correlation[row])))
        together = float(correlation[row, partner])
        found.append(
            Found(
                name,
                float(values[row]),
                float(share[row] * prior_deviation[row]),
                float(prior_deviation[row]),
                names[partner] if abs(together) >= _CONFOUNDED else "",
                together,
            )
        )
    return found


def _segments_found(segments: Sequence[Segment], fit: ChainFit) -> list[dict[str, Any]]:
    """The keys of ``robot.segments`` with the fitted values, within their bounds."""
    group = fit.model.group
    lengths, radii, sag = (group(fit.score, n) for n in ("length", "tendon_radius", "sag"))
    stiffness = np.exp(np.append(0.0, group(fit.score, "log_stiffness")))
    compliance = np.exp(group(fit.score, "log_compliance"))
    dead = group(fit.score, "dead_travel")
    slack, aside = group(fit.score, "slack"), np.degrees(group(fit.score, "angle"))
    clocking = np.degrees(np.append(0.0, group(fit.score, "clocking")))
    written, place = [], 0
    for number, segment in enumerate(segments):
        tendons = []
        for tendon in segment.tendons:
            angle_deg = tendon.angle_deg + float(aside[place])
            tendons.append(
                {"angle_deg": round(angle_deg, 2), "slack_mm": round(float(slack[place]), 3)}
            )
            place += 1
        written.append(
            {
                "length_mm": round(float(lengths[number]), 2),
                "tendon_radius_mm": round(float(radii[number]), 3),
                "clocking_deg": round(segment.clocking_deg + float(clocking[number]), 2),
                "stiffness": round(float(stiffness[number]), 3),
                "compliance": round(float(compliance[number]), 4),
                "sag": round(float(sag[number]), 4),
                "dead_travel_mm": round(float(dead[number]), 3),
                "tendons": tendons,
            }
        )
    return written
