#include "uno_hardware.h"

#include <avr/eeprom.h>
#include <avr/io.h>

#include "ccr_messages.h"
#include "frame_timer.h"
#include "uart.h"

namespace uno {

namespace {

uint8_t* eeprom_pointer(uint16_t address) { return reinterpret_cast<uint8_t*>(address); }

}  // namespace

// The emergency-stop input, pin 7, is pulled up: a missing or broken wire counts as open. The
// divider is at A0, measured against the board's 5 V; a conversion takes 0.1 ms, the first one 0.2 ms.
UnoHardware::UnoHardware(const StackMonitor& stack) : stack_(stack) {
  PORTD |= _BV(PORTD7);
  ADMUX = _BV(REFS0) | _BV(ADLAR);
  ADCSRA = _BV(ADEN) | _BV(ADSC) | _BV(ADPS2) | _BV(ADPS1) | _BV(ADPS0);
}

uint16_t UnoHardware::capabilities() {
  return ccr::capabilities::kEeprom | ccr::capabilities::kHardwarePulses |
         ccr::capabilities::kStackMonitor;
}

uint32_t UnoHardware::time_us() { return frame_timer::now_us(); }

bool UnoHardware::has_room(uint8_t size) { return uart::has_room(size); }

void UnoHardware::send(const uint8_t* frame, uint8_t size) { uart::send(frame, size); }

bool UnoHardware::is_eeprom_ready() { return eeprom_is_ready(); }

// Both wait while a byte is being written: at the start, if a reset came during a save.
uint8_t UnoHardware::read_eeprom(uint16_t address) {
  return eeprom_read_byte(eeprom_pointer(address));
}

void UnoHardware::write_eeprom(uint16_t address, uint8_t byte) {
  eeprom_write_byte(eeprom_pointer(address), byte);
}

bool UnoHardware::is_emergency_stop_open() { return (PIND & _BV(PIND7)) != 0; }

uint8_t UnoHardware::supply_reading() {
  const uint8_t reading = ADCH;
  ADCSRA |= _BV(ADSC);
  return reading;
}

// Pin 8; configured as an output at the start.
void UnoHardware::set_servo_supply(bool is_on) {
  if (is_on) {
    PORTB |= _BV(PORTB0);
  } else {
    PORTB &= static_cast<uint8_t>(~_BV(PORTB0));
  }
}

// Pin 13, the UNO's built-in LED.
void UnoHardware::set_led(bool is_on) {
  DDRB |= _BV(DDB5);
  if (is_on) {
    PORTB |= _BV(PORTB5);
  } else {
    PORTB &= static_cast<uint8_t>(~_BV(PORTB5));
  }
}

uint16_t UnoHardware::least_free_stack() { return stack_.least_free(); }

}  // namespace uno
