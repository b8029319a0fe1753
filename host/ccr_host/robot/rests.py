"""Measured rest poses of the robot, and motors that led it there otherwise than described."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterable
from dataclasses import dataclass, fields, replace
from typing import NamedTuple, Self

import numpy as np
import scipy

from ccr_host.core.arrays import Array, BoolArray, IntArray
from ccr_host.core.errors import ConfigError
from ccr_host.description.schema import Description, Robot

_SAME_RAD = np.radians(0.5)
"""Setpoints nearer than this are the same pose."""
_SHOWS_RAD = np.radians(15.0)
"""Travel of a motor after which a marker has moved; the first move of a check is 20 deg."""
_ONE_PICTURE_MM = 1e-6
"""Rounding of means; no camera repeats a place that well."""
_VERY_LONG_S = 1e9
_ROUNDING = 1e-9
"""Singular values of the motor angles below this share of the largest one are rounding: motors that
always turn together move the tip together."""
_PULSE_KEYS = {"neutral_pulse_us", "pulse_per_90_deg_us"}
"""The servo keys that define a commanded angle; limits may change."""
_DIGITS = 12


@dataclass(frozen=True, eq=False)
class Rests:
    """Rests in the order in which the robot visited them."""

    from_rad: Array
    """Motor angles from which the robot moved straight to each rest, (N, n)."""
    q_rad: Array
    """Motor angles commanded at each rest, (N, n)."""
    markers_mm: Array
    """M1, M2 and so on, one per row, (N, S + 1, 3), in any common frame; NaN for those not seen."""
    count: Array
    """Number of exposures averaged at each rest, (N,)."""
    time_s: Array
    """Mean time of the exposures, (N,); NaN if not known."""

    @classmethod
    def in_turn(cls, start_rad: Array, q_rad: Array, markers_mm: Array, count: Array) -> Rests:
        """Rests that were each reached straight from the one before, the first from (n,).

        Their times are not known.
        """
        from_rad = np.concatenate([start_rad[None], q_rad])[:-1]
        return cls(from_rad, q_rad, markers_mm, count, np.full(len(q_rad), np.nan))

    @classmethod
    def of_vectors(
        cls,
        from_rad: Array,
        q_rad: Array,
        vectors_mm: Array,
        count: Array,
        time_s: Array | None = None,
    ) -> Rests:
        """Rests from M2 and so on relative to M1, (N, S, 3), with M1 as the origin."""
        time_s = np.full(len(q_rad), np.nan) if time_s is None else time_s
        markers_mm = np.concatenate([np.zeros_like(vectors_mm[:, :1]), vectors_mm], axis=1)
        return cls(from_rad, q_rad, markers_mm, count, time_s)

    def durations_s(self) -> Array:
        """Times of both straight motions to each rest, from the one before, (N, 2).

        They share the time between both rests in proportion to their lengths. It counts as very
        long if it is not known.
        """
        before_rad = np.concatenate([self.from_rad[:1], self.q_rad[:-1]])
        ways = (self.from_rad - before_rad, self.q_rad - self.from_rad)
        first_rad, then_rad = (np.abs(way_rad).max(axis=1) for way_rad in ways)
        share = first_rad / np.maximum(first_rad + then_rad, _SAME_RAD)
        apart_s = np.diff(self.time_s, prepend=np.nan)
        apart_s = np.where(apart_s >= 0.0, apart_s, _VERY_LONG_S)
        return np.column_stack([share * apart_s, (1.0 - share) * apart_s])

    def stops(self) -> tuple[Array, IntArray]:
        """Motor angles of all stops in turn, (K, n), and the number of each rest's among them."""
        both_rad = np.stack([self.from_rad, self.q_rad], axis=1).reshape(-1, self.q_rad.shape[1])
        is_new = np.append(True, (np.diff(both_rad, axis=0) != 0.0).any(axis=1))
        return both_rad[is_new], (np.cumsum(is_new) - 1)[1::2]

    @property
    def vectors_mm(self) -> Array:
        """M2 and so on relative to M1, (N, S, 3)."""
        return self.markers_mm[:, 1:] - self.markers_mm[:, :1]

    @property
    def tip_mm(self) -> Array:
        """The last marker relative to M1, (N, 3)."""
        return self.vectors_mm[:, -1]

    def chosen(self, rows: BoolArray | list[int] | slice) -> Rests:
        return Rests(*(getattr(self, field.name)[rows] for field in fields(self)))

    def then(self, later: Rests) -> Rests:
        """These rests and those of a later tour."""
        both = ((getattr(self, each.name), getattr(later, each.name)) for each in fields(self))
        return Rests(*map(np.concatenate, both))

    def ways(self) -> Array:
        """Sign of each motor's last motion before each rest, (N, n); 0 before it moved."""
        ways = np.sign(self.q_rad - self.from_rad)
        for number in range(1, len(ways)):
            ways[number] += (ways[number] == 0.0) * ways[number - 1]
        return ways

    def from_both_sides(self) -> list[int]:
        """Rests, not overlapping, whose next one is the same pose reached from the other side."""
        found: list[int] = []
        travel_rad = self.q_rad - self.from_rad
        for here in range(len(self.q_rad) - 1):
            apart_rad = np.abs(self.q_rad[here + 1] - self.q_rad[here]).max()
            is_new = not found or here > found[-1] + 1
            if is_new and apart_rad < _SAME_RAD and (travel_rad[here] @ travel_rad[here + 1]) < 0.0:
                found.append(here)
        return found

    def merged(self) -> Rests:
        """The rests with one, at the mean place, for each pair of ``from_both_sides``.

        It is the place without hysteresis, and counts as reached straight from the rest before.
        """
        from_rad, markers_mm = self.from_rad.copy(), self.markers_mm.copy()
        rows = np.ones(len(self.q_rad), dtype=np.bool_)
        for first in self.from_both_sides():
            from_rad[first] = self.q_rad[first]
            markers_mm[first] = markers_mm[first : first + 2].mean(axis=0)
            rows[first + 1] = False
        return replace(self, from_rad=from_rad, markers_mm=markers_mm).chosen(rows)

    def hysteresis_mm(self) -> Array:
        """Half the distance between the tips of a pose that a motor approached from both sides.

        (n,), one mean per motor, while the other motors came from the same side both times; if they
        never did, of the poses in which the motor is turned furthest; NaN if there was no such
        pose.
        """
        ways, tip_mm = self.ways(), self.tip_mm
        first, second = np.triu_indices(len(ways), k=1)
        same = np.abs(self.q_rad[first] - self.q_rad[second]).max(axis=1) < _SAME_RAD
        apart = same & (ways[first] != ways[second]).any(axis=1)
        turned_rad = np.abs(self.q_rad[first])
        is_furthest = turned_rad > turned_rad.max(axis=1, keepdims=True) - _SAME_RAD
        found = np.full(ways.shape[1], np.nan)
        for motor in range(len(found)):
            opposite = ways[first, motor] * ways[second, motor] < 0.0
            others_alike = np.delete(ways[first] == ways[second], motor, axis=1).all(axis=1)
            pairs = same & opposite & others_alike
            pairs = pairs if pairs.any() else apart & is_furthest[:, motor]
            if pairs.any():
                apart_mm = tip_mm[first[pairs]] - tip_mm[second[pairs]]
                found[motor] = 0.5 * np.linalg.norm(apart_mm, axis=1).mean()
        return found

    def moved_mm(self) -> Array:
        """Linear motion of the tip by each motor, (n,)."""
        design = np.column_stack([self.q_rad, np.ones(len(self.q_rad))])
        by_motor = np.linalg.lstsq(design, self.tip_mm, rcond=_ROUNDING)[0][:-1]
        moved_mm: Array = np.linalg.norm(by_motor, axis=1) * np.ptp(self.q_rad, axis=0)
        return moved_mm

    def are_one_picture(self, led_rad: float = _SHOWS_RAD) -> bool:
        """Whether the markers stand at the same places although a motor turned by ``led_rad``."""
        is_led = bool((np.ptp(self.q_rad, axis=0) > led_rad).any())
        return is_led and not (np.ptp(self.markers_mm, axis=0) > _ONE_PICTURE_MM).any()

    def last(self, number: int) -> Rests:
        return self.chosen(slice(max(len(self.q_rad) - number, 0), None))

    def turned(self, rotation: Array) -> Rests:
        """The rests in another frame; ``rotation`` (3, 3) maps vectors of this frame to it."""
        return replace(self, markers_mm=self.markers_mm @ rotation.T)

    def turned_onto(self, expected_mm: Array, *, mirrored: bool = False) -> Rests:
        """The rests in the frame, a left-handed one if ``mirrored``, nearest to (N, S, 3)."""
        handed = np.diag([-1.0 if mirrored else 1.0, 1.0, 1.0])
        seen = np.isfinite(self.vectors_mm).all(axis=-1)
        turn, _ = scipy.spatial.transform.Rotation.align_vectors(
            expected_mm[seen] @ handed, self.vectors_mm[seen]
        )
        return self.turned(handed @ turn.as_matrix())


