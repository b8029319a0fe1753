#include "watchdog.h"

#include <avr/wdt.h>

#include "reset_cause.h"

namespace avr {

void ProgressWatchdog::feed_if_both_progressed() {
  if (!has_ticked_ || !has_received_) {
    return;
  }
  has_ticked_ = false;
  has_received_ = false;
  wdt_reset();
  clear_ms_since_feed();
}

}  // namespace avr
