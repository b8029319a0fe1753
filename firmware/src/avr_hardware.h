// The UNO as the core sees it.
#ifndef CCR_AVR_HARDWARE_H
#define CCR_AVR_HARDWARE_H

#include <stdint.h>

#include "hardware.h"
#include "stack_monitor.h"

namespace avr {

class AvrHardware final : public ccr::Hardware {
 public:
  explicit AvrHardware(const StackMonitor& stack);

  uint16_t capabilities() override;
  uint32_t time_us() override;
  bool has_room(uint8_t size) override;
  void send(const uint8_t* frame, uint8_t size) override;
  bool is_eeprom_ready() override;
  uint8_t read_eeprom(uint16_t address) override;
  void write_eeprom(uint16_t address, uint8_t byte) override;
  bool is_emergency_stop_open() override;
  uint8_t supply_reading() override;
  void set_servo_supply(bool is_on) override;
  void set_led(bool is_on) override;
  uint16_t least_free_stack() override;

 private:
  const StackMonitor& stack_;
};

}  // namespace avr

#endif
