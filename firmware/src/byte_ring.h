// A ring of bytes between an interrupt and the main loop, one on each side.
#ifndef CCR_UNO_BYTE_RING_H
#define CCR_UNO_BYTE_RING_H

#include <stdint.h>

namespace uno {

/// Holds one byte less than its size. An index is one byte, which an AVR accesses atomically, so no
/// locking is needed.
template <uint16_t kSize>
class ByteRing {
 public:
  bool is_empty() const { return head_ == tail_; }
  bool push(uint8_t byte) {
    const uint8_t next = after(head_);
    if (next == tail_) {
      return false;
    }
    bytes_[head_] = byte;
    head_ = next;
    return true;
  }

  uint8_t free() const { return static_cast<uint8_t>(tail_ - head_ - 1) & kMask; }
  /// Adds bytes; call only if there is room for them.
  void push_all(const uint8_t* bytes, uint8_t count) {
    uint8_t head = head_;
    for (uint8_t at = 0; at < count; ++at) {
      bytes_[head] = bytes[at];
      head = after(head);
    }
    head_ = head;
  }

  /// Removes the oldest byte; call only if the ring is not empty.
  uint8_t pop() {
    const uint8_t byte = bytes_[tail_];
    tail_ = after(tail_);
    return byte;
  }

 private:
  static_assert(kSize >= 2 && kSize <= 256 && (kSize & (kSize - 1)) == 0, "index is a masked byte");
  static constexpr uint8_t kMask = static_cast<uint8_t>(kSize - 1);

  static uint8_t after(uint8_t index) { return static_cast<uint8_t>(index + 1) & kMask; }

  volatile uint8_t head_ = 0;
  volatile uint8_t tail_ = 0;
  volatile uint8_t bytes_[kSize] = {};
};

}  // namespace uno

#endif
