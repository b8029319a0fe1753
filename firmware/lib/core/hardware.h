// Interface of the hardware that the core runs on.
#ifndef CCR_HARDWARE_H
#define CCR_HARDWARE_H

#include <stdint.h>

namespace ccr {

class Hardware {
 public:
  /// Bits of `capabilities`, except those of optional messages, which the core sets.
  virtual uint16_t capabilities() = 0;

  /// Time since the reset; wraps.
  virtual uint32_t time_us() = 0;

  /// Whether `size` more bytes can be queued. Checked before building an answer, which takes longer.
  virtual bool has_room(uint8_t size) = 0;
  /// Queues a frame for which there is room.
  virtual void send(const uint8_t* frame, uint8_t size) = 0;

  /// Whether EEPROM can be read or written without waiting.
  virtual bool is_eeprom_ready() = 0;
  virtual uint8_t read_eeprom(uint16_t address) = 0;
  /// Starts to write a byte.
  virtual void write_eeprom(uint16_t address, uint8_t byte) = 0;

  /// Whether the emergency-stop input is open; true if nothing is wired to it.
  virtual bool is_emergency_stop_open() = 0;
  /// Output of the servo supply's divider, in 5 V / 255, no older than a tick. Called in each tick.
  virtual uint8_t supply_reading() = 0;
  /// Called in each tick.
  virtual void set_servo_supply(bool is_on) = 0;
  virtual void set_led(bool is_on) = 0;

  /// Least free stack so far; `kStackNotMeasured` if unknown.
  virtual uint16_t least_free_stack() = 0;

 protected:
  // Hardware is never owned through this class; a virtual destructor would pull in a heap.
  ~Hardware() = default;
};

constexpr uint16_t kStackNotMeasured = 0xFFFF;

}  // namespace ccr

#endif
