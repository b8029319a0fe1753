// Commanded angle of one axis, with ramp, slew limit and acceleration limit.
#ifndef CCR_SETPOINT_H
#define CCR_SETPOINT_H

#include <stdint.h>

namespace ccr {

/// Changes only in control ticks. Angles in 0.01 deg.
class Setpoint {
 public:
  explicit Setpoint(int16_t cdeg = 0) : cdeg_(cdeg) {}
  int16_t cdeg() const { return cdeg_; }
  /// The last target; 0 before the first.
  int16_t target_cdeg() const { return target_cdeg_; }

  /// Starts a linear ramp from here to a target over `ramp_ticks` (TGT-2).
  void aim_at(int16_t target_cdeg, uint16_t ramp_ticks);
  /// Moves one tick along the ramp, within the slew (TGT-3). Acceleration 0 is unlimited.
  void follow_ramp(uint16_t slew_cdeg, uint16_t acceleration_cdeg);
  /// Moves one tick towards an angle, within the slew (ACC-2).
  void step_towards(int16_t goal_cdeg, uint16_t slew_cdeg, uint16_t acceleration_cdeg);
  /// Decelerates for one tick (ACC-1).
  void brake(uint16_t acceleration_cdeg);
  /// Whether the last tick moved it, with an acceleration limit.
  bool is_moving() const { return step_cdeg_ != 0; }
  void clamp(int16_t least_cdeg, int16_t greatest_cdeg);

 private:
  int16_t next_on_ramp();

  int16_t cdeg_;
  /// Step of the last tick; 0 without an acceleration limit.
  int16_t step_cdeg_ = 0;
  int16_t start_cdeg_ = 0;
  int16_t target_cdeg_ = 0;
  uint16_t ramp_ticks_ = 0;
  uint16_t ticks_on_ramp_ = 0;
};

}  // namespace ccr

#endif
