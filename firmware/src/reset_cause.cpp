#include "reset_cause.h"

#include <avr/io.h>

#include "startup.h"

namespace uno {

namespace {

/// It bites after 120 ms; its oscillator may be a tenth fast. In good health it is fed every 20 ms.
constexpr uint8_t kStarvedMs = 80;

constexpr uint32_t kRunMark = 0x52756E21UL;

constexpr uint32_t kPulsesMark = 0x41726D64UL;

uint32_t run_mark __attribute__((section(".noinit")));
uint32_t pulses_mark __attribute__((section(".noinit")));

// A supply that comes up may set several flags. One that has broken down while somebody pressed the
// reset button has broken down all the same. Boot loaders that leave the flags start the program by
// a watchdog reset of their own after an external one, so that both are set.
ccr::ResetCause cause_of(uint8_t flags) {
  if ((flags & _BV(PORF)) != 0) {
    return ccr::ResetCause::kPowerOn;
  }
  if ((flags & _BV(BORF)) != 0) {
    return ccr::ResetCause::kBrownOut;
  }
  if ((flags & _BV(EXTRF)) != 0) {
    return ccr::ResetCause::kExternal;
  }
  return (flags & _BV(WDRF)) != 0 ? ccr::ResetCause::kWatchdog : ccr::ResetCause::kUnknown;
}

// The boot loader that UNOs are sold with, optiboot 4.4, clears the flags, as older ones do. Those
// from 5.0 on hand them on in r2, but some of them a watchdog reset for every external one, and r2
// is anything behind the others: memory tells better. No flag is set either where no reset has come
// at all, and the program has jumped to its start.
ccr::ResetCause cause_by_memory() {
  if (run_mark != kRunMark) {
    return ccr::ResetCause::kPowerOn;
  }
  return ms_since_feed >= kStarvedMs ? ccr::ResetCause::kWatchdog : ccr::ResetCause::kUnknown;
}

}  // namespace

volatile uint8_t ms_since_feed __attribute__((section(".noinit")));

void keep_in_mind(const ccr::Pulses& pulses) {
  pulses_mark = pulses.are_none() ? 0 : kPulsesMark;
}

ccr::Start find_start() {
  const uint8_t flags = reset_flags_found();
  const ccr::ResetCause cause = flags != 0 ? cause_of(flags) : cause_by_memory();
  const ccr::Start start = {cause, pulses_mark == kPulsesMark};
  run_mark = kRunMark;
  pulses_mark = 0;
  clear_ms_since_feed();
  return start;
}

}  // namespace uno
