// Angles of the servo axes.
#ifndef CCR_AXES_H
#define CCR_AXES_H

#include <stdint.h>

namespace ccr {

constexpr int16_t clamped(int16_t value, int16_t least, int16_t greatest) {
  return value < least ? least : value > greatest ? greatest : value;
}

}  // namespace ccr

#endif
