// The two servo axes of the board.
#ifndef CCR_AXES_H
#define CCR_AXES_H

#include <stdint.h>

#include "ccr_messages.h"

namespace ccr {

constexpr uint8_t kAxes = sizeof(SetTarget::target_cdeg) / sizeof(int16_t);

constexpr int16_t clamped(int16_t value, int16_t least, int16_t greatest) {
  return value < least ? least : value > greatest ? greatest : value;
}

}  // namespace ccr

#endif
