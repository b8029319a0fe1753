// The hardware watchdog (120 ms, six ticks) is fed once both tick and receiver made progress.
#ifndef CCR_AVR_WATCHDOG_H
#define CCR_AVR_WATCHDOG_H

namespace avr {

class ProgressWatchdog {
 public:
  void note_tick() { has_ticked_ = true; }
  void note_receiver() { has_received_ = true; }
  void feed_if_both_progressed();

 private:
  bool has_ticked_ = false;
  bool has_received_ = false;
};

}  // namespace avr

#endif
