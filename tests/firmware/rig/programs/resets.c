// After each reset, and on '?', tells MCUSR and a count kept in SRAM. 'w' lets the watchdog bite, 's' sleeps
// for good with interrupts off under the watchdog, 'l' makes a running watchdog slower and waits for
// it, 'c' writes where there is no SRAM, 'j' jumps where there is no flash.
#include <avr/interrupt.h>
#include <avr/sleep.h>
#include <avr/wdt.h>

#include "uart.h"

static uint8_t count __attribute__((section(".noinit")));

int main(void) {
    const uint8_t cause = MCUSR;
    MCUSR = 0;
    wdt_disable();
    uart_start();
    count++;
    uart_put(cause);
    uart_put(count);
    for (;;) {
        switch (uart_get()) {
            case '?':
                uart_put(cause);
                uart_put(count);
                break;
            case 'w':
                wdt_enable(WDTO_15MS);
                for (;;) {
                }
            case 'l':
                wdt_enable(WDTO_15MS);
                wdt_enable(WDTO_120MS);
                for (;;) {
                }
            case 's':
                wdt_enable(WDTO_15MS);
                cli();
                sleep_mode();
                break;
            case 'c':
                *(volatile uint8_t *)0x0F00 = 1;
                break;
            case 'j':
                ((void (*)(void))0x7000)();
                break;
        }
    }
}
