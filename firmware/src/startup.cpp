#include "startup.h"

#include <avr/io.h>
#include <avr/wdt.h>

#include "frame_timer.h"

namespace uno {

namespace {

volatile uint8_t mcusr_found __attribute__((section(".noinit")));

}  // namespace

uint8_t reset_flags_found() { return mcusr_found; }

// Runs through to the next section of the start-up code: it is not a function that is called. The
// stack pointer is set, variables are not; there is no frame for locals.
//
// The watchdog goes on biting after its reset, at first every 15 ms; WDRF keeps it on, so MCUSR has
// to be cleared before it obeys.
extern "C" void ccr_startup() __attribute__((naked, used, section(".init3")));
void ccr_startup() {
  mcusr_found = MCUSR;
  MCUSR = 0;
  wdt_enable(WDTO_120MS);
  wdt_reset();  // simavr takes over another time-out only then
  frame_timer::start();
}

}  // namespace uno
