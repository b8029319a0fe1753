// 'w' address value: writes and tells how long EEPE was set, in timer counts of 64 us;
// 'W' the same with address bits set that there are not; 'r' address: reads.
#include <avr/eeprom.h>

#include "uart.h"

int main(void) {
    uart_start();
    TCCR0B = _BV(CS02) | _BV(CS00);
    for (;;) {
        const uint8_t command = uart_get();
        if (command == 'w' || command == 'W') {
            const uint16_t address = uart_get() + (command == 'W' ? 0x8000 : 0);
            const uint8_t value = uart_get();
            TCNT0 = 0;
            eeprom_write_byte((uint8_t *)address, value);
            eeprom_busy_wait();
            uart_put(TCNT0);
        } else {
            uart_put(eeprom_read_byte((const uint8_t *)(uint16_t)uart_get()));
        }
    }
}
