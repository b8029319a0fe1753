#include "setpoint.h"

#include "axes.h"

namespace ccr {

void Setpoint::aim_at(int16_t target_cdeg, uint16_t ramp_ticks) {
  start_cdeg_ = cdeg_;
  target_cdeg_ = target_cdeg;
  ramp_ticks_ = ramp_ticks;
  ticks_on_ramp_ = 0;
}

void Setpoint::follow_ramp(uint16_t slew_cdeg) { step_towards(next_on_ramp(), slew_cdeg); }

void Setpoint::step_towards(int16_t goal_cdeg, uint16_t slew_cdeg) {
  const int16_t slew = static_cast<int16_t>(slew_cdeg);
  const int16_t way = static_cast<int16_t>(goal_cdeg - cdeg_);
  cdeg_ = static_cast<int16_t>(cdeg_ + clamped(way, static_cast<int16_t>(-slew), slew));
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
