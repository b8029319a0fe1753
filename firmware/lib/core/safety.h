// The safety state machine: the generated table of transitions and what brings them about.
#ifndef CCR_SAFETY_H
#define CCR_SAFETY_H

#include <stdint.h>

#include "ccr_messages.h"
#include "ticks.h"

namespace ccr {

/// How the board came to start.
struct Start {
  ResetCause cause;
  /// Did it make pulses when the reset came?
  bool had_pulses;
};

class Safety {
 public:
  explicit Safety(Start start);

  State state() const { return state_; }
  /// The first one since the last clear.
  Fault fault() const { return fault_; }

  /// Requests; whether they are allowed in this state is checked before.
  void arm(const Watchdog& watchdog);
  void disarm();
  void stop();
  void clear();
  void accept_target(uint16_t validity_ms);

  void raise(Fault fault);

  /// The part of a control tick before the setpoint moves (TIM-4).
  void tick(bool is_at_rest, const Watchdog& watchdog);

  /// As of the last tick, and unless a fault has come since: does the state lead the setpoint to rest?
  bool leads_to_rest() const { return leads_to_rest_ && has_pulses(); }
  bool allows_pulses(uint8_t axis) const;
  /// Is this a state with pulses?
  bool has_pulses() const;

 private:
  void advance_arming(const Watchdog& watchdog);
  void make_due_transition(bool is_at_rest, const Watchdog& watchdog);
  void leave_boot();
  void apply(Event event);

  State state_ = State::kBoot;
  Fault fault_ = Fault::kNone;
  Fault fault_after_boot_;
  /// Until boot, the stage of arming, the validity of the target, or hold is over.
  Countdown countdown_;
  /// Since the last arming.
  uint8_t enabled_axes_ = 0;
  bool leads_to_rest_ = false;
};

}  // namespace ccr

#endif
