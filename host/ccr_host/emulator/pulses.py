"""From angle to servo pulse (PUL-1)."""

from __future__ import annotations

from ccr_host.link.messages import PULSE_CEILING_HALF_US, PULSE_FLOOR_HALF_US, Calibration

_REFERENCE_CDEG = 9000


def pulse_half_us(calibration: Calibration, axis: int, angle_cdeg: int) -> int:
    """Pulse of one axis, 0.5 us."""
    pulse = _unclamped_half_us(calibration, axis, angle_cdeg)
    pulse = max(pulse, calibration.pulse_min_half_us[axis], PULSE_FLOOR_HALF_US)
    return min(pulse, calibration.pulse_max_half_us[axis], PULSE_CEILING_HALF_US)


def is_saturated(calibration: Calibration, axis: int, angle_cdeg: int) -> bool:
    """Whether the pulse limits clamp the pulse of this angle."""
    pulse = _unclamped_half_us(calibration, axis, angle_cdeg)
    return pulse != pulse_half_us(calibration, axis, angle_cdeg)


def _unclamped_half_us(calibration: Calibration, axis: int, angle_cdeg: int) -> int:
    change = _round_half_away(angle_cdeg * calibration.per_90_deg_half_us[axis], _REFERENCE_CDEG)
    return calibration.neutral_half_us[axis] + change


def _round_half_away(dividend: int, divisor: int) -> int:
    quotient = (2 * abs(dividend) + divisor) // (2 * divisor)
    return quotient if dividend >= 0 else -quotient
