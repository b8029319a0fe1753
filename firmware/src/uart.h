// The serial line to the host. Interrupts only move bytes between it and two rings.
#ifndef CCR_AVR_UART_H
#define CCR_AVR_UART_H

#include <stdint.h>

namespace avr {
namespace uart {

void start();

bool has_received();
/// Next received byte; call only if `has_received`.
uint8_t take_byte();
/// Number of received bytes lost since the last call, in the UART or because the ring was full.
uint8_t take_lost_bytes();

bool has_room(uint8_t size);
/// Queues bytes; call only if `has_room`.
void send(const uint8_t* bytes, uint8_t size);

}  // namespace uart
}  // namespace avr

#endif
