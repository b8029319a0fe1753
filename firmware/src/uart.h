// The serial line to the host. Interrupts move bytes between it and two rings, nothing else.
#ifndef CCR_UNO_UART_H
#define CCR_UNO_UART_H

#include <stdint.h>

namespace uno {
namespace uart {

void start();

bool has_received();
/// Of a line that has received.
uint8_t take_byte();
/// Received bytes lost since the last call, in the UART or for want of room.
uint8_t take_lost_bytes();

bool has_room(uint8_t size);
/// Of a line that has room for it.
void send(const uint8_t* bytes, uint8_t size);

}  // namespace uart
}  // namespace uno

#endif
