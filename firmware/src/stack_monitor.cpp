#include "stack_monitor.h"

#include <avr/io.h>

/// End of the variables, set by the linker: the stack grows down towards it.
extern uint8_t _end;

namespace avr {

namespace {

constexpr uint8_t kStackPaint = 0xC5;
constexpr uint8_t kBytesPerLook = 32;

/// Margin below the stack pointer: more than the deepest interrupt uses while the stack is painted.
constexpr uint8_t kUnpaintedBytes = 64;

const uint8_t* bottom() { return &_end; }

const uint8_t* first_used(const uint8_t* from, const uint8_t* to) {
  while (from < to && *from == kStackPaint) {
    ++from;
  }
  return from;
}

}  // namespace

// Interrupts stay on: it takes half a millisecond.
StackMonitor::StackMonitor()
    : lowest_used_(reinterpret_cast<const uint8_t*>(SP) - kUnpaintedBytes), next_(bottom()) {
  for (uint8_t* at = &_end; at < lowest_used_; ++at) {
    *at = kStackPaint;
  }
}

// Scans from the bottom, because locals that are never written leave gaps of paint higher up.
void StackMonitor::look_further() {
  const uint8_t* const end =
      lowest_used_ - next_ > kBytesPerLook ? next_ + kBytesPerLook : lowest_used_;
  next_ = first_used(next_, end);
  if (next_ != end) {
    lowest_used_ = next_;
  }
  if (next_ == lowest_used_) {
    next_ = bottom();
  }
}

uint16_t StackMonitor::least_free() const {
  return static_cast<uint16_t>(lowest_used_ - bottom());
}

}  // namespace avr
