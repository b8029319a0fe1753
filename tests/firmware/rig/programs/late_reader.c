// Reads nothing for 1 ms after its first byte, then tells status and data of all that is there.
#include <util/delay.h>

#include "uart.h"

int main(void) {
    uart_start();
    for (;;) {
        while (!(UCSR0A & _BV(RXC0))) {
        }
        _delay_ms(1);
        while (UCSR0A & _BV(RXC0)) {
            const uint8_t status = UCSR0A & (_BV(FE0) | _BV(DOR0));
            const uint8_t data = UDR0;
            uart_put(status);
            uart_put(data);
        }
    }
}
