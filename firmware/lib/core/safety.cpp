#include "safety.h"

#include "axes.h"

namespace ccr {

namespace {

constexpr uint16_t kPulsingStates = state_bit(State::kArming) | state_bit(State::kActive) |
                                    state_bit(State::kHold) | state_bit(State::kRelaxing) |
                                    state_bit(State::kDisarming);

constexpr Fault fault_of(Start start) {
  return start.cause == ResetCause::kWatchdog   ? Fault::kWatchdogReset
         : start.cause == ResetCause::kBrownOut ? Fault::kBrownOutReset
         : start.cause == ResetCause::kUnknown && start.had_pulses ? Fault::kResetWhileArmed
                                                                   : Fault::kNone;
}

}  // namespace

Safety::Safety(Start start) : fault_after_boot_(fault_of(start)), countdown_(kBootTicks) {}

void Safety::arm(const Watchdog& watchdog) {
  apply(Event::kArmRequested);
  enabled_axes_ = 1;
  countdown_.start(ticks_of_ms(watchdog.arm_axis_ms));
}

void Safety::disarm() { apply(Event::kDisarmRequested); }

void Safety::stop() { apply(Event::kStopRequested); }

void Safety::clear() {
  apply(Event::kClearRequested);
  fault_ = Fault::kNone;
}

void Safety::accept_target(uint16_t validity_ms) {
  apply(Event::kTargetAccepted);
  countdown_.start(ticks_of_ms(validity_ms));
}

void Safety::raise(Fault fault) {
  if (fault_ == Fault::kNone) {
    fault_ = fault;
  }
  apply(Event::kFaultRaised);
}

void Safety::tick(bool is_at_rest, const Watchdog& watchdog) {
  if (!is_state(static_cast<uint8_t>(state_))) {
    state_ = State::kBoot;  // A state for which the table has a fault transition.
    raise(Fault::kInternal);
  }
  make_due_transition(is_at_rest, watchdog);
  if (state_ == State::kArming) {
    advance_arming(watchdog);
  }
  leads_to_rest_ = state_ == State::kRelaxing || state_ == State::kDisarming ||
                   (state_ == State::kArming && countdown_.has_run_out());
  countdown_.count();
}

bool Safety::has_pulses() const { return (state_bit(state_) & kPulsingStates) != 0; }

bool Safety::allows_pulses(uint8_t axis) const { return has_pulses() && axis < enabled_axes_; }

void Safety::advance_arming(const Watchdog& watchdog) {
  if (countdown_.has_run_out() && enabled_axes_ < kAxes) {
    ++enabled_axes_;
    countdown_.start(ticks_of_ms(watchdog.arm_axis_ms));
  }
}

void Safety::make_due_transition(bool is_at_rest, const Watchdog& watchdog) {
  const bool is_due = countdown_.has_run_out();
  switch (state_) {
    case State::kBoot:
      if (is_due) {
        leave_boot();
      }
      break;
    case State::kArming:
      if (is_due && is_at_rest && enabled_axes_ == kAxes) {
        apply(Event::kAxesEnabled);
        countdown_.start(ticks_of_ms(watchdog.relax_after_ms));
      }
      break;
    case State::kActive:
      if (is_due) {
        apply(Event::kTargetExpired);
        countdown_.start(ticks_of_ms(watchdog.relax_after_ms));
      }
      break;
    case State::kHold:
      if (is_due) {
        apply(Event::kHoldExpired);
      }
      break;
    case State::kRelaxing:
      if (is_at_rest) {
        apply(Event::kRestReached);
        fault_ = Fault::kLinkLoss;
      }
      break;
    case State::kDisarming:
      if (is_at_rest) {
        apply(Event::kRestReached);
      }
      break;
    case State::kDisarmed:
    case State::kFault:
    case State::kStopped:
      break;
  }
}

void Safety::leave_boot() {
  if (fault_after_boot_ == Fault::kNone) {
    apply(Event::kSelfTestPassed);
  } else {
    raise(fault_after_boot_);
  }
}

// Only this file uses the table: every other one would have its own copy in RAM.
void Safety::apply(Event event) { state_ = next_state(state_, event); }

}  // namespace ccr
