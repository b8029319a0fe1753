#include "frame_timer.h"

#include <avr/interrupt.h>
#include <avr/io.h>
#include <util/atomic.h>

#include "ccr_messages.h"
#include "reset_cause.h"

#ifndef CCR_TIME_AT_RESET_US
#define CCR_TIME_AT_RESET_US 0UL
#endif

namespace uno {
namespace frame_timer {

namespace {

constexpr uint8_t kCountsPerUs = 2;
constexpr uint8_t kPulsePrescaler = 8;
constexpr uint16_t kFrameCounts = ccr::kTickUs * kCountsPerUs;
static_assert(F_CPU == 1000000UL * kCountsPerUs * kPulsePrescaler, "Timer1 counts half us");

constexpr uint8_t kMsPrescaler = 64;
constexpr uint8_t kCountsPerMs = F_CPU / 1000 / kMsPrescaler;
static_assert(1000UL * kMsPrescaler * kCountsPerMs == F_CPU, "Timer2 counts whole ms");

constexpr uint8_t kMsPerFrame = ccr::kTickUs / 1000;
constexpr uint16_t kFrameCountsPerMs = kFrameCounts / kMsPerFrame;
constexpr uint8_t kTickAtMs = ccr::kTickPhaseUs / 1000;
// The pins are low then, whatever the pulse widths: connecting or disconnecting one cuts no pulse.
// The tick has 1 ms; if it is late, its pulses wait for the next frame.
constexpr uint8_t kCommitAtMs = kTickAtMs + 1;
static_assert(kCommitAtMs < kMsPerFrame, "before the next frame");
// Connecting pins takes effect at once, unlike setting pulse widths, so it must not happen so late
// that the next frame may have started.
constexpr uint16_t kCommitBeforeCounts = kFrameCounts - 50 * kCountsPerUs;
static_assert(ccr::kPulseCeilingHalfUs < kTickAtMs * 1000UL * kCountsPerUs, "pins are low");

constexpr uint8_t kFastPwmToIcr1A = _BV(WGM11);
constexpr uint8_t kFastPwmToIcr1B = _BV(WGM13) | _BV(WGM12);

struct CompareSettings {
  uint16_t ocr_a;
  uint16_t ocr_b;
  uint8_t tccr_a;
};

CompareSettings prepared = {0, 0, kFastPwmToIcr1A};
volatile uint32_t frame_start_us = CCR_TIME_AT_RESET_US;
volatile uint8_t ticks_due = 0;
volatile bool has_overrun = false;
volatile bool has_lost_ms = false;

/// Used by interrupts only. Counted, and checked against Timer1, which cannot lose any.
uint8_t ms_in_frame = 0;
uint16_t ms_began_counts = 0;
bool has_frame_had_its_tick = false;

/// The pin is high for one count more than the register value.
constexpr uint16_t compare_value(uint16_t pulse_half_us) {
  return static_cast<uint16_t>(pulse_half_us - 1);
}

void begin_next_ms() {
  ++ms_in_frame;
  ms_began_counts = static_cast<uint16_t>(ms_began_counts + kFrameCountsPerMs);
  if (ms_in_frame == kMsPerFrame) {
    ms_in_frame = 0;
    ms_began_counts = 0;
  } else if (ms_in_frame == kTickAtMs) {
    if (ticks_due > 0) {
      has_overrun = true;
    }
    ticks_due = static_cast<uint8_t>(ticks_due + 1);
    has_frame_had_its_tick = true;
  }
}

bool is_in_ms(uint16_t counts) {
  return static_cast<uint16_t>(counts - ms_began_counts) < kFrameCountsPerMs;
}

/// The boot loader may have left the timers running.
inline void stop_and_clear_timers() {
  TCCR1B = 0;
  TCCR2B = 0;
  TCCR1A = kFastPwmToIcr1A;
  TCCR2A = _BV(WGM21);
  ICR1 = kFrameCounts - 1;
  OCR2A = kCountsPerMs - 1;
  TCNT1 = 0;
  TCNT2 = 0;
  TIFR1 = 0xFF;
  TIFR2 = 0xFF;
}

}  // namespace

void start() {
  PORTB = PORTB & static_cast<uint8_t>(~(_BV(PORTB0) | _BV(PORTB1) | _BV(PORTB2)));
  DDRB = DDRB | _BV(DDB0) | _BV(DDB1) | _BV(DDB2);
  stop_and_clear_timers();
  // Hold the prescalers at zero until both timers have their clocks.
  GTCCR = _BV(TSM) | _BV(PSRASY) | _BV(PSRSYNC);
  TCCR1B = kFastPwmToIcr1B | _BV(CS11);
  TCCR2B = _BV(CS22);
  GTCCR = 0;
}

void enable_interrupts() {
  TIMSK1 = _BV(TOIE1);
  TIMSK2 = _BV(OCIE2A);
}

uint32_t now_us() {
  uint32_t start_us;
  uint16_t counts;
  bool has_new_frame_begun;
  ATOMIC_BLOCK(ATOMIC_RESTORESTATE) {
    counts = TCNT1;
    has_new_frame_begun = (TIFR1 & _BV(TOV1)) != 0;
    start_us = frame_start_us;
  }
  // The overflow may have come after the counter was read.
  if (has_new_frame_begun && counts < kFrameCounts / 2) {
    start_us += ccr::kTickUs;
  }
  return start_us + counts / kCountsPerUs;
}

bool is_tick_due() { return ticks_due > 0; }

void finish_tick() {
  ATOMIC_BLOCK(ATOMIC_RESTORESTATE) { ticks_due = static_cast<uint8_t>(ticks_due - 1); }
}

bool take(volatile bool& flag) {
  const bool is_set = flag;
  if (is_set) {
    flag = false;
  }
  return is_set;
}

bool take_overrun() { return take(has_overrun); }

bool take_lost_ms() { return take(has_lost_ms); }

void prepare(const ccr::Pulses& pulses) {
  CompareSettings next = {0, 0, kFastPwmToIcr1A};
  if (pulses.half_us[0] != ccr::kNoPulse) {
    next.ocr_a = compare_value(pulses.half_us[0]);
    next.tccr_a |= _BV(COM1A1);
  }
  if (pulses.half_us[1] != ccr::kNoPulse) {
    next.ocr_b = compare_value(pulses.half_us[1]);
    next.tccr_a |= _BV(COM1B1);
  }
  ATOMIC_BLOCK(ATOMIC_RESTORESTATE) { prepared = next; }
}

ISR(TIMER1_OVF_vect) {
  frame_start_us = frame_start_us + ccr::kTickUs;
  if (!has_frame_had_its_tick) {
    has_lost_ms = true;
  }
  has_frame_had_its_tick = false;
}

ISR(TIMER2_COMPA_vect) {
  count_ms_since_feed();
  const uint16_t counts = TCNT1;
  begin_next_ms();
  while (!is_in_ms(counts)) {  // One frame of milliseconds at most.
    has_lost_ms = true;
    begin_next_ms();
  }
  if (ms_in_frame != kCommitAtMs) {
    return;
  }
  if (counts >= kCommitBeforeCounts) {
    has_lost_ms = true;
    return;
  }
  OCR1A = prepared.ocr_a;
  OCR1B = prepared.ocr_b;
  TCCR1A = prepared.tccr_a;
}

}  // namespace frame_timer
}  // namespace uno
