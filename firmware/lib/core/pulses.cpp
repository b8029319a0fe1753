#include "pulses.h"

namespace ccr {

namespace {

constexpr int16_t kReferenceCdeg = 9000;

/// Rounds to nearest, halves away from zero.
int32_t rounded_quotient(int32_t dividend, int16_t divisor) {
  const int32_t half = divisor / 2;
  return (dividend < 0 ? dividend - half : dividend + half) / divisor;
}
static_assert(kReferenceCdeg % 2 == 0, "half of it is whole");

int32_t wanted_half_us(const Calibration& calibration, uint8_t axis, int16_t angle_cdeg) {
  const int32_t change =
      rounded_quotient(static_cast<int32_t>(angle_cdeg) * calibration.per_90_deg_half_us[axis],
                       kReferenceCdeg);
  return calibration.neutral_half_us[axis] + change;
}

uint16_t least_half_us(const Calibration& calibration, uint8_t axis) {
  const uint16_t least = calibration.pulse_min_half_us[axis];
  return least > kPulseFloorHalfUs ? least : kPulseFloorHalfUs;
}

uint16_t greatest_half_us(const Calibration& calibration, uint8_t axis) {
  const uint16_t greatest = calibration.pulse_max_half_us[axis];
  return greatest < kPulseCeilingHalfUs ? greatest : kPulseCeilingHalfUs;
}

}  // namespace

uint16_t pulse_half_us(const Calibration& calibration, uint8_t axis, int16_t angle_cdeg) {
  const int32_t pulse = wanted_half_us(calibration, axis, angle_cdeg);
  const uint16_t least = least_half_us(calibration, axis);
  const uint16_t greatest = greatest_half_us(calibration, axis);
  if (pulse < least) {
    return least;
  }
  return pulse > greatest ? greatest : static_cast<uint16_t>(pulse);
}

// Compares the products that `rounded_quotient` would divide: a division takes 600 cycles, and a
// target of 12 axes would need 12 of them. With a neutral pulse in range, a quotient is beyond the
// whole number n if the dividend is at least half a divisor beyond that of n.
bool is_saturated(const Calibration& calibration, uint8_t axis, int16_t angle_cdeg) {
  const int16_t neutral = static_cast<int16_t>(calibration.neutral_half_us[axis]);
  const int16_t down = static_cast<int16_t>(least_half_us(calibration, axis) - neutral);
  const int16_t up = static_cast<int16_t>(greatest_half_us(calibration, axis) - neutral);
  const int32_t product = int32_t{angle_cdeg} * calibration.per_90_deg_half_us[axis];
  return product <= int32_t{down} * kReferenceCdeg - kReferenceCdeg / 2 ||
         product >= int32_t{up} * kReferenceCdeg + kReferenceCdeg / 2;
}

bool is_allowed_pulse(const Calibration& calibration, uint8_t axis, uint16_t half_us) {
  return half_us >= least_half_us(calibration, axis) &&
         half_us <= greatest_half_us(calibration, axis);
}

}  // namespace ccr
