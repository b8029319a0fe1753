// Periodic reports, one every `period_ticks`.
#ifndef CCR_TELEMETRY_STREAM_H
#define CCR_TELEMETRY_STREAM_H

#include <stdint.h>

namespace ccr {

class TelemetryStream {
 public:
  /// 0 ends the stream.
  void start(uint8_t period_ticks) {
    period_ticks_ = period_ticks;
    ticks_left_ = period_ticks;
    next_sequence_ = 0;
  }

  void stop() { start(0); }

  /// Call once per tick; whether a report is due at this tick (TEL-1).
  bool is_due() {
    if (period_ticks_ == 0) {
      return false;
    }
    --ticks_left_;
    if (ticks_left_ > 0) {
      return false;
    }
    ticks_left_ = period_ticks_;
    return true;
  }

  /// Sequence number of the report that is due.
  uint8_t take_sequence() { return next_sequence_++; }

 private:
  uint8_t period_ticks_ = 0;
  uint8_t ticks_left_ = 0;
  uint8_t next_sequence_ = 0;
};

}  // namespace ccr

#endif
