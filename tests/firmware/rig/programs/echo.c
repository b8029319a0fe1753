// Sends back what it gets, by interrupts; sleeps in between.
#include <avr/interrupt.h>
#include <avr/sleep.h>

#include "uart.h"

static volatile uint8_t ring[256], head, tail;

ISR(USART_RX_vect) {
    ring[head++] = UDR0;
    UCSR0B |= _BV(UDRIE0);
}

ISR(USART_UDRE_vect) {
    UDR0 = ring[tail++];
    if (tail == head) UCSR0B &= ~_BV(UDRIE0);
}

int main(void) {
    uart_start();
    UCSR0B |= _BV(RXCIE0);
    sei();
    for (;;) sleep_mode();
}
