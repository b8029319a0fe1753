"""From angle to servo pulse (PUL-1)."""

from __future__ import annotations

from ccr_host.link.messages import PULSE_CEILING_HALF_US, PULSE_FLOOR_HALF_US, Calibration

_REFERENCE_CDEG = 9000


def pulse_half_us(calibration: Calibration, axis: int, angle_cdeg: int) -> int:
    """Pulse of one axis, 0.5 us."""
    change = _round_half_away(angle_cdeg * calibration.per_90_deg_half_us[axis], _REFERENCE_CDEG)
    pulse = calibration.neutral_half_us[axis] + change
    pulse = max(pulse, calibration.pulse_min_half_us[axis], PULSE_FLOOR_HALF_US)
    return min(pulse, calibration.pulse_max_half_us[axis], PULSE_CEILING_HALF_US)


def _round_half_away(dividend: int, divisor: int) -> int:
    quotient = (2 * abs(dividend) + divisor) // (2 * divisor)
    return quotient if dividend >= 0 else -quotient
