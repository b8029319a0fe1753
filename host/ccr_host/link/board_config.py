"""Converts the robot description to the board's configuration groups."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, fields, replace
from math import floor, isqrt
from typing import Final

from ccr_host.core.errors import ConfigError
from ccr_host.core.wire import CDEG_PER_DEG, deg_to_cdeg
from ccr_host.description.schema import Description
from ccr_host.link.device_errors import TooFewAxesError
from ccr_host.link.messages import (
    TICK_US,
    Acceleration,
    Calibration,
    Equipment,
    Limits,
    Slew,
    Watchdog,
)
from ccr_host.link.payload import Field

_TICK_S = TICK_US * 1e-6
_HALF_US_PER_US = 2
_ROUNDING_SLACK = 1e-9
_MARGIN_US = 1_000_000

_KEYS: Final[dict[type, tuple[str, ...]]] = {
    Limits: ("servo.angle_min_deg", "servo.angle_max_deg", "servo.rest_deg"),
    Slew: ("servo.slew_deg_s",),
    Watchdog: ("link.relax_after_ms", "link.relax_slew_deg_s", "link.arm_axis_ms"),
    Calibration: (
        "servo.neutral_pulse_us",
        "servo.pulse_per_90_deg_us",
        "servo.pulse_min_us",
        "servo.pulse_max_us",
    ),
    Acceleration: ("servo.acceleration_deg_s2",),
}
"""Description key of each field of a group, in the order on the wire."""


@dataclass(frozen=True, slots=True)
class BoardConfig:
    """The configuration that a board needs before it may be armed."""

    limits: Limits
    slew: Slew
    watchdog: Watchdog
    calibration: Calibration
    acceleration: Acceleration

    @property
    def axes(self) -> int:
        return len(self.slew.slew_cdeg_tick)

    def for_board(self, axes: int) -> BoardConfig:
        """The same for a board with more axes than motors, whose other axes are as the last one.

        Raises:
            TooFewAxesError: it has fewer axes.
        """
        if axes < self.axes:
            raise TooFewAxesError(axes, self.axes)
        wide = {group.name: getattr(self, group.name).with_axes(axes) for group in fields(self)}
        return replace(self, **wide)

    def way_to_rest_us(self) -> int:
        """Upper bound of the time from any pose to rest."""
        longest_ticks = 0
        for axis in range(self.axes):
            range_cdeg = self.limits.angle_max_cdeg[axis] - self.limits.angle_min_cdeg[axis]
            slew = min(self.watchdog.relax_slew_cdeg_tick, self.slew.slew_cdeg_tick[axis])
            ticks = range_cdeg // max(slew, 1) + 1
            acceleration = self.acceleration.acceleration_cdeg_tick2[axis]
            if acceleration:
                # to accelerate, and before that to brake from the fastest motion within the range
                ticks += slew // acceleration + isqrt(2 * range_cdeg // acceleration) + 4
            longest_ticks = max(longest_ticks, ticks)
        return longest_ticks * TICK_US + _MARGIN_US


ConfigGroup = Limits | Slew | Watchdog | Calibration | Acceleration


def differences(seen: BoardConfig, wanted: BoardConfig) -> list[str]:
    """List the differences: the description's key and both values."""
    return [
        f"{key} is {_shown(field, getattr(there, field.name))}, "
        f"described {_shown(field, getattr(here, field.name))} {field.unit}".rstrip()
        for there, here in zip(_groups(seen), _groups(wanted), strict=True)
        for key, field in zip(_KEYS[type(here)], here.FIELDS, strict=True)
        if getattr(there, field.name) != getattr(here, field.name)
    ]


def board_name(equipment: Equipment) -> str:
    """The board's name; empty if it has none."""
    return bytes(equipment.board_name).rstrip(b"\0").decode("ascii", "replace")


def _groups(config: BoardConfig) -> tuple[ConfigGroup, ...]:
    return tuple(getattr(config, group.name) for group in fields(config))


