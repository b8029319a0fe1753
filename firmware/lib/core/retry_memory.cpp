#include "retry_memory.h"

namespace ccr {

bool RetryMemory::holds(const FrameDecoder& request) const {
  if (!is_set_ || request.id() != id_ || request.sequence() != sequence_ ||
      request.payload_size() != size_) {
    return false;
  }
  for (uint8_t at = 0; at < size_; ++at) {
    if (request.payload()[at] != payload_[at]) {
      return false;
    }
  }
  return true;
}

void RetryMemory::remember(const FrameDecoder& request, State state_after) {
  is_set_ = true;
  is_void_ = false;
  age_ticks_ = 0;
  state_after_ = state_after;
  id_ = request.id();
  sequence_ = request.sequence();
  size_ = request.payload_size();
  for (uint8_t at = 0; at < size_; ++at) {
    payload_[at] = request.payload()[at];
  }
}

void RetryMemory::count() {
  if (age_ticks_ == kRetryWindowTicks) {
    is_set_ = false;
  } else {
    ++age_ticks_;
  }
}

}  // namespace ccr
