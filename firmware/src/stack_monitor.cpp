#include "stack_monitor.h"

#include <avr/io.h>

/// End of the variables, from the linker: the stack grows down to it.
extern uint8_t _end;

namespace uno {

namespace {

constexpr uint8_t kBytesPerLook = 32;

const uint8_t* bottom() { return &_end; }

const uint8_t* first_used(const uint8_t* from, const uint8_t* to) {
  while (from < to && *from == kStackPaint) {
    ++from;
  }
  return from;
}

}  // namespace

StackMonitor::StackMonitor()
    : lowest_used_(first_used(bottom(), reinterpret_cast<const uint8_t*>(SP))), next_(bottom()) {}

// From the bottom, because variables that are never written leave gaps of paint higher up.
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

}  // namespace uno
