// Commanded angle of one axis: where the ramp and the slew limit stand.
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
  /// One tick along that line, at most by the slew (TGT-3).
  void follow_ramp(uint16_t slew_cdeg);
  /// One tick straight to an angle, at most by the slew.
  void step_towards(int16_t goal_cdeg, uint16_t slew_cdeg);
  void clamp(int16_t least_cdeg, int16_t greatest_cdeg);

 private:
  int16_t next_on_ramp();

  int16_t cdeg_;
  int16_t start_cdeg_ = 0;
  int16_t target_cdeg_ = 0;
  uint16_t ramp_ticks_ = 0;
  uint16_t ticks_on_ramp_ = 0;
};

}  // namespace ccr

#endif
