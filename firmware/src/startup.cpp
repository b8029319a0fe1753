#include "startup.h"

#include <avr/io.h>
#include <avr/wdt.h>

#include "frame_timer.h"

namespace avr {

namespace {

volatile uint8_t mcusr_found __attribute__((section(".noinit")));

}  // namespace

uint8_t reset_flags_found() { return mcusr_found; }

// Falls through to the next section of the start-up code; it is not called as a function. The stack
// pointer is set, variables are not; there is no stack frame for locals.
//
// The watchdog stays enabled after its reset, at first with 15 ms; WDRF keeps it on, so MCUSR must
// be cleared before it can be configured.
extern "C" void ccr_startup() __attribute__((naked, used, section(".init3")));
void ccr_startup() {
  mcusr_found = MCUSR;
  MCUSR = 0;
  wdt_enable(WDTO_120MS);
  wdt_reset();  // simavr applies a new time-out only then
  frame_timer::start();
}

}  // namespace avr
