#include "reset_cause.h"

#include <avr/io.h>

#include "startup.h"

namespace uno {

namespace {

/// It bites after 120 ms; its oscillator may be a tenth fast. In good health it is fed every 20 ms.
constexpr uint8_t kStarvedMs = 80;

constexpr uint32_t kRunMark = 0x52756E21UL;

uint32_t run_mark __attribute__((section(".noinit")));

// A supply that comes up may set several flags. Boot loaders that leave them start the program by a
// watchdog reset of their own after an external one, so that both are set.
ccr::ResetCause cause_of(uint8_t flags) {
  if ((flags & _BV(PORF)) != 0) {
    return ccr::ResetCause::kPowerOn;
  }
  if ((flags & _BV(EXTRF)) != 0) {
    return ccr::ResetCause::kExternal;
  }
  if ((flags & _BV(BORF)) != 0) {
    return ccr::ResetCause::kBrownOut;
  }
  return (flags & _BV(WDRF)) != 0 ? ccr::ResetCause::kWatchdog : ccr::ResetCause::kUnknown;
}

// The boot loader that UNOs are sold with, optiboot 4.4, clears the flags. Those from 5.0 on hand
// them on in r2, but some of them a watchdog reset for every external one: memory tells better.
ccr::ResetCause cause_by_memory() {
  if (run_mark != kRunMark) {
    return ccr::ResetCause::kPowerOn;
  }
  return ms_since_feed >= kStarvedMs ? ccr::ResetCause::kWatchdog : ccr::ResetCause::kUnknown;
}

}  // namespace

volatile uint8_t ms_since_feed __attribute__((section(".noinit")));

ccr::ResetCause find_reset_cause() {
  const uint8_t flags = reset_flags_found();
  const ccr::ResetCause cause = flags != 0 ? cause_of(flags) : cause_by_memory();
  run_mark = kRunMark;
  clear_ms_since_feed();
  return cause;
}

}  // namespace uno
