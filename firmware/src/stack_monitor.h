// Measures how much of the stack was never used, by the paint that is left.
#ifndef CCR_AVR_STACK_MONITOR_H
#define CCR_AVR_STACK_MONITOR_H

#include <stdint.h>

namespace avr {

class StackMonitor {
 public:
  /// Paints the memory between the variables and the stack.
  StackMonitor();

  /// Scans the next few bytes; a complete scan takes a second at one call per tick.
  void look_further();
  uint16_t least_free() const;

 private:
  const uint8_t* lowest_used_;
  const uint8_t* next_;
};

}  // namespace avr

#endif
