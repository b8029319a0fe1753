// The pins of an Arduino UNO, and the timer that makes its servo pulses.
//
// Axis 1 is pin 9 (OC1A), axis 2 pin 10 (OC1B). Pin 8 enables the servos' supply, pin 7 is the
// emergency-stop input, pin 13 the built-in LED, A0 the divider of the servos' supply.
#ifndef CCR_BOARD_PINS_H
#define CCR_BOARD_PINS_H

#include <avr/io.h>
#include <stdint.h>

#include "pulses.h"

#ifndef __AVR_ATmega328P__
#error "registers, timers and memory are those of an ATmega328P: build it for the Arduino UNO"
#endif

#define CCR_UART_RX_vect USART_RX_vect
#define CCR_UART_UDRE_vect USART_UDRE_vect

namespace avr {

constexpr uint8_t kMostAxes = 2;

namespace pins {

/// Servo pins and the output for their supply low. Accesses registers only.
inline void start() {
  PORTB = PORTB & static_cast<uint8_t>(~(_BV(PORTB0) | _BV(PORTB1) | _BV(PORTB2)));
  DDRB = DDRB | _BV(DDB0) | _BV(DDB1) | _BV(DDB2);
}

/// Pulled up: a missing or broken wire counts as open.
inline void pull_up_emergency_stop() { PORTD |= _BV(PORTD7); }
inline bool is_emergency_stop_open() { return (PIND & _BV(PIND7)) != 0; }

inline void set_servo_supply(bool is_on) {
  if (is_on) {
    PORTB |= _BV(PORTB0);
  } else {
    PORTB &= static_cast<uint8_t>(~_BV(PORTB0));
  }
}

inline void set_led(bool is_on) {
  DDRB |= _BV(DDB5);
  if (is_on) {
    PORTB |= _BV(PORTB5);
  } else {
    PORTB &= static_cast<uint8_t>(~_BV(PORTB5));
  }
}

}  // namespace pins

namespace pulse_timers {

/// Delay from the start of the frame to that of the first and of the last pulse.
constexpr uint16_t kFirstStartUs = 0;
constexpr uint16_t kLastStartUs = 0;

constexpr uint8_t kFastPwmToIcrA = _BV(WGM11);
constexpr uint8_t kFastPwmToIcrB = _BV(WGM13) | _BV(WGM12);

/// Compare values and connected pins of a frame.
struct Settings {
  uint16_t ocr_a = 0;
  uint16_t ocr_b = 0;
  uint8_t tccr_a = kFastPwmToIcrA;

  /// The pin is high for one count more than the register value.
  void set(const ccr::Pulses& pulses) {
    if (pulses.half_us[0] != ccr::kNoPulse) {
      ocr_a = static_cast<uint16_t>(pulses.half_us[0] - 1);
      tccr_a |= _BV(COM1A1);
    }
    if (pulses.half_us[1] != ccr::kNoPulse) {
      ocr_b = static_cast<uint16_t>(pulses.half_us[1] - 1);
      tccr_a |= _BV(COM1B1);
    }
  }
};

/// Widths count from the next frame on, connected pins at once.
inline void apply(const Settings& settings) {
  OCR1A = settings.ocr_a;
  OCR1B = settings.ocr_b;
  TCCR1A = settings.tccr_a;
}

/// The boot loader may have left it running.
inline void stop_and_clear(uint16_t frame_counts) {
  TCCR1B = 0;
  TCCR1A = kFastPwmToIcrA;
  ICR1 = static_cast<uint16_t>(frame_counts - 1);
  TCNT1 = 0;
  TIFR1 = 0xFF;
}

/// Starts the timer at half a microsecond a count, once the prescaler is released.
inline void start() { TCCR1B = kFastPwmToIcrB | _BV(CS11); }

}  // namespace pulse_timers
}  // namespace avr

#endif