def numbered(motors: Iterable[int]) -> str:
    """Motors, from 0, by the numbers that users know."""
    return " and ".join(str(motor + 1) for motor in motors)


class Motors(NamedTuple):
    """A hypothesis on the motors."""

    signs: tuple[float, ...]
    """-1 for a reversed motor, 0 for one that does not turn, else 1."""
    order: tuple[int, ...]
    """The motor, from 0, that acts as each described one."""

    @classmethod
    def as_described(cls, count: int) -> Self:
        """Return the hypothesis that all ``count`` motors are as described."""
        return cls((1.0,) * count, tuple(range(count)))

    @property
    def exchanged(self) -> list[int]:
        """Motors that act as another one, from 0."""
        return [motor for motor, acting in enumerate(self.order) if motor != acting]

    @property
    def reversed(self) -> list[int]:
        """Motors that turn the other way, from 0."""
        return [motor for motor, sign in enumerate(self.signs) if sign < 0.0]

    @property
    def idle(self) -> list[int]:
        """Motors that do not turn, from 0."""
        return [motor for motor, sign in enumerate(self.signs) if sign == 0.0]

    def told(self) -> str:
        """What is not as described, for users; "" if all is."""
        told = []
        if self.exchanged:
            told.append(f"motors {numbered(self.exchanged)} are exchanged")
        if self.reversed:
            told.append(f"motor {numbered(self.reversed)} reversed")
        return ", ".join(told)

    def drive(self, rests: Rests) -> Rests:
        """The rests with the setpoints that the model's motors get if the real ones are so."""
        signs, order = np.array(self.signs), list(self.order)
        return replace(
            rests,
            from_rad=(signs * rests.from_rad)[:, order],
            q_rad=(signs * rests.q_rad)[:, order],
        )


