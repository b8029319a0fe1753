// Why the board started, also where the boot loader has cleared the flags that tell.
#ifndef CCR_UNO_RESET_CAUSE_H
#define CCR_UNO_RESET_CAUSE_H

#include <stdint.h>

#include "pulses.h"
#include "safety.h"

namespace uno {

// Memory that a reset leaves as it is; power-off does not.
extern volatile uint8_t ms_since_feed;

/// Every millisecond, for the next start to know whether the watchdog had reason to bite.
inline void count_ms_since_feed() {
  const uint8_t ms = ms_since_feed;
  if (ms < UINT8_MAX) {
    ms_since_feed = static_cast<uint8_t>(ms + 1);
  }
}
inline void clear_ms_since_feed() { ms_since_feed = 0; }

/// In each tick, before its pulses are handed on: whether a servo has one is what the next start
/// has to know.
void keep_in_mind(const ccr::Pulses& pulses);

/// Once, at the start.
ccr::Start find_start();

}  // namespace uno

#endif
