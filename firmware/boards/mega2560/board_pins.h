// The pins of an Arduino Mega 2560, and the timers that make its servo pulses.
//
// Axes 1 to 12 are pins 11, 5, 6, 46, 12, 2, 7, 45, 3, 8, 44, 13: neighbouring axes are on different
// timers, whose pulses begin one after the other, so that no more than three servos start together.
// Pin 13, which is the built-in LED too, comes last. Pin 22 enables the servos' supply, pin 23 is the
// emergency-stop input, pin 24 an LED, A0 the divider of the servos' supply.
#ifndef CCR_BOARD_PINS_H
#define CCR_BOARD_PINS_H

#include <avr/io.h>
#include <stdint.h>

#include "pulses.h"

#ifndef __AVR_ATmega2560__
#error "registers, timers and memory are those of an ATmega2560: build it for the Arduino Mega 2560"
#endif

#define CCR_UART_RX_vect USART0_RX_vect
#define CCR_UART_UDRE_vect USART0_UDRE_vect

namespace avr {

constexpr uint8_t kMostAxes = 12;

namespace pulse_timers {

constexpr uint8_t kTimers = 4;
constexpr uint16_t kStaggerUs = 3500;
/// Delay from the start of the frame to that of the first and of the last pulse. A tick of 12 axes
/// takes up to 1.9 ms, and has time until the first one.
constexpr uint16_t kFirstStartUs = 2000;
constexpr uint16_t kLastStartUs = kFirstStartUs + (kTimers - 1) * kStaggerUs;

/// Output compare unit: timer, of 1, 3, 4 and 5, and channel A, B or C.
struct Output {
  uint8_t timer;
  uint8_t channel;
};

constexpr Output output_of(uint8_t axis) {
  return axis < 8 ? Output{static_cast<uint8_t>(axis % kTimers), static_cast<uint8_t>(axis / kTimers)}
                  : Output{static_cast<uint8_t>((axis + 1) % kTimers), 2};
}

/// Registers of a timer (datasheet, Register Summary): TCCRnA is the first. Not from a table, which
/// would be in memory that is not yet initialised at the start.
inline volatile uint8_t* registers_of(uint8_t timer) {
  return timer == 3 ? &TCCR5A : &TCCR1A + timer * (&TCCR3A - &TCCR1A);
}
constexpr uint8_t kControlB = 1;
constexpr uint8_t kCount = 4;
constexpr uint8_t kTop = 6;
constexpr uint8_t kCompare = 8;

inline volatile uint16_t& pair(uint8_t timer, uint8_t at) {
  return *reinterpret_cast<volatile uint16_t*>(registers_of(timer) + at);
}

constexpr uint8_t kFastPwmToIcrA = _BV(WGM11);
constexpr uint8_t kFastPwmToIcrB = _BV(WGM13) | _BV(WGM12);

/// Compare values and connected pins of a frame.
struct Settings {
  uint16_t compare[ccr::kAxes] = {};
  uint8_t control_a[kTimers] = {kFastPwmToIcrA, kFastPwmToIcrA, kFastPwmToIcrA, kFastPwmToIcrA};

  /// The pin is high for one count more than the register value.
  void set(const ccr::Pulses& pulses) {
    for (uint8_t axis = 0; axis < ccr::kAxes; ++axis) {
      if (pulses.half_us[axis] != ccr::kNoPulse) {
        const Output output = output_of(axis);
        compare[axis] = static_cast<uint16_t>(pulses.half_us[axis] - 1);
        control_a[output.timer] = static_cast<uint8_t>(control_a[output.timer] |
                                                       _BV(COM1A1) >> (2 * output.channel));
      }
    }
  }
};

/// Widths count from the timer's next period on, connected pins at once.
inline void apply(const Settings& settings) {
  for (uint8_t axis = 0; axis < ccr::kAxes; ++axis) {
    const Output output = output_of(axis);
    pair(output.timer, static_cast<uint8_t>(kCompare + 2 * output.channel)) =
        settings.compare[axis];
  }
  for (uint8_t timer = 0; timer < kTimers; ++timer) {
    *registers_of(timer) = settings.control_a[timer];
  }
}

/// The boot loader may have left them running. Each begins its period later than the one before.
inline void stop_and_clear(uint16_t frame_counts) {
  constexpr uint16_t kCountsPerUs = 2;
  for (uint8_t timer = 0; timer < kTimers; ++timer) {
    registers_of(timer)[kControlB] = 0;
    *registers_of(timer) = kFastPwmToIcrA;
    pair(timer, kTop) = static_cast<uint16_t>(frame_counts - 1);
    const uint16_t late_us = static_cast<uint16_t>(kFirstStartUs + timer * kStaggerUs);
    pair(timer, kCount) = static_cast<uint16_t>(frame_counts - late_us * kCountsPerUs);
  }
  TIFR1 = 0xFF;
}

/// Starts the timers at half a microsecond a count, once the prescaler is released.
inline void start() {
  TCCR1B = kFastPwmToIcrB | _BV(CS11);
  TCCR3B = kFastPwmToIcrB | _BV(CS11);
  TCCR4B = kFastPwmToIcrB | _BV(CS11);
  TCCR5B = kFastPwmToIcrB | _BV(CS11);
}

}  // namespace pulse_timers

namespace pins {

constexpr uint8_t kServosB = _BV(PB5) | _BV(PB6) | _BV(PB7);
constexpr uint8_t kServosE = _BV(PE3) | _BV(PE4) | _BV(PE5);
constexpr uint8_t kServosH = _BV(PH3) | _BV(PH4) | _BV(PH5);
constexpr uint8_t kServosL = _BV(PL3) | _BV(PL4) | _BV(PL5);
constexpr uint8_t kSupply = _BV(PA0);
constexpr uint8_t kEmergencyStop = _BV(PA1);
constexpr uint8_t kLed = _BV(PA2);
constexpr bool kHasBuiltInLed = ccr::kAxes < kMostAxes;

inline void put(volatile uint8_t& port, uint8_t bits, bool is_high) {
  port = static_cast<uint8_t>(is_high ? port | bits : port & static_cast<uint8_t>(~bits));
}

/// Servo pins and the output for their supply low. Accesses registers only.
inline void start() {
  put(PORTB, kServosB, false);
  put(PORTE, kServosE, false);
  put(PORTH, kServosH, false);
  put(PORTL, kServosL, false);
  put(PORTA, kSupply, false);
  DDRB |= kServosB;
  DDRE |= kServosE;
  DDRH |= kServosH;
  DDRL |= kServosL;
  DDRA |= kSupply | kLed;
}

/// Pulled up: a missing or broken wire counts as open.
inline void pull_up_emergency_stop() { put(PORTA, kEmergencyStop, true); }
inline bool is_emergency_stop_open() { return (PINA & kEmergencyStop) != 0; }

inline void set_servo_supply(bool is_on) { put(PORTA, kSupply, is_on); }

inline void set_led(bool is_on) {
  put(PORTA, kLed, is_on);
  if (kHasBuiltInLed) {
    put(PORTB, _BV(PB7), is_on);
  }
}

}  // namespace pins
}  // namespace avr

#endif
