"""The configuration in use: four groups, each whole or missing."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Final, Self

from ccr_host.link.messages import Calibration, ConfigGroups, Limits, Slew, Watchdog

ALL_GROUPS: Final = ConfigGroups(0xF)

_NO_LIMITS = Limits((0, 0), (0, 0), (0, 0))
_NO_SLEW = Slew((0, 0))
_NO_WATCHDOG = Watchdog(0, 0, 0)
_NO_CALIBRATION = Calibration((0, 0), (0, 0), (0, 0), (0, 0))


@dataclass(frozen=True, slots=True)
class Configuration:
    """Four groups; a missing one reads as zeros, which are out of range or inconsistent."""

    limits: Limits = _NO_LIMITS
    slew: Slew = _NO_SLEW
    watchdog: Watchdog = _NO_WATCHDOG
    calibration: Calibration = _NO_CALIBRATION
    missing: ConfigGroups = ALL_GROUPS

    def with_group(self, group: Limits | Slew | Watchdog | Calibration) -> Configuration:
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
        return replace(changed, missing=self.missing & ~ConfigGroups[group.NAME.upper()])

    def pack(self) -> bytes:
        """All groups in the order of EEPROM."""
        return (
            self.limits.pack() + self.slew.pack() + self.watchdog.pack() + self.calibration.pack()
        )

    @classmethod
    def unpack(cls, data: bytes) -> Self | None:
        """Read what :meth:`pack` wrote; None if some value may not be used."""
        at = 0
        parts = []
        for size in (Limits.SIZE, Slew.SIZE, Watchdog.SIZE, Calibration.SIZE):
            parts.append(data[at : at + size])
            at += size
        limits, slew = Limits.unpack(parts[0]), Slew.unpack(parts[1])
        watchdog, calibration = Watchdog.unpack(parts[2]), Calibration.unpack(parts[3])
        in_range = all(
            group.first_out_of_range() is None for group in (limits, slew, watchdog, calibration)
        )
        if not in_range or limits.inconsistent_axis() is not None:
            return None
        if calibration.inconsistent_axis() is not None:
            return None
        return cls(limits, slew, watchdog, calibration, missing=ConfigGroups(0))
