// The 20 ms frame: Timer1 makes the servo pulses and the microseconds, Timer2 the milliseconds that
// tell when the control tick is due and when its pulses go to Timer1.
#ifndef CCR_UNO_FRAME_TIMER_H
#define CCR_UNO_FRAME_TIMER_H

#include <stdint.h>

#include "pulses.h"

namespace uno {
namespace frame_timer {

/// Starts both timers at the same clock cycle, which is the reset of the protocol's times, and
/// pulls the servo pins and the output for their supply low. Touches registers only: it is called before memory is set up.
void start();

/// From then on, not more than 1 ms after `start`, frames are counted.
void enable_interrupts();

/// Since the start; wraps.
uint32_t now_us();

bool is_tick_due();
/// The tick that was due is done.
void finish_tick();
/// Was one due before the last one was done, since the last call?
bool take_overrun();
/// Was a millisecond lost since the last call, because interrupts were off for longer than one? The
/// frame goes on in its place.
bool take_lost_ms();

/// Pulses from the start of the next frame on.
void prepare(const ccr::Pulses& pulses);

}  // namespace frame_timer
}  // namespace uno

#endif
