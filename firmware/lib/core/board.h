// The whole board but for its hardware: bytes and ticks in, frames and pulses out.
#ifndef CCR_BOARD_H
#define CCR_BOARD_H

#include <stdint.h>

#include "ccr_messages.h"
#include "controller.h"
#include "dispatcher.h"
#include "frame.h"
#include "hardware.h"
#include "pulses.h"

namespace ccr {

class Board {
 public:
  /// Loads the configuration and counts the boot, waiting for EEPROM where it has to.
  ///
  /// `first_tick` is what the tick counter shows before the first tick, to see it wrap.
  Board(Hardware& hardware, Start start, uint32_t first_tick = 0)
      : controller_(hardware, start, first_tick), dispatcher_(controller_, hardware, start.cause) {}

  /// Takes a received byte; answers where it completes a request.
  void on_byte(uint8_t byte) { dispatcher_.receive(decoder_.feed(byte), decoder_); }

  /// One control tick but for its report; returns the pulses of the next frame.
  Pulses tick() { return controller_.tick(); }

  /// After each tick, when its pulses are on their way: sends telemetry where it is due.
  void report() { dispatcher_.end_tick(); }

  void raise_fault(Fault fault) { controller_.raise_fault(fault); }
  /// Received bytes that were lost before they came here.
  void count_overruns(uint16_t bytes) { dispatcher_.count_overruns(bytes); }

  /// To look at, from outside.
  const Controller& controller() const { return controller_; }

 private:
  FrameDecoder decoder_;
  Controller controller_;
  Dispatcher dispatcher_;
};

}  // namespace ccr

#endif
