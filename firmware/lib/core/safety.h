// The safety state machine: the generated transition table and the events that drive it.
#ifndef CCR_SAFETY_H
#define CCR_SAFETY_H

#include <stdint.h>

#include "ccr_messages.h"
#include "ticks.h"

namespace ccr {

/// Circumstances of the last reset.
struct Start {
  ResetCause cause;
  /// Whether there were pulses when the reset came.
  bool had_pulses;
};

class Safety {
 public:
  explicit Safety(Start start);

  State state() const { return state_; }
  /// The first fault since the last clear.
  Fault fault() const { return fault_; }

  /// Requests; the caller has checked that they are allowed in this state.
  void arm(const Watchdog& watchdog);
  void disarm();
  void stop();
  void clear();
  void accept_target(uint16_t validity_ms);

  void raise(Fault fault);

  /// The part of a control tick before the setpoint moves (TIM-4).
  void tick(bool is_at_rest, const Watchdog& watchdog);

  /// Whether the state moves the setpoint to rest, as of the last tick and without a later fault.
  bool leads_to_rest() const { return leads_to_rest_ && has_pulses(); }
  bool allows_pulses(uint8_t axis) const;
  /// Whether the state has pulses.
  bool has_pulses() const;

 private:
  void advance_arming(const Watchdog& watchdog);
  void make_due_transition(bool is_at_rest, const Watchdog& watchdog);
  void leave_boot();
  void apply(Event event);

  State state_ = State::kBoot;
  Fault fault_ = Fault::kNone;
  Fault fault_after_boot_;
  /// Time left of boot, the stage of arming, the validity of the target, or hold.
  Countdown countdown_;
  /// Number of axes enabled since the last arming.
  uint8_t enabled_axes_ = 0;
  bool leads_to_rest_ = false;
};

}  // namespace ccr

#endif
