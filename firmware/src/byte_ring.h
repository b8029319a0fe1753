// A ring of bytes between an interrupt and the main loop, one on each side.
#ifndef CCR_AVR_BYTE_RING_H
#define CCR_AVR_BYTE_RING_H

#include <stdint.h>
#include <util/atomic.h>

namespace avr {

template <bool kIsLong>
struct RingIndex {
  using Type = uint8_t;
};
template <>
struct RingIndex<true> {
  using Type = uint16_t;
};

/// Holds one byte less than its size. An index of one byte is accessed atomically by an AVR, so no
/// locking is needed; a longer one is read and written with interrupts off.
template <uint16_t kSize>
class ByteRing {
 public:
  using Index = typename RingIndex<(kSize > 256)>::Type;

  bool is_empty() const { return value_of(head_) == value_of(tail_); }
  bool push(uint8_t byte) {
    const Index head = value_of(head_);
    const Index next = after(head);
    if (next == value_of(tail_)) {
      return false;
    }
    bytes_[head] = byte;
    set(head_, next);
    return true;
  }

  Index free() const {
    return static_cast<Index>(value_of(tail_) - value_of(head_) - 1) & kMask;
  }
  /// Adds bytes; call only if there is room for them.
  void push_all(const uint8_t* bytes, uint8_t count) {
    Index head = value_of(head_);
    for (uint8_t at = 0; at < count; ++at) {
      bytes_[head] = bytes[at];
      head = after(head);
    }
    set(head_, head);
  }

  /// Removes the oldest byte; false if there is none. Call with interrupts off if the index is long:
  /// unlocked, and without a call, it keeps the sending interrupt short.
  bool pop(uint8_t& byte) {
    const Index tail = tail_;
    if (tail == head_) {
      return false;
    }
    byte = bytes_[tail];
    tail_ = after(tail);
    return true;
  }

 private:
  static_assert(kSize >= 2 && (kSize & (kSize - 1)) == 0, "indices are masked");
  static constexpr Index kMask = static_cast<Index>(kSize - 1);

  static Index after(Index index) { return static_cast<Index>(index + 1) & kMask; }
  static Index value_of(const volatile Index& index) {
    if (sizeof(Index) == 1) {
      return index;
    }
    Index value;
    ATOMIC_BLOCK(ATOMIC_RESTORESTATE) { value = index; }
    return value;
  }
  static void set(volatile Index& index, Index value) {
    if (sizeof(Index) == 1) {
      index = value;
    } else {
      ATOMIC_BLOCK(ATOMIC_RESTORESTATE) { index = value; }
    }
  }

  volatile Index head_ = 0;
  volatile Index tail_ = 0;
  volatile uint8_t bytes_[kSize] = {};
};

}  // namespace avr

#endif
