// 'w' address value: writes and tells how long EEPE was set, in timer counts of 64 us;
// 'r' address: reads.
#include <avr/eeprom.h>

#include "uart.h"

int main(void) {
    uart_start();
    TCCR0B = _BV(CS02) | _BV(CS00);
    for (;;) {
        if (uart_get() == 'w') {
            const uint8_t address = uart_get();
            const uint8_t value = uart_get();
            TCNT0 = 0;
            eeprom_write_byte((uint8_t *)(uint16_t)address, value);
            eeprom_busy_wait();
            uart_put(TCNT0);
        } else {
            uart_put(eeprom_read_byte((const uint8_t *)(uint16_t)uart_get()));
        }
    }
}