def _shown(field: Field, raw: int | tuple[int, ...]) -> str:
    values = raw if isinstance(raw, tuple) else (raw,)
    return ", ".join(f"{value * field.scale:g}" for value in values)


def board_config(description: Description) -> BoardConfig:
    """Round a description to the wire's integers; rates are rounded down.

    Raises:
        ConfigError: names the key whose value the board cannot take.
    """
    servo, link = description.servo, description.link
    config = BoardConfig(
        limits=Limits(
            angle_min_cdeg=_cdeg(servo.angle_min_deg),
            angle_max_cdeg=_cdeg(servo.angle_max_deg),
            rest_cdeg=_cdeg(servo.rest_deg),
        ),
        slew=Slew(tuple(map(_cdeg_per_tick, servo.slew_deg_s))),
        watchdog=Watchdog(
            relax_after_ms=link.relax_after_ms,
            relax_slew_cdeg_tick=_cdeg_per_tick(link.relax_slew_deg_s),
            arm_axis_ms=link.arm_axis_ms,
        ),
        calibration=Calibration(
            neutral_half_us=_half_us(servo.neutral_pulse_us),
            per_90_deg_half_us=_half_us(servo.pulse_per_90_deg_us),
            pulse_min_half_us=_half_us(servo.pulse_min_us),
            pulse_max_half_us=_half_us(servo.pulse_max_us),
        ),
        acceleration=Acceleration(tuple(map(_cdeg_per_tick2, servo.acceleration_deg_s2))),
    )
    for group in _groups(config):
        _require_in_range(group)
    _require_consistent(config)
    return config


def _cdeg(angles_deg: Iterable[float]) -> tuple[int, ...]:
    return tuple(map(deg_to_cdeg, angles_deg))


def _cdeg_per_tick(rate_deg_s: float) -> int:
    return floor(rate_deg_s * _TICK_S * CDEG_PER_DEG + _ROUNDING_SLACK)


def _cdeg_per_tick2(acceleration_deg_s2: float) -> int:
    rounded = floor(acceleration_deg_s2 * _TICK_S**2 * CDEG_PER_DEG + _ROUNDING_SLACK)
    if acceleration_deg_s2 and not rounded:
        least = 1 / (_TICK_S**2 * CDEG_PER_DEG)
        raise ConfigError(
            f"servo.acceleration_deg_s2: the board cannot take {acceleration_deg_s2:g} deg/s^2",
            f"it takes {least:g} and more, or 0 for no limit",
        )
    return rounded


def _half_us(pulses_us: Iterable[float]) -> tuple[int, ...]:
    return tuple(round(pulse_us * _HALF_US_PER_US) for pulse_us in pulses_us)


def _require_in_range(group: ConfigGroup) -> None:
    index = group.first_out_of_range()
    if index is None:
        return
    field = group.FIELDS[index]
    shown = _shown(field, getattr(group, field.name))
    least, greatest = field.minimum * field.scale, field.maximum * field.scale
    raise ConfigError(
        f"{_KEYS[type(group)][index]}: the board cannot take {shown} {field.unit}",
        f"it takes {least:g} to {greatest:g} {field.unit}",
    )


def _require_consistent(config: BoardConfig) -> None:
    axis = config.limits.inconsistent_axis()
    if axis is not None:
        raise ConfigError(
            f"servo.angle_min_deg and angle_max_deg of axis {axis + 1} do not enclose an angle",
            "let angle_min_deg <= rest_deg <= angle_max_deg, at least 0.01 deg apart",
        )
    axis = config.calibration.inconsistent_axis()
    if axis is not None:
        raise ConfigError(
            f"servo.neutral_pulse_us and its neighbours contradict each other (axis {axis + 1})",
            "let pulse_min_us <= neutral_pulse_us <= pulse_max_us and"
            " |pulse_per_90_deg_us| be at least 50",
        )
