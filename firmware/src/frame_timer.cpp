#include "frame_timer.h"

#include <avr/interrupt.h>
#include <avr/io.h>
#include <util/atomic.h>

#include "board_pins.h"
#include "ccr_messages.h"
#include "reset_cause.h"

#ifndef CCR_TIME_AT_RESET_US
#define CCR_TIME_AT_RESET_US 0UL
#endif

namespace avr {
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
// The tick has 1 ms, and the time until the first pulse; if it is late, its pulses wait for the next
// frame.
constexpr uint8_t kCommitAtMs =
    (kTickAtMs + 1 + pulse_timers::kFirstStartUs / 1000) % kMsPerFrame;
static_assert(pulse_timers::kFirstStartUs % 1000 == 0, "a whole number of ms before the first pulse");
/// Timer1 begins its period with the first pulse.
constexpr uint16_t kBeforeFrameUs =
    pulse_timers::kFirstStartUs == 0 ? 0 : ccr::kTickUs - pulse_timers::kFirstStartUs;
// Connecting pins takes effect at once, unlike setting pulse widths, so it must not happen so late
// that the next frame may have started.
constexpr uint16_t kCommitBeforeCounts = kFrameCounts - 50 * kCountsPerUs;
static_assert(pulse_timers::kLastStartUs * uint32_t{kCountsPerUs} + ccr::kPulseCeilingHalfUs <
                  kTickAtMs * 1000UL * kCountsPerUs,
              "pins are low");
static_assert(ccr::kAxes <= kMostAxes, "more axes than the board has pins for");

pulse_timers::Settings prepared;
/// Time at which Timer1's present period began.
volatile uint32_t frame_start_us = CCR_TIME_AT_RESET_US - kBeforeFrameUs;
volatile uint8_t ticks_due = 0;
volatile bool has_overrun = false;
volatile bool has_lost_ms = false;

/// Used by interrupts only. Counted, and checked against Timer1, which cannot lose any.
uint8_t ms_in_frame = 0;
uint16_t ms_began_counts = kBeforeFrameUs * kCountsPerUs;
bool has_frame_had_its_tick = kBeforeFrameUs != 0;

void begin_next_ms() {
  ++ms_in_frame;
  ms_began_counts = static_cast<uint16_t>(ms_began_counts + kFrameCountsPerMs);
  if (ms_began_counts == kFrameCounts) {
    ms_began_counts = 0;
  }
  if (ms_in_frame == kMsPerFrame) {
    ms_in_frame = 0;
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
  pulse_timers::stop_and_clear(kFrameCounts);
  TCCR2B = 0;
  TCCR2A = _BV(WGM21);
  OCR2A = kCountsPerMs - 1;
  TCNT2 = 0;
  TIFR2 = 0xFF;
}

}  // namespace

void start() {
  pins::start();
  stop_and_clear_timers();
  // Hold the prescalers at zero until all timers have their clocks.
  GTCCR = _BV(TSM) | _BV(PSRASY) | _BV(PSRSYNC);
  pulse_timers::start();
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
  pulse_timers::Settings next;
  next.set(pulses);
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
  pulse_timers::apply(prepared);
}

}  // namespace frame_timer
}  // namespace avr