def digest_of(description: Description) -> str:
    """Digest of everything in a description that its identified rests depend on."""
    registration = description.registration
    robot = description.robot.model_dump()
    if not description.robot.segments:
        del robot["segments"]
    if description.robot.gravity_direction == Robot().gravity_direction:
        # Files identified before the key existed stay valid.
        del robot["gravity_direction"]
    meaning = {
        "robot": robot,
        "servo": description.servo.model_dump(include=_PULSE_KEYS),
        "camera": None if registration is None else registration.camera_to_robot_deg,
    }
    text = json.dumps(meaning, sort_keys=True)
    return hashlib.sha256(text.encode()).hexdigest()[:_DIGITS]


def identified_rests(description: Description) -> Rests | None:
    """The rests stored in a description; None if there are none.

    Raises:
        ConfigError: they were measured with another geometry, servo pulses or registration.
    """
    identified = description.identified
    if identified is None:
        return None
    if identified.valid_for != digest_of(description):
        raise ConfigError(
            "section identified was measured with another [robot], other servo pulses or another "
            "[registration]",
            "identify again: ccr-host calibrate --identify; or remove the section",
        )
    tip_mm = np.array(identified.tip_mm)
    vectors_mm = np.full((len(tip_mm), len(description.robot.chain), 3), np.nan)
    middle_mm = np.array(identified.middle_mm).reshape(len(tip_mm), -1, 3)[:, : len(vectors_mm[0])]
    vectors_mm[:, : middle_mm.shape[1]] = middle_mm
    vectors_mm[:, -1] = tip_mm
    q_rad = np.array(identified.setpoint_rad)
    from_rad = identified.from_rad or (identified.start_rad, *identified.setpoint_rad[:-1])
    count = np.array(identified.count, dtype=np.float64)
    time_s = np.array(identified.time_s) if identified.time_s else None
    return Rests.of_vectors(np.array(from_rad), q_rad, vectors_mm, count, time_s)
