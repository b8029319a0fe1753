// Behaviour of the board in a control tick and on a request, without any bytes.
#ifndef CCR_CONTROLLER_H
#define CCR_CONTROLLER_H

#include <stdint.h>

#include "axes.h"
#include "ccr_messages.h"
#include "config_store.h"
#include "configuration.h"
#include "fault_log.h"
#include "hardware.h"
#include "pulses.h"
#include "safety.h"
#include "setpoint.h"
#include "target_record.h"
#include "ticks.h"

namespace ccr {

class Controller {
 public:
  /// Loads the configuration and counts the boot.
  Controller(Hardware& hardware, Start start, uint32_t first_tick);

  /// Runs one control tick without its report (TIM-4).
  Pulses tick();

  /// Requests that have passed all checks.
  void arm() { safety_.arm(configuration_.watchdog); }
  void disarm() { safety_.disarm(); }
  void stop() { safety_.stop(); }
  void clear_fault();
  void accept_target(const SetTarget& target, uint8_t sequence);
  /// Keeps a target until its tick (TGT-5).
  void await_tick(uint32_t tick, const SetTarget& target, uint8_t sequence);
  void discard_waiting_target() { has_waiting_target_ = false; }
  void set(const Limits& limits);
  void set(const Slew& slew);
  void set(const Watchdog& watchdog);
  void set(const Calibration& calibration);
  void set(const Equipment& equipment);
  void set(const Acceleration& acceleration);
  void blink(uint8_t duration_s) { blinking_.start(ticks_of_s(duration_s)); }
  void begin_save() { store_.begin_save(); }

  void raise_fault(Fault fault) { safety_.raise(fault); }

  const Configuration& configuration() const { return configuration_; }
  /// As of the last tick.
  bool has_pulses() const { return !pulses_.are_none(); }
  /// Always false if none is fitted.
  bool is_emergency_stop_open() const;
  FaultRecord fault_record(uint8_t place) const { return fault_log_.at(place); }
  /// Whether a tick, numbered as in reports, is still to come.
  bool is_ahead(uint32_t tick) const { return static_cast<int32_t>(tick - ticks_) > 0; }
  bool is_saving() const { return store_.is_saving(); }
  State state() const { return safety_.state(); }
  uint16_t boot_id() const { return boot_id_; }
  EepromStatus eeprom_status() const { return eeprom_status_; }
  int16_t target_cdeg(uint8_t axis) const { return setpoints_[axis].target_cdeg(); }

  /// `status_flags` without that of the session.
  uint8_t flags() const;
  /// Fills in everything except the link's fields.
  void fill(StateReport& report) const;

  /// The counters that are counted here; they wrap.
  struct Counts {
    uint32_t targets_accepted;
    uint16_t targets_clamped;
    uint16_t holds;
    uint16_t relaxes;
    uint16_t saves;
  };
  const Counts& counts() const { return counts_; }

 private:
  void take_waiting_target();
  void make_transition();
  void watch_emergency_stop();
  void watch_supply();
  void move_setpoints();
  void lead_to_rest(uint8_t axis);
  void compute_pulses();
  void write_eeprom();
  void log_fault();
  void show_state();
  bool is_at_rest() const;
  void note_change(uint8_t group);

  Hardware& hardware_;
  ConfigStore store_;
  Configuration configuration_;
  EepromStatus eeprom_status_;
  uint16_t boot_id_;
  FaultLog fault_log_;
  uint32_t ticks_;
  Safety safety_;
  Setpoint setpoints_[kAxes];
  TargetRecord target_;
  SetTarget waiting_target_;
  uint32_t waiting_for_tick_;
  uint8_t waiting_sequence_;
  bool has_waiting_target_ = false;
  Counts counts_ = {};
  Countdown blinking_{0};
  /// State after the last tick.
  State state_before_ = State::kBoot;
  Fault logged_fault_ = Fault::kNone;
  /// Supply voltage in the last tick.
  uint8_t supply_dv_ = 0;
  uint8_t ticks_of_sag_ = 0;
  /// As of the last tick.
  int16_t reported_setpoint_cdeg_[kAxes];
  Pulses pulses_ = {};
  bool is_moving_ = false;
  bool is_unsaved_ = false;
};

}  // namespace ccr

#endif
