// The last `once` request that was acknowledged, so that a repeated one is not executed again.
#ifndef CCR_RETRY_MEMORY_H
#define CCR_RETRY_MEMORY_H

#include <stdint.h>

#include "ccr_messages.h"
#include "frame.h"

namespace ccr {

/// Longest payload of a `once` request; 0 if one is answered by anything other than `ack`.
constexpr uint8_t longest_acknowledged_once() {
  uint8_t longest = 0;
  for (const RequestRule& rule : kRequestRules) {
    if (rule.retry == Retry::kOnce) {
      if (rule.reply_id != Ack::kId) {
        return 0;
      }
      longest = rule.size > longest ? rule.size : longest;
    }
  }
  return longest;
}

class RetryMemory {
 public:
  /// Whether this is the remembered request, within the retry window (REQ-3).
  bool holds(const FrameDecoder& request) const;
  /// Its answer.
  Ack answer() const { return Ack{id_, state_after_}; }

  void remember(const FrameDecoder& request, State state_after);
  void forget() { is_set_ = false; }
  /// Call after a stop: the request before it is neither executed nor acknowledged again.
  void make_void() { is_void_ = true; }
  bool is_void() const { return is_void_; }
  /// Call at the end of each tick.
  void count();

 private:
  static constexpr uint8_t kMaxSize = longest_acknowledged_once();
  static_assert(kMaxSize > 0, "every once request is answered by ack, whose state is stored");

  bool is_set_ = false;
  bool is_void_ = false;
  uint8_t age_ticks_ = 0;
  State state_after_ = State::kBoot;
  uint8_t id_ = 0;
  uint8_t sequence_ = 0;
  uint8_t size_ = 0;
  uint8_t payload_[kMaxSize] = {};
};

}  // namespace ccr

#endif
