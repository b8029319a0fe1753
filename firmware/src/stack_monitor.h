// How much of the stack was never used, told by the paint that is left.
#ifndef CCR_UNO_STACK_MONITOR_H
#define CCR_UNO_STACK_MONITOR_H

#include <stdint.h>

namespace uno {

class StackMonitor {
 public:
  /// Paints what lies between the variables and the stack.
  StackMonitor();

  /// Looks at the next few bytes; a sweep over all takes a second at one call a tick.
  void look_further();
  uint16_t least_free() const;

 private:
  const uint8_t* lowest_used_;
  const uint8_t* next_;
};

}  // namespace uno

#endif
