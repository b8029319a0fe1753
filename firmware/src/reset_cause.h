// Cause of the last reset, even if the boot loader has cleared the reset flags.
#ifndef CCR_AVR_RESET_CAUSE_H
#define CCR_AVR_RESET_CAUSE_H

#include <stdint.h>

#include "pulses.h"
#include "safety.h"

namespace avr {

// Kept through a reset, but not through a loss of power.
extern volatile uint8_t ms_since_feed;

/// Call every millisecond, so that the next start knows whether the watchdog had expired.
inline void count_ms_since_feed() {
  const uint8_t ms = ms_since_feed;
  if (ms < UINT8_MAX) {
    ms_since_feed = static_cast<uint8_t>(ms + 1);
  }
}
inline void clear_ms_since_feed() { ms_since_feed = 0; }

/// Call in each tick before its pulses are handed on: stores for the next start whether there are
/// pulses.
void remember_pulses(const ccr::Pulses& pulses);

/// Call once, at the start.
ccr::Start find_start();

}  // namespace avr

#endif
