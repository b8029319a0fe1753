// Fast PWM with ICR1 as the top, 20 ms, 0.5 us. Two bytes set a compare value at once, the low one
// first; 'A' and 'B' before them choose the output. 'a' and 'b' connect, 'x' disconnects both,
// 'i' makes the pins inputs, 'o' outputs, 'p' writes the port without changing anything.
#include <avr/io.h>

#include "uart.h"

static uint16_t get_value(void) {
    const uint8_t low = uart_get();
    return low | uart_get() << 8;
}

int main(void) {
    uart_start();
    ICR1 = 39999;
    OCR1A = 2999;
    OCR1B = 1999;
    DDRB = _BV(1) | _BV(2);
    TCCR1A = _BV(WGM11);
    TCCR1B = _BV(WGM13) | _BV(WGM12) | _BV(CS11);
    for (;;) {
        const uint8_t command = uart_get();
        switch (command) {
            case 'A': OCR1A = get_value(); break;
            case 'B': OCR1B = get_value(); break;
            case 'a': TCCR1A |= _BV(COM1A1); break;
            case 'b': TCCR1A |= _BV(COM1B1); break;
            case 'x': TCCR1A = _BV(WGM11); break;
            case 'i': DDRB = 0; break;
            case 'o': DDRB = _BV(1) | _BV(2); break;
            case 'p': PORTB = PORTB; break;
        }
        uart_put(command);
    }
}
