// 250000 baud at 16 MHz, exactly; polled.
#pragma once

#include <avr/io.h>

static inline void uart_start(void) {
    UCSR0A = _BV(U2X0);
    UBRR0 = 7;
    UCSR0B = _BV(RXEN0) | _BV(TXEN0);
}

static inline void uart_put(uint8_t value) {
    while (!(UCSR0A & _BV(UDRE0))) {
    }
    UDR0 = value;
}

static inline uint8_t uart_get(void) {
    while (!(UCSR0A & _BV(RXC0))) {
    }
    return UDR0;
}
