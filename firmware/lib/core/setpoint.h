// Commanded angle of one axis: where the ramp, the slew limit and the acceleration limit stand.
#ifndef CCR_SETPOINT_H
#define CCR_SETPOINT_H

#include <stdint.h>

namespace ccr {

/// Moves only in control ticks. Angles in 0.01 deg.
class Setpoint {
 public:
  explicit Setpoint(int16_t cdeg) : cdeg_(cdeg) {}

  int16_t cdeg() const { return cdeg_; }
  /// The last one aimed at; 0 before the first.
  int16_t target_cdeg() const { return target_cdeg_; }

  /// From here to a target in a straight line over so many ticks (TGT-2).
  void aim_at(int16_t target_cdeg, uint16_t ramp_ticks);
  /// One tick along that line, at most by the slew (TGT-3). An acceleration of 0 is any.
  void follow_ramp(uint16_t slew_cdeg, uint16_t acceleration_cdeg);
  /// One tick straight to an angle, at most by the slew (ACC-2).
  void step_towards(int16_t goal_cdeg, uint16_t slew_cdeg, uint16_t acceleration_cdeg);
  /// One tick of coming to a stand (ACC-1).
  void brake(uint16_t acceleration_cdeg);
  /// Did the last tick move it, with an acceleration limit?
  bool is_moving() const { return step_cdeg_ != 0; }
  void clamp(int16_t least_cdeg, int16_t greatest_cdeg);

 private:
  int16_t next_on_ramp();

  int16_t cdeg_;
  /// Of the last tick; 0 without an acceleration limit.
  int16_t step_cdeg_ = 0;
  int16_t start_cdeg_ = 0;
  int16_t target_cdeg_ = 0;
  uint16_t ramp_ticks_ = 0;
  uint16_t ticks_on_ramp_ = 0;
};

}  // namespace ccr

#endif
