#include "setpoint.h"

#include "axes.h"

namespace ccr {

namespace {

/// Longest step from which steps that each shrink by the acceleration stop within `way`: m full
/// ones and a remainder. At most 233 iterations, for 270 deg and the smallest acceleration.
int16_t longest_step(uint16_t way, uint16_t acceleration) {
  uint16_t sum = 0;
  uint16_t full = acceleration;
  uint8_t terms = 1;
  while (full <= static_cast<uint16_t>(way - sum)) {
    sum = static_cast<uint16_t>(sum + full);
    full = static_cast<uint16_t>(full + acceleration);
    ++terms;
  }
  return static_cast<int16_t>(static_cast<uint16_t>(way + sum) / terms);
}

}  // namespace

void Setpoint::aim_at(int16_t target_cdeg, uint16_t ramp_ticks) {
  start_cdeg_ = cdeg_;
  target_cdeg_ = target_cdeg;
  ramp_ticks_ = ramp_ticks;
  ticks_on_ramp_ = 0;
}

void Setpoint::follow_ramp(uint16_t slew_cdeg, uint16_t acceleration_cdeg) {
  step_towards(next_on_ramp(), slew_cdeg, acceleration_cdeg);
}

void Setpoint::step_towards(int16_t goal_cdeg, uint16_t slew_cdeg, uint16_t acceleration_cdeg) {
  const int16_t slew = static_cast<int16_t>(slew_cdeg);
  const int16_t way = static_cast<int16_t>(goal_cdeg - cdeg_);
  if (acceleration_cdeg == 0) {
    cdeg_ = static_cast<int16_t>(cdeg_ + clamped(way, static_cast<int16_t>(-slew), slew));
    return;
  }
  const bool is_back = way < 0;
  const int16_t before = static_cast<int16_t>(is_back ? -step_cdeg_ : step_cdeg_);
  int16_t step = longest_step(static_cast<uint16_t>(is_back ? -way : way), acceleration_cdeg);
  step = step < slew ? step : slew;
  step = clamped(step, static_cast<int16_t>(before - static_cast<int16_t>(acceleration_cdeg)),
                 static_cast<int16_t>(before + static_cast<int16_t>(acceleration_cdeg)));
  step_cdeg_ = static_cast<int16_t>(is_back ? -step : step);
  cdeg_ = static_cast<int16_t>(cdeg_ + step_cdeg_);
}

void Setpoint::brake(uint16_t acceleration_cdeg) {
  const int16_t most = static_cast<int16_t>(acceleration_cdeg);
  step_cdeg_ = most == 0 ? int16_t{0}
                         : static_cast<int16_t>(step_cdeg_ - clamped(step_cdeg_,
                                                                     static_cast<int16_t>(-most),
                                                                     most));
  cdeg_ = static_cast<int16_t>(cdeg_ + step_cdeg_);
}

void Setpoint::clamp(int16_t least_cdeg, int16_t greatest_cdeg) {
  cdeg_ = clamped(cdeg_, least_cdeg, greatest_cdeg);
}

int16_t Setpoint::next_on_ramp() {
  if (ticks_on_ramp_ < ramp_ticks_) {
    ++ticks_on_ramp_;
  }
  if (ticks_on_ramp_ == ramp_ticks_) {
    return target_cdeg_;
  }
  const int32_t way = static_cast<int32_t>(target_cdeg_) - start_cdeg_;
  return static_cast<int16_t>(start_cdeg_ + way * ticks_on_ramp_ / ramp_ticks_);
}

}  // namespace ccr
