"""The robot itself: segments one after another, and motors that wind tendons."""

from __future__ import annotations

import cmath
import math
from typing import Annotated, Any, Literal

from pydantic import (
    AfterValidator,
    Field,
    SerializerFunctionWrapHandler,
    model_serializer,
    model_validator,
)

from ccr_host.description.section import (
    Direction,
    EachSegment,
    MarkerOffset,
    PulleyRadius,
    Section,
    SegmentLength,
    TendonRadius,
    Turn,
    within,
)

LONGEST_BOARD_NAME = 16
"""Characters that the board can store."""
MOST_MOTORS = 12
"""Servos of the largest board, see docs/porting.md."""
_PLANAR_SEGMENTS = 2
_NO_PULL = 1e-3
"""Share of a tendon's pull that counts as none."""
_QUARTER_DEG, _HALF_DEG = 90.0, 180.0


def checked_board_name(name: str) -> str:
    """Return the name if a board can store it.

    Raises:
        ValueError: too long, not printable ASCII, or with a space at an end.
    """
    room = LONGEST_BOARD_NAME
    if not (name.isascii() and name.isprintable() and len(name) <= room and name == name.strip()):
        shown = ascii(name if len(name) <= room else name[:room] + "...")
        raise ValueError(
            f"{shown} is not up to {room} printable ASCII characters without a space at the ends"
        )
    return name


class Tendon(Section):
    """A tendon of a robot of any number of segments, `[[robot.segments.tendons]]`."""

    angle_deg: Turn
    """Place of its holes about the backbone, from x towards y of the base."""
    motor: Annotated[int, within(1, 12)]
    """The motor that winds it."""
    winding: Annotated[int, within(-1, 1)] = 1
    """1 if the motor pulls it in the positive direction, -1 in the other."""
    slack_mm: Annotated[float, within(-100, 100)] = 0.0
    """Travel that takes up its slack; negative for a tendon that is taut at rest."""

    @model_validator(mode="after")
    def _is_wound(self) -> Tendon:
        if self.winding == 0:
            raise ValueError("robot.segments.tendons.winding = 0 is neither 1 nor -1")
        return self


class Segment(Section):
    """A segment of a robot of any number of segments, from the base, `[[robot.segments]]`.

    The last five keys are what `ccr-host identify` finds besides the geometry.
    """

    length_mm: SegmentLength
    """Length of its backbone."""
    tendon_radius_mm: TendonRadius
    """Distance of the tendon holes from the backbone."""
    bends: Literal["plane", "space"] = "space"
    """Whether it bends in one plane or in any direction."""
    direction_deg: Turn = 0.0
    """Direction in which a segment bends that bends in a plane, measured as tendons' angles."""
    clocking_deg: Annotated[float, within(-45, 45)] = 0.0
    """Turn of the holes in its disks about the backbone, against the tendons' `angle_deg`."""
    stiffness: Annotated[float, within(0.01, 100)] = 1.0
    """Its bending stiffness over that of the first segment."""
    compliance: Annotated[float, within(1e-4, 100)] = 0.05
    """Additional motor angle due to the stretch of its tendons, over the bending angle."""
    sag: Annotated[float, within(-1, 1)] = 0.0
    """Slack in tendon radii that bending adds to every tendon, per rad^2."""
    dead_travel_mm: Annotated[float, within(0, 100)] = 0.0
    """Travel that its tendons lose after each reversal, half on either side."""
    tendons: Annotated[tuple[Tendon, ...], Field(min_length=1, max_length=12)]
    """The tendons that end at its last disk; they run through all earlier segments."""


