// Assembles the board and runs it.
//
// Replaces the `main` of the Arduino framework, which would start Timer0 with an interrupt every
// millisecond, which is not needed, and configure Timer1 and Timer2, which are used here.

#include <avr/interrupt.h>
#include <avr/io.h>
#include <avr/sleep.h>

#include "board.h"
#include "frame_timer.h"
#include "reset_cause.h"
#include "stack_monitor.h"
#include "uart.h"
#include "avr_hardware.h"
#include "watchdog.h"

#ifndef CCR_TICK_AT_RESET
#define CCR_TICK_AT_RESET 0UL
#endif

namespace {

/// Only the processor sleeps: timers and UART keep running.
constexpr uint8_t kSleepIdle = _BV(SE);

/// Twice the stack of the deepest interrupt.
constexpr uint16_t kLeastFreeStack = 64;

struct Firmware {
  avr::StackMonitor stack;
  avr::AvrHardware hardware;
  ccr::Board board;
  avr::ProgressWatchdog watchdog;

  explicit Firmware(ccr::Start start)
      : hardware(stack), board(hardware, start, CCR_TICK_AT_RESET) {}

  void run_tick() {
    stack.look_further();
    if (stack.least_free() < kLeastFreeStack) {
      board.raise_fault(ccr::Fault::kStackLow);
    }
    // Before the tick, which may have come at the wrong time or once too often.
    if (avr::frame_timer::take_lost_ms()) {
      board.raise_fault(ccr::Fault::kInternal);
    }
    const ccr::Pulses pulses = board.tick();
    avr::remember_pulses(pulses);
    avr::frame_timer::prepare(pulses);
    board.report();
    avr::frame_timer::finish_tick();
    if (avr::frame_timer::take_overrun()) {
      board.raise_fault(ccr::Fault::kTickOverrun);
    }
    watchdog.note_tick();
  }

  void receive_byte() {
    board.on_byte(avr::uart::take_byte());
    board.count_overruns(avr::uart::take_lost_bytes());
    watchdog.note_receiver();
  }
};

/// Interrupts are off between the last check and the sleep, so that none is missed: the instruction
/// after `sei` is executed before any interrupt.
void sleep_unless_needed() {
  cli();
  if (!avr::frame_timer::is_tick_due() && !avr::uart::has_received()) {
    SMCR = kSleepIdle;
    sei();
    sleep_cpu();
    SMCR = 0;
  }
  sei();
}

}  // namespace

int main() {
  const ccr::Start start = avr::find_start();
  avr::uart::start();
  avr::frame_timer::enable_interrupts();
  sei();

  static Firmware firmware(start);
  for (;;) {
    if (avr::frame_timer::is_tick_due()) {
      firmware.run_tick();
    } else if (avr::uart::has_received()) {
      firmware.receive_byte();
    } else {
      firmware.watchdog.note_receiver();
      sleep_unless_needed();
    }
    firmware.watchdog.feed_if_both_progressed();
  }
}
