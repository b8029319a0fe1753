#include "avr_hardware.h"

#include <avr/eeprom.h>
#include <avr/io.h>

#include "board_pins.h"
#include "ccr_messages.h"
#include "frame_timer.h"
#include "uart.h"

namespace avr {

namespace {

uint8_t* eeprom_pointer(uint16_t address) { return reinterpret_cast<uint8_t*>(address); }

}  // namespace

// The divider is at A0, measured against the board's 5 V; a conversion takes 0.1 ms, the first one
// 0.2 ms.
AvrHardware::AvrHardware(const StackMonitor& stack) : stack_(stack) {
  pins::pull_up_emergency_stop();
  ADMUX = _BV(REFS0) | _BV(ADLAR);
  ADCSRA = _BV(ADEN) | _BV(ADSC) | _BV(ADPS2) | _BV(ADPS1) | _BV(ADPS0);
}

uint16_t AvrHardware::capabilities() {
  return ccr::capabilities::kEeprom | ccr::capabilities::kHardwarePulses |
         ccr::capabilities::kStackMonitor;
}

uint32_t AvrHardware::time_us() { return frame_timer::now_us(); }

bool AvrHardware::has_room(uint8_t size) { return uart::has_room(size); }

void AvrHardware::send(const uint8_t* frame, uint8_t size) { uart::send(frame, size); }

bool AvrHardware::is_eeprom_ready() { return eeprom_is_ready(); }

// Both wait while a byte is being written: at the start, if a reset came during a save.
uint8_t AvrHardware::read_eeprom(uint16_t address) {
  return eeprom_read_byte(eeprom_pointer(address));
}

void AvrHardware::write_eeprom(uint16_t address, uint8_t byte) {
  eeprom_write_byte(eeprom_pointer(address), byte);
}

bool AvrHardware::is_emergency_stop_open() { return pins::is_emergency_stop_open(); }

uint8_t AvrHardware::supply_reading() {
  const uint8_t reading = ADCH;
  ADCSRA |= _BV(ADSC);
  return reading;
}

void AvrHardware::set_servo_supply(bool is_on) { pins::set_servo_supply(is_on); }

void AvrHardware::set_led(bool is_on) { pins::set_led(is_on); }

uint16_t AvrHardware::least_free_stack() { return stack_.least_free(); }

}  // namespace avr
