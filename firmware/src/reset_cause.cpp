#include "reset_cause.h"

#include <avr/io.h>

#include "startup.h"

namespace avr {

namespace {

/// The watchdog resets after 120 ms; its oscillator may be 10 % fast. It is fed every 20 ms.
constexpr uint8_t kStarvedMs = 80;

constexpr uint32_t kRunMark = 0x52756E21UL;

constexpr uint32_t kPulsesMark = 0x41726D64UL;

uint32_t run_mark __attribute__((section(".noinit")));
uint32_t pulses_mark __attribute__((section(".noinit")));

// At power-up several flags may be set. A brown-out takes precedence over the reset button. Boot
// loaders that leave the flags start the program by a watchdog reset after an external one, so that
// both flags are set.
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

// The boot loader that UNOs are sold with, optiboot 4.4, clears the flags, as older ones do.
// Versions from 5.0 on pass them in r2, but some report a watchdog reset for every external one, and r2 is
// undefined with other boot loaders: memory is more reliable. No flag is set either if there was no
// reset at all and the program jumped to its start.
ccr::ResetCause cause_by_memory() {
  if (run_mark != kRunMark) {
    return ccr::ResetCause::kPowerOn;
  }
  return ms_since_feed >= kStarvedMs ? ccr::ResetCause::kWatchdog : ccr::ResetCause::kUnknown;
}

}  // namespace

volatile uint8_t ms_since_feed __attribute__((section(".noinit")));

void remember_pulses(const ccr::Pulses& pulses) {
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

}  // namespace avr
