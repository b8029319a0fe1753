// Where the port to another board starts: it compiles, and does nothing. See docs/porting.md.
//
//     g++ -std=c++14 -DCCR_AXES=6 -Ilib/core -Ilib/protocol boards/skeleton/main.cpp lib/core/*.cpp

#include "board.h"

namespace {

class NewHardware final : public ccr::Hardware {
 public:
  uint16_t capabilities() override { return ccr::capabilities::kHardwarePulses; }
  uint32_t time_us() override { return 0; }

  bool has_room(uint8_t) override { return false; }
  void send(const uint8_t*, uint8_t) override {}

  bool is_eeprom_ready() override { return true; }
  uint8_t read_eeprom(uint16_t) override { return 0xFF; }
  void write_eeprom(uint16_t, uint8_t) override {}

  bool is_emergency_stop_open() override { return true; }
  uint8_t supply_reading() override { return 0; }
  void set_servo_supply(bool) override {}
  void set_led(bool) override {}

  uint16_t least_free_stack() override { return ccr::kStackNotMeasured; }
};

/// Each starts 20 ms after the one before; taken over before the next frame.
void set_pulses_of_next_frame(const ccr::Pulses&) {}

/// 18 ms after the start of each frame, exactly once a frame.
bool is_tick_due() { return false; }
/// Whether the next tick was due before this one was done.
bool take_overrun() { return false; }

bool has_received() { return false; }
uint8_t take_byte() { return 0; }
uint16_t take_lost_bytes() { return 0; }

void feed_watchdog() {}
ccr::Start find_start() { return {ccr::ResetCause::kUnknown, false}; }

bool is_switched_off() { return true; }

}  // namespace

int main() {
  NewHardware hardware;
  ccr::Board board(hardware, find_start());
  bool has_ticked = false;
  bool has_received_all = false;
  while (!is_switched_off()) {
    if (is_tick_due()) {
      set_pulses_of_next_frame(board.tick());
      board.report();
      if (take_overrun()) {
        board.raise_fault(ccr::Fault::kTickOverrun);
      }
      has_ticked = true;
    } else if (has_received()) {
      board.on_byte(take_byte());
      board.count_overruns(take_lost_bytes());
    } else {
      has_received_all = true;
    }
    if (has_ticked && has_received_all) {
      has_ticked = has_received_all = false;
      feed_watchdog();
    }
  }
  return 0;
}
