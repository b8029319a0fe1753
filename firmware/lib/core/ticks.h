// Durations in control ticks. They are counted down, not compared with a clock, so nothing wraps.
#ifndef CCR_TICKS_H
#define CCR_TICKS_H

#include <stdint.h>

#include "ccr_messages.h"

namespace ccr {

constexpr uint8_t kMsPerTick = kTickUs / 1000;
static_assert(kMsPerTick * 1000U == kTickUs, "a tick is a whole number of milliseconds");

/// Duration in ticks, rounded up (TIM-3).
constexpr uint16_t ticks_of_ms(uint16_t duration_ms) {
  return static_cast<uint16_t>(duration_ms / kMsPerTick + (duration_ms % kMsPerTick != 0));
}

constexpr uint16_t ticks_of_s(uint8_t duration_s) {
  return static_cast<uint16_t>(duration_s * (1000 / kMsPerTick));
}

/// Expires N ticks after the tick in or before which it was started with N (TIM-3).
class Countdown {
 public:
  explicit Countdown(uint16_t ticks) : left_(ticks) {}

  void start(uint16_t ticks) { left_ = ticks; }
  bool has_run_out() const { return left_ == 0; }

  /// Call at the end of each tick.
  void count() {
    if (left_ > 0) {
      --left_;
    }
  }

 private:
  uint16_t left_;
};

}  // namespace ccr

#endif
