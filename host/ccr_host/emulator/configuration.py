"""The configuration in use: six groups, each whole or missing."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Final, Self

from ccr_host.link.messages import (
    Acceleration,
    Calibration,
    ConfigGroups,
    Equipment,
    Limits,
    Slew,
    Watchdog,
)

ConfigGroup = Limits | Slew | Watchdog | Calibration | Equipment | Acceleration

NEVER_SET: Final = (
    ConfigGroups.LIMITS | ConfigGroups.SLEW | ConfigGroups.WATCHDOG | ConfigGroups.CALIBRATION
)
"""What a new board lacks."""

_NO_LIMITS = Limits((0, 0), (0, 0), (0, 0))
_NO_SLEW = Slew((0, 0))
_NO_WATCHDOG = Watchdog(0, 0, 0)
_NO_CALIBRATION = Calibration((0, 0), (0, 0), (0, 0), (0, 0))
_NO_ACCELERATION = Acceleration((0, 0))
_NO_EQUIPMENT = Equipment((0,) * 16, 0, 0, 0)
_SIZES = (
    *(Limits.SIZE, Slew.SIZE, Watchdog.SIZE, Calibration.SIZE),
    *(Equipment.SIZE, Acceleration.SIZE),
)
EEPROM_CONFIGURATION_SIZE = sum(_SIZES)


@dataclass(frozen=True, slots=True)
class Configuration:
    """Six groups; a missing one reads as zeros, which are out of range or inconsistent."""

    limits: Limits = _NO_LIMITS
    slew: Slew = _NO_SLEW
    watchdog: Watchdog = _NO_WATCHDOG
    calibration: Calibration = _NO_CALIBRATION
    equipment: Equipment = _NO_EQUIPMENT
    acceleration: Acceleration = _NO_ACCELERATION
    missing: ConfigGroups = NEVER_SET

    def with_group(self, group: ConfigGroup) -> Configuration:
        """The same with one group replaced."""
        match group:
            case Limits():
                changed = replace(self, limits=group)
            case Slew():
                changed = replace(self, slew=group)
            case Watchdog():
                changed = replace(self, watchdog=group)
            case Calibration():
                changed = replace(self, calibration=group)
            case Equipment():
                changed = replace(self, equipment=group)
            case Acceleration():
                return replace(self, acceleration=group)
        return replace(changed, missing=self.missing & ~ConfigGroups[group.NAME.upper()])

    def pack(self) -> bytes:
        """All groups in the order of EEPROM."""
        robots = (self.limits, self.slew, self.watchdog, self.calibration)
        groups = (*robots, self.equipment, self.acceleration)
        return b"".join(group.pack() for group in groups)

    @classmethod
    def unpack(cls, data: bytes) -> Self | None:
        """Read what :meth:`pack` wrote; None if some value may not be used.

        Of layout 1 without equipment and acceleration, which are zeros then.
        """
        data = data.ljust(EEPROM_CONFIGURATION_SIZE, b"\0")
        at = 0
        parts = []
        for size in _SIZES:
            parts.append(data[at : at + size])
            at += size
        limits, slew = Limits.unpack(parts[0]), Slew.unpack(parts[1])
        watchdog, calibration = Watchdog.unpack(parts[2]), Calibration.unpack(parts[3])
        equipment = Equipment.unpack(parts[4])
        groups = (limits, slew, watchdog, calibration, equipment, Acceleration.unpack(parts[5]))
        in_range = all(group.first_out_of_range() is None for group in groups)
        if not in_range or limits.inconsistent_axis() is not None:
            return None
        if calibration.inconsistent_axis() is not None:
            return None
        return cls(*groups, missing=ConfigGroups(0))
