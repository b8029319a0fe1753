// The 20 ms frame: Timer1 generates the servo pulses and counts microseconds, Timer2 counts the
// milliseconds at which the control tick is due and its pulses are handed to Timer1.
#ifndef CCR_AVR_FRAME_TIMER_H
#define CCR_AVR_FRAME_TIMER_H

#include <stdint.h>

#include "pulses.h"

namespace avr {
namespace frame_timer {

/// Starts the timers at the same clock cycle, which is time zero of the protocol, and drives the
/// servo pins and the output for their supply low. Accesses registers only, as it is called before
/// memory is initialised.
void start();

/// Starts counting frames; call no later than 1 ms after `start`.
void enable_interrupts();

/// Time since the start; wraps.
uint32_t now_us();

bool is_tick_due();
/// Call when the tick that was due is done.
void finish_tick();
/// Whether a tick was due before the last one was done, since the last call.
bool take_overrun();
/// Whether a millisecond was lost since the last call, because interrupts were off for longer. The
/// phase of the frame is kept.
bool take_lost_ms();

/// Sets the pulses from the start of the next frame on.
void prepare(const ccr::Pulses& pulses);

}  // namespace frame_timer
}  // namespace avr

#endif
