/* TIFRn and TIMSKn as in the datasheet: simavr clears all flags of a timer on any write to
 * TIFRn, and forgets a flag that was set while its interrupt was disabled. */
#include "parts.h"

enum { REG_TIFR0 = 0x35, REG_TIMSK0 = 0x6E };

enum { FLAGS_PER_TIMER = 5 };

typedef struct {
    avr_int_vector_t *vectors[FLAGS_PER_TIMER];
} flags_t;

static flags_t flags_of(void *param) {
    avr_timer_t *timer = param;
    return (flags_t){{
        &timer->overflow,
        &timer->icr,
        &timer->comp[AVR_TIMER_COMPA].interrupt,
        &timer->comp[AVR_TIMER_COMPB].interrupt,
        &timer->comp[AVR_TIMER_COMPC].interrupt,
    }};
}

static void flags_write(avr_t *avr, avr_io_addr_t address, uint8_t value, void *param) {
    const flags_t flags = flags_of(param);
    (void)address;
    for (int i = 0; i < FLAGS_PER_TIMER; i++) {
        avr_int_vector_t *vector = flags.vectors[i];
        if (vector->vector && value >> vector->raised.bit & 1) avr_clear_interrupt(avr, vector);
    }
}

static void masks_write(avr_t *avr, avr_io_addr_t address, uint8_t value, void *param) {
    const flags_t flags = flags_of(param);
    avr->data[address] = value;
    for (int i = 0; i < FLAGS_PER_TIMER; i++) {
        avr_int_vector_t *vector = flags.vectors[i];
        if (vector->vector && avr_regbit_get(avr, vector->raised)) avr_raise_interrupt(avr, vector);
    }
}

void timer_flags_attach(avr_t *avr) {
    for (unsigned number = 0; number < ALL_TIMERS; number++) {
        avr_timer_t *timer = find_timer(avr, '0' + number);
        if (!timer) continue;
        replace_write(avr, REG_TIFR0 + number, flags_write, timer);
        replace_write(avr, REG_TIMSK0 + number, masks_write, timer);
    }
}
