// Each received byte b: keeps interrupts off for b times 100 us and goes b times 16 bytes deep
// into the stack, then answers b. Sleeps in between.
#include <avr/interrupt.h>
#include <avr/sleep.h>
#include <util/delay.h>

#include "uart.h"

uint32_t wakings = 7;

static uint8_t __attribute__((noinline)) deep(uint8_t levels) {
    volatile uint8_t frame[14];
    frame[0] = levels;
    return levels ? deep(levels - 1) + frame[0] : 0;
}

static volatile uint8_t received;

ISR(USART_RX_vect) { received = UDR0; }

int main(void) {
    uart_start();
    UCSR0B |= _BV(RXCIE0);
    for (;;) {
        cli();
        set_sleep_mode(SLEEP_MODE_IDLE);
        sleep_enable();
        sei();
        sleep_cpu();
        wakings++;
        cli();
        const uint8_t units = received;
        for (uint8_t i = 0; i < units; i++) _delay_us(100);
        sei();
        deep(units);
        uart_put(units);
    }
}
