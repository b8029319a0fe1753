// Conversion of an angle to the width of a servo pulse.
#ifndef CCR_PULSES_H
#define CCR_PULSES_H

#include <stdint.h>

#include "ccr_messages.h"

namespace ccr {

constexpr uint16_t kNoPulse = 0;

struct Pulses {
  uint16_t half_us[kAxes];

  bool are_none() const {
    for (const uint16_t pulse : half_us) {
      if (pulse != kNoPulse) {
        return false;
      }
    }
    return true;
  }
};

/// Pulse of an angle, clamped (PUL-1).
uint16_t pulse_half_us(const Calibration& calibration, uint8_t axis, int16_t angle_cdeg);

/// Whether the pulse of this angle is clamped (PUL-1).
bool is_saturated(const Calibration& calibration, uint8_t axis, int16_t angle_cdeg);

/// Whether the calibration and the spec allow this pulse.
bool is_allowed_pulse(const Calibration& calibration, uint8_t axis, uint16_t half_us);

}  // namespace ccr

#endif
