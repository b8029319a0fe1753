"""Segments and tendons of a robot of any kind, ``[[robot.segments]]`` of a description."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field, model_validator

from ccr_host.description.section import Section, SegmentLength, TendonRadius, Turn, within


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

    The last four keys are what `ccr-host identify` finds besides the geometry.
    """

    length_mm: SegmentLength
    """Length of its backbone."""
    tendon_radius_mm: TendonRadius
    """From the tendon holes to the backbone."""
    bends: Literal["plane", "space"] = "space"
    """In one plane, or in any direction."""
    direction_deg: Turn = 0.0
    """Direction in which a segment bends that bends in a plane, measured as tendons' angles."""
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
