// Reported properties of the last accepted target, apart from its angles.
#ifndef CCR_TARGET_RECORD_H
#define CCR_TARGET_RECORD_H

#include <stdint.h>

#include "ticks.h"

namespace ccr {

class TargetRecord {
 public:
  void accept(uint8_t sequence, bool was_clamped) {
    sequence_ = sequence;
    was_clamped_ = was_clamped;
    age_ms_ = 0;
  }

  uint8_t sequence() const { return sequence_; }
  bool was_clamped() const { return was_clamped_; }
  /// 65535 before the first target, and when it is older than that.
  uint16_t age_ms() const { return age_ms_; }

  /// Call in each tick.
  void count() {
    age_ms_ = age_ms_ > kOldest - kMsPerTick ? kOldest : static_cast<uint16_t>(age_ms_ + kMsPerTick);
  }

 private:
  static constexpr uint16_t kOldest = 0xFFFF;

  uint16_t age_ms_ = kOldest;
  uint8_t sequence_ = 0;
  bool was_clamped_ = false;
};

}  // namespace ccr

#endif
