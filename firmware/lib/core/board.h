// The whole board without its hardware: bytes and ticks in, frames and pulses out.
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
  /// Loads the configuration and counts the boot, waiting for the EEPROM if necessary.
  ///
  /// `first_tick` is the value of the tick counter before the first tick, to test wrapping.
  Board(Hardware& hardware, Start start, uint32_t first_tick = 0)
      : controller_(hardware, start, first_tick), dispatcher_(controller_, hardware, start.cause) {}

  /// Processes a received byte; answers if it completes a request.
  void on_byte(uint8_t byte) { dispatcher_.receive(decoder_.feed(byte), decoder_); }

  /// Runs one control tick without its report; returns the pulses of the next frame.
  Pulses tick() { return controller_.tick(); }

  /// Call after each tick, once its pulses are handed on: sends telemetry if it is due.
  void report() { dispatcher_.end_tick(); }

  void raise_fault(Fault fault) { controller_.raise_fault(fault); }
  /// Counts received bytes that were lost before `on_byte`.
  void count_overruns(uint16_t bytes) { dispatcher_.count_overruns(bytes); }

  /// For tests.
  const Controller& controller() const { return controller_; }

 private:
  FrameDecoder decoder_;
  Controller controller_;
  Dispatcher dispatcher_;
};

}  // namespace ccr

#endif
