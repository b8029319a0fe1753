#include "controller.h"

namespace ccr {

namespace {

/// LED pattern (LED-1): step n is bit n.
constexpr uint8_t led_steps(State state) {
  switch (state) {
    case State::kBoot:
    case State::kActive:
      return 0xFF;
    case State::kHold:
      return 0x7F;
    case State::kArming:
      return 0x55;
    case State::kRelaxing:
    case State::kDisarming:
      return 0x33;
    case State::kDisarmed:
      return 0x01;
    case State::kStopped:
      return 0x05;
    case State::kFault:
      return 0x15;
  }
  return 0;
}

}  // namespace

Controller::Controller(Hardware& hardware, Start start, uint32_t first_tick)
    : hardware_(hardware),
      store_(hardware),
      configuration_(empty_configuration()),
      eeprom_status_(store_.load(configuration_)),
      boot_id_(store_.count_boot()),
      fault_log_(hardware),
      ticks_(first_tick),
      safety_(start) {
  for (uint8_t axis = 0; axis < kAxes; ++axis) {
    setpoints_[axis] = Setpoint(configuration_.limits.rest_cdeg[axis]);
    reported_setpoint_cdeg_[axis] = setpoints_[axis].cdeg();
  }
}

Pulses Controller::tick() {
  take_waiting_target();
  ++ticks_;
  target_.count();
  make_transition();
  watch_emergency_stop();
  watch_supply();
  move_setpoints();
  compute_pulses();
  write_eeprom();
  log_fault();
  hardware_.set_servo_supply(safety_.has_pulses());
  show_state();
  return pulses_;
}

void Controller::clear_fault() {
  safety_.clear();
  logged_fault_ = Fault::kNone;
}

void Controller::accept_target(const SetTarget& target, uint8_t sequence) {
  const Limits& limits = configuration_.limits;
  const uint16_t ramp_ticks = ticks_of_ms(target.ramp_ms);
  bool was_clamped = false;
  for (uint8_t axis = 0; axis < kAxes; ++axis) {
    const int16_t accepted = clamped(target.target_cdeg[axis], limits.angle_min_cdeg[axis],
                                     limits.angle_max_cdeg[axis]);
    was_clamped = was_clamped || accepted != target.target_cdeg[axis] ||
                  is_saturated(configuration_.calibration, axis, accepted);
    setpoints_[axis].aim_at(accepted, ramp_ticks);
  }
  discard_waiting_target();
  target_.accept(sequence, was_clamped);
  safety_.accept_target(target.validity_ms);
  ++counts_.targets_accepted;
  if (was_clamped) {
    ++counts_.targets_clamped;
  }
}

void Controller::await_tick(uint32_t tick, const SetTarget& target, uint8_t sequence) {
  waiting_target_ = target;
  waiting_for_tick_ = tick;
  waiting_sequence_ = sequence;
  has_waiting_target_ = true;
}

void Controller::take_waiting_target() {
  if (!has_waiting_target_) {
    return;
  }
  constexpr RequestRule rule = *find_request(SetTarget::kId);
  if (!is_allowed(rule, safety_.state())) {
    discard_waiting_target();
  } else if (waiting_for_tick_ == ticks_ + 1) {
    accept_target(waiting_target_, waiting_sequence_);
  }
}

void Controller::set(const Limits& limits) {
  configuration_.limits = limits;
  for (uint8_t axis = 0; axis < kAxes; ++axis) {
    setpoints_[axis].clamp(limits.angle_min_cdeg[axis], limits.angle_max_cdeg[axis]);
  }
  note_change(config_groups::kLimits);
}

void Controller::set(const Slew& slew) {
  configuration_.slew = slew;
  note_change(config_groups::kSlew);
}

void Controller::set(const Watchdog& watchdog) {
  configuration_.watchdog = watchdog;
  note_change(config_groups::kWatchdog);
}

void Controller::set(const Calibration& calibration) {
  configuration_.calibration = calibration;
  note_change(config_groups::kCalibration);
}

void Controller::set(const Equipment& equipment) {
  configuration_.equipment = equipment;
  note_change(config_groups::kEquipment);
}

void Controller::set(const Acceleration& acceleration) {
  configuration_.acceleration = acceleration;
  note_change(0);
}

bool Controller::is_emergency_stop_open() const {
  return configuration_.equipment.emergency_stop != 0 && hardware_.is_emergency_stop_open();
}

uint8_t Controller::flags() const {
  uint8_t flags = 0;
  const auto add = [&flags](bool is_set, uint8_t flag) {
    flags = static_cast<uint8_t>(flags | (is_set ? flag : 0));
  };
  add(pulses_.half_us[0] != kNoPulse, status_flags::kAxis1Pulses);
  add(kAxes > 1 && pulses_.half_us[kAxes > 1 ? 1 : 0] != kNoPulse, status_flags::kAxis2Pulses);
  add(is_moving_, status_flags::kMoving);
  add(target_.was_clamped(), status_flags::kClamped);
  add(store_.is_saving(), status_flags::kEepromBusy);
  add(configuration_.is_complete(), status_flags::kConfigured);
  add(is_unsaved_, status_flags::kUnsaved);
  return flags;
}

void Controller::fill(StateReport& report) const {
  report.tick = ticks_;
  report.state = safety_.state();
  report.fault = safety_.fault();
  report.flags = flags();
  report.target_sequence = target_.sequence();
  report.target_age_ms = target_.age_ms();
  report.supply_dv = supply_dv_;
  for (uint8_t axis = 0; axis < kAxes; ++axis) {
    report.target_cdeg[axis] = target_cdeg(axis);
    report.setpoint_cdeg[axis] = reported_setpoint_cdeg_[axis];
    report.pulse_half_us[axis] = pulses_.half_us[axis];
  }
}

void Controller::make_transition() {
  const State before = safety_.state();
  safety_.tick(is_at_rest(), configuration_.watchdog);
  const State after = safety_.state();
  if (before == State::kActive && after == State::kHold) {
    ++counts_.holds;
  }
  if (before != State::kRelaxing && after == State::kRelaxing) {
    ++counts_.relaxes;
  }
}

void Controller::watch_emergency_stop() {
  if (safety_.state() != State::kBoot && is_emergency_stop_open()) {
    safety_.raise(Fault::kEmergencyStop);
  }
}

void Controller::watch_supply() {
  constexpr uint16_t kFull = 255;
  const Equipment& equipment = configuration_.equipment;
  const uint16_t product =
      static_cast<uint16_t>(hardware_.supply_reading() * uint16_t{equipment.supply_full_dv});
  supply_dv_ = static_cast<uint8_t>((product + kFull / 2) / kFull);
  const bool is_wired = equipment.supply_full_dv != 0;
  if (!is_wired || supply_dv_ >= equipment.supply_min_dv || !safety_.has_pulses()) {
    ticks_of_sag_ = 0;
    return;
  }
  if (++ticks_of_sag_ >= kSagTicks) {
    safety_.raise(Fault::kSupplyLow);
  }
}

void Controller::move_setpoints() {
  is_moving_ = false;
  for (uint8_t axis = 0; axis < kAxes; ++axis) {
    Setpoint& setpoint = setpoints_[axis];
    const uint16_t acceleration = configuration_.acceleration.acceleration_cdeg_tick2[axis];
    if (safety_.state() == State::kActive) {
      setpoint.follow_ramp(configuration_.slew.slew_cdeg_tick[axis], acceleration);
      is_moving_ = is_moving_ || setpoint.cdeg() != setpoint.target_cdeg();
    } else if (safety_.leads_to_rest()) {
      lead_to_rest(axis);
    } else {
      setpoint.brake(safety_.has_pulses() ? acceleration : uint16_t{0});
      is_moving_ = is_moving_ || setpoint.is_moving();
    }
    reported_setpoint_cdeg_[axis] = setpoint.cdeg();
  }
}

void Controller::lead_to_rest(uint8_t axis) {
  const uint16_t slew = configuration_.slew.slew_cdeg_tick[axis];
  const uint16_t relax_slew = configuration_.watchdog.relax_slew_cdeg_tick;
  const int16_t rest_cdeg = configuration_.limits.rest_cdeg[axis];
  setpoints_[axis].step_towards(rest_cdeg, slew < relax_slew ? slew : relax_slew,
                                configuration_.acceleration.acceleration_cdeg_tick2[axis]);
  is_moving_ = is_moving_ || setpoints_[axis].cdeg() != rest_cdeg;
}

void Controller::compute_pulses() {
  const Calibration& calibration = configuration_.calibration;
  pulses_ = Pulses{};
  for (uint8_t axis = 0; axis < kAxes; ++axis) {
    if (!safety_.allows_pulses(axis)) {
      continue;
    }
    const uint16_t pulse = pulse_half_us(calibration, axis, setpoints_[axis].cdeg());
    if (!is_allowed_pulse(calibration, axis, pulse)) {
      safety_.raise(Fault::kInternal);
      pulses_ = Pulses{};
      return;
    }
    pulses_.half_us[axis] = pulse;
  }
}

void Controller::write_eeprom() {
  switch (store_.continue_save(configuration_)) {
    case ConfigStore::Step::kNothing:
      break;
    case ConfigStore::Step::kFinished:
      is_unsaved_ = false;
      ++counts_.saves;
      break;
    case ConfigStore::Step::kFailed:
      safety_.raise(Fault::kEepromFailed);
      break;
  }
}

void Controller::log_fault() {
  const Fault fault = safety_.fault();
  if (fault != logged_fault_ && !fault_log_.is_writing()) {
    logged_fault_ = fault;
    fault_log_.begin(FaultRecord{0, static_cast<uint8_t>(fault),
                                 static_cast<uint8_t>(state_before_), boot_id_, ticks_, 0});
  }
  if (!store_.is_saving()) {
    fault_log_.continue_writing();
  }
  state_before_ = safety_.state();
}

void Controller::show_state() {
  const uint8_t tick = static_cast<uint8_t>(ticks_);
  const bool is_on = blinking_.has_run_out()
                         ? ((led_steps(safety_.state()) >> (tick / kLedStepTicks % 8)) & 1) != 0
                         : tick / kBlinkStepTicks % 2 == 0;
  hardware_.set_led(is_on);
  blinking_.count();
}

bool Controller::is_at_rest() const {
  for (uint8_t axis = 0; axis < kAxes; ++axis) {
    if (setpoints_[axis].cdeg() != configuration_.limits.rest_cdeg[axis] ||
        setpoints_[axis].is_moving()) {
      return false;
    }
  }
  return true;
}

void Controller::note_change(uint8_t group) {
  configuration_.missing_groups = static_cast<uint8_t>(configuration_.missing_groups & ~group);
  is_unsaved_ = true;
}

}  // namespace ccr
