#include "uart.h"

#include <avr/interrupt.h>
#include <avr/io.h>

#include "board_pins.h"
#include "byte_ring.h"
#include "ccr_messages.h"

#ifndef CCR_BAUD
#define CCR_BAUD ccr::kBaud
#endif

namespace avr {
namespace uart {

namespace {

constexpr uint32_t kBaud = CCR_BAUD;

constexpr uint32_t divisor(uint32_t clocks_per_count) {
  return (F_CPU + clocks_per_count / 2 * kBaud) / (clocks_per_count * kBaud);
}
constexpr uint32_t error_baud(uint32_t clocks_per_count) {
  const uint32_t real = F_CPU / clocks_per_count / divisor(clocks_per_count);
  return real > kBaud ? real - kBaud : kBaud - real;
}

// 16 samples per bit tolerate more clock error than 8, if they can produce the baud rate.
constexpr bool kIsDoubleSpeed = error_baud(8) < error_baud(16);
constexpr uint32_t kClocksPerCount = kIsDoubleSpeed ? 8 : 16;
static_assert(divisor(kClocksPerCount) <= 4096, "the baud rate register has 12 bits");
// 115200, the fallback, is 2.1 % off.
static_assert(error_baud(kClocksPerCount) * 40 <= kBaud, "baud rate more than 2.5 % off");

// What may be outstanding: 2.5 ms of a saturated line. On a large board twice as much, 10 ms, as a
// dozen of its long replies find room in an empty send buffer, and are built one after another.
ByteRing<(ccr::kIsLarge ? 2 : 1) * (ccr::kOutstandingBytes + 1)> received;
static_assert(sizeof(decltype(received)::Index) == 1, "the main loop takes bytes without locking");
// The UART holds two more bytes.
ByteRing<ccr::kSendBytes + 1> to_send;
volatile uint8_t lost_bytes = 0;

}  // namespace

void start() {
  UBRR0 = static_cast<uint16_t>(divisor(kClocksPerCount) - 1);
  UCSR0A = kIsDoubleSpeed ? _BV(U2X0) : 0;
  UCSR0C = _BV(UCSZ01) | _BV(UCSZ00);
  UCSR0B = _BV(RXCIE0) | _BV(RXEN0) | _BV(TXEN0);
}

bool has_received() { return !received.is_empty(); }

uint8_t take_byte() {
  uint8_t byte = 0;
  received.pop(byte);
  return byte;
}

uint8_t take_lost_bytes() {
  static uint8_t taken = 0;
  const uint8_t lost = static_cast<uint8_t>(lost_bytes - taken);
  taken = static_cast<uint8_t>(taken + lost);
  return lost;
}

bool has_room(uint8_t size) { return to_send.free() >= size; }

void send(const uint8_t* bytes, uint8_t size) {
  to_send.push_all(bytes, size);
  UCSR0B = UCSR0B | _BV(UDRIE0);
}

ISR(CCR_UART_RX_vect) {
  const uint8_t status = UCSR0A;  // Before UDR0, as reading the byte clears it.
  const uint8_t byte = UDR0;
  // A byte with a framing error is accepted like any other: the CRC checks the frame as a whole.
  if ((status & _BV(DOR0)) != 0) {
    lost_bytes = static_cast<uint8_t>(lost_bytes + 1);
  }
  if (!received.push(byte)) {
    lost_bytes = static_cast<uint8_t>(lost_bytes + 1);
  }
}

ISR(CCR_UART_UDRE_vect) {
  uint8_t byte;
  if (to_send.pop(byte)) {
    UDR0 = byte;
  } else {
    UCSR0B = UCSR0B & static_cast<uint8_t>(~_BV(UDRIE0));
  }
}

}  // namespace uart
}  // namespace avr