class Robot(Section):
    """Geometry in the controller's model: the paper's Table I, or any robot by its segments."""

    segment_lengths_mm: EachSegment[SegmentLength] = (58.5, 43.5)
    """L_1 and L_2."""
    tendon_radius_mm: TendonRadius = 4.5
    """r_c, from the tendon hole to the centre of the disk."""
    marker_offset_mm: MarkerOffset = 15.0
    """d_m, from the centre of the disk to the marker."""
    pulley_radius_mm: PulleyRadius = 12.5
    """r_p, radius of the pulley on the servo."""
    gravity_direction: Direction = (0.0, 0.0, -1.0)
    """Direction of gravity in the frame of (10): [0, 0, 1] for a robot mounted upside
    down, [1, 0, 0] or [-1, 0, 0] on its side, [0, -1, 0] hanging straight down."""
    board_name: Annotated[str, AfterValidator(checked_board_name)] = ""
    """Name that the board must have, unless empty; see `ccr-host calibrate --board-name`."""
    segments: Annotated[tuple[Segment, ...], Field(max_length=MOST_MOTORS)] = ()
    """A robot of another kind, from the base to the tip, instead of the lengths and the radius
    above, which describe the paper's: two segments that bend in planes at a right angle, with a
    motor and two tendons each."""

    @property
    def chain(self) -> tuple[Segment, ...]:
        """The segments from the base to the tip, of the paper's robot too."""
        if self.segments:
            return self.segments
        return tuple(
            # The numbers are checked already, and a plant may have a segment of length zero.
            Segment.model_construct(
                length_mm=length_mm,
                tendon_radius_mm=self.tendon_radius_mm,
                bends="plane",
                direction_deg=direction_deg,
                tendons=(
                    Tendon(angle_deg=direction_deg, motor=motor),
                    Tendon(angle_deg=direction_deg + _HALF_DEG, motor=motor, winding=-1),
                ),
            )
            for motor, direction_deg, length_mm in zip(
                (1, 2), (_QUARTER_DEG, 0.0), self.segment_lengths_mm, strict=True
            )
        )

    @property
    def tendons(self) -> tuple[tuple[int, Tendon], ...]:
        """Each tendon with the number of its segment, from 0, in the order of their numbers.

        The first tendon of every segment, then the second one of every segment, and so on.
        """
        return tendons_of(self.chain)

    @property
    def motors(self) -> int:
        return max(tendon.motor for _, tendon in self.tendons)

    @property
    def markers(self) -> tuple[str, ...]:
        """Names of the markers: M1 at the base, then one at the end of each segment."""
        return tuple(f"M{number + 1}" for number in range(len(self.chain) + 1))

    @model_validator(mode="after")
    def _is_described_once(self) -> Robot:
        both = {"segment_lengths_mm", "tendon_radius_mm"} & self.model_fields_set
        if self.segments and both:
            raise ValueError(
                f"robot.{min(both)} describes the paper's robot, and robot.segments another one: "
                "remove one of them"
            )
        if not self.segments and len(self.segment_lengths_mm) != _PLANAR_SEGMENTS:
            raise ValueError(
                f"robot.segment_lengths_mm = {list(self.segment_lengths_mm)}: give two values, or "
                "describe another robot by robot.segments"
            )
        if self.segments:
            # What knows only the lengths and one radius, such as a drawing, sees those.
            self.__dict__["segment_lengths_mm"] = tuple(s.length_mm for s in self.segments)
            self.__dict__["tendon_radius_mm"] = max(s.tendon_radius_mm for s in self.segments)
        return self

    @model_validator(mode="after")
    def _every_motor_bends_it(self) -> Robot:
        for motor in sorted(
            {tendon.motor for segment in self.segments for tendon in segment.tendons}
        ):
            pulls = [
                (number, tendon.winding * cmath.rect(1.0, math.radians(tendon.angle_deg)))
                for number, segment in enumerate(self.segments)
                for tendon in segment.tendons
                if tendon.motor == motor
            ]
            for number, segment in enumerate(self.segments):
                pull = sum(pull for last, pull in pulls if last >= number)
                turn_rad = math.radians(segment.clocking_deg - segment.direction_deg)
                along = pull * cmath.rect(1.0, turn_rad)
                if abs(along.real if segment.bends == "plane" else along) > _NO_PULL:
                    break
            else:
                raise ValueError(
                    f"robot.segments: motor {motor} bends no segment, as its tendons cancel each "
                    "other or lie across the plane: correct angle_deg, winding or direction_deg"
                )
        return self

    @model_serializer(mode="wrap")
    def _as_described(self, handler: SerializerFunctionWrapHandler) -> dict[str, Any]:
        written: dict[str, Any] = handler(self)
        if self.segments:
            for key in ("segment_lengths_mm", "tendon_radius_mm"):
                written.pop(key, None)
        return written

    @model_validator(mode="after")
    def _motors_are_counted_from_1(self) -> Robot:
        used = {tendon.motor for segment in self.segments for tendon in segment.tendons}
        if missing := set(range(1, max(used, default=0) + 1)) - used:
            raise ValueError(
                f"robot.segments: no tendon is wound by motor {min(missing)} of {max(used)}"
            )
        return self


def tendons_of(chain: tuple[Segment, ...]) -> tuple[tuple[int, Tendon], ...]:
    """The tendons of segments, see `Robot.tendons`."""
    most = max(len(segment.tendons) for segment in chain)
    return tuple(
        (number, segment.tendons[place])
        for place in range(most)
        for number, segment in enumerate(chain)
        if place < len(segment.tendons)
    )
