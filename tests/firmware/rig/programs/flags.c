// Timer 1 in normal mode: both compare flags rise; clears one of them, tells TIFR1, then enables
// the other's interrupt, which must come at once, and tells how often it came.
#include <avr/interrupt.h>
#include <util/delay.h>

#include "uart.h"

static volatile uint8_t interrupts;

ISR(TIMER1_COMPB_vect) { interrupts++; }

int main(void) {
    uart_start();
    OCR1A = 100;
    OCR1B = 200;
    sei();
    TCCR1B = _BV(CS10);
    _delay_us(100);
    uart_put(TIFR1);
    TIFR1 = _BV(OCF1A);
    uart_put(TIFR1);
    TIMSK1 = _BV(OCIE1B);
    _delay_us(10);
    uart_put(interrupts);
    for (;;) {
    }
}
