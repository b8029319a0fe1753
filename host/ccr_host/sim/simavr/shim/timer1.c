/* Replaces simavr's Timer/Counter1, which latches no compare value after the first in fast PWM,
 * accepts no new ICR1 while it runs, and clears all flags of TIFR1 at once.
 * Modes: normal, CTC (4, 12), fast PWM (5, 6, 7, 14, 15); others count like normal. No input capture,
 * no external clock, no forced compare; the prescaler starts when the clock is selected.
 */
#include "parts.h"

#include <stdio.h>

enum {
    MODE_NORMAL = 0,
    MODE_CTC_OCR1A = 4,
    MODE_FAST_8_BITS = 5,
    MODE_FAST_9_BITS = 6,
    MODE_FAST_10_BITS = 7,
    MODE_CTC_ICR1 = 12,
    MODE_FAST_ICR1 = 14,
    MODE_FAST_OCR1A = 15,
    MATCH_NONE = 0,
    MATCH_TOGGLES = 1,
    MATCH_CLEARS = 2,
    MATCH_SETS = 3,
    COUNTS = 0x10000,
};

static unsigned mode_of(const avr_t *avr) {
    return (avr->data[REG_TCCR1A] & 3) | (avr->data[REG_TCCR1B] >> 1 & 0x0C);
}

static bool is_fast_pwm(unsigned mode) {
    return mode == MODE_FAST_8_BITS || mode == MODE_FAST_9_BITS || mode == MODE_FAST_10_BITS ||
           mode == MODE_FAST_ICR1 || mode == MODE_FAST_OCR1A;
}

static unsigned match_action(const rig_t *rig, rig_pin_t pin) {
    return rig->avr->data[REG_TCCR1A] >> (pin == RIG_OC1A ? 6 : 4) & 3;
}

static uint16_t pair(const avr_t *avr, avr_io_addr_t low) {
    return avr->data[low] | avr->data[low + 1] << 8;
}

static uint16_t top_of(const rig_t *rig) {
    switch (mode_of(rig->avr)) {
        case MODE_FAST_8_BITS: return 0x00FF;
        case MODE_FAST_9_BITS: return 0x01FF;
        case MODE_FAST_10_BITS: return 0x03FF;
        case MODE_CTC_ICR1:
        case MODE_FAST_ICR1: return pair(rig->avr, REG_ICR1L);
        case MODE_CTC_OCR1A:
        case MODE_FAST_OCR1A: return rig->timer1.compare[RIG_OC1A];
        default: return COUNTS - 1;
    }
}

static uint16_t count_at(const rig_t *rig, uint64_t cycle) {
    const timer1_t *timer = &rig->timer1;
    if (timer->prescaler == 0) return timer->held;
    return cycle < timer->base_cycle ? 0 : (cycle - timer->base_cycle) / timer->prescaler;
}

/* A counter beyond the top, because the top was lowered, runs to its maximum. */
static uint32_t counts_to_wrap(const rig_t *rig, uint64_t cycle) {
    const uint16_t top = top_of(rig);
    return count_at(rig, cycle) > top ? COUNTS : top + 1u;
}

static uint64_t cycle_of_count(const rig_t *rig, uint32_t count) {
    return rig->timer1.base_cycle + (uint64_t)count * rig->timer1.prescaler;
}

static uint64_t next_event(const rig_t *rig, uint64_t after) {
    uint64_t next = cycle_of_count(rig, counts_to_wrap(rig, after));
    for (int pin = 0; pin < RIG_SERVO_PINS; pin++) {
        const uint64_t match = cycle_of_count(rig, rig->timer1.compare[pin] + 1u);
        if (match > after && match < next) next = match;
    }
    return next;
}

static void match(rig_t *rig, rig_pin_t pin) {
    bool *output = &rig->timer1.output[pin];
    avr_raise_interrupt(rig->avr, &rig->timer1.vectors->comp[pin].interrupt);
    switch (match_action(rig, pin)) {
        case MATCH_TOGGLES: *output = !*output; break;
        case MATCH_CLEARS: *output = false; break;
        case MATCH_SETS: *output = true; break;
        default: break;
    }
}

static void latch_compare_values(timer1_t *timer) {
    for (int pin = 0; pin < RIG_SERVO_PINS; pin++) timer->compare[pin] = timer->written[pin];
}

static void begin_pwm_period(rig_t *rig) {
    latch_compare_values(&rig->timer1);
    for (int pin = 0; pin < RIG_SERVO_PINS; pin++) {
        const unsigned action = match_action(rig, pin);
        if (action == MATCH_CLEARS) rig->timer1.output[pin] = true;
        if (action == MATCH_SETS) rig->timer1.output[pin] = false;
    }
}

static void wrap(rig_t *rig, uint64_t when) {
    timer1_t *timer = &rig->timer1;
    const unsigned mode = mode_of(rig->avr);
    const bool passed_the_end = when == cycle_of_count(rig, COUNTS);
    if (is_fast_pwm(mode) || passed_the_end)
        avr_raise_interrupt(rig->avr, &timer->vectors->overflow);
    if (mode == MODE_FAST_ICR1 || mode == MODE_CTC_ICR1)
        avr_raise_interrupt(rig->avr, &timer->vectors->icr);
    timer->base_cycle = when;
    if (is_fast_pwm(mode)) begin_pwm_period(rig);
}

static avr_cycle_count_t event(avr_t *avr, avr_cycle_count_t when, void *param) {
    rig_t *rig = param;
    const bool wraps = when == cycle_of_count(rig, counts_to_wrap(rig, when - 1));
    (void)avr;
    for (int pin = 0; pin < RIG_SERVO_PINS; pin++)
        if (when == cycle_of_count(rig, rig->timer1.compare[pin] + 1u)) match(rig, pin);
    if (wraps) wrap(rig, when);
    pins_update(rig, when);
    return next_event(rig, when);
}

static void schedule(rig_t *rig) {
    const uint64_t now = rig->avr->cycle;
    if (rig->timer1.prescaler == 0) {
        avr_cycle_timer_cancel(rig->avr, event, rig);
        return;
    }
    avr_cycle_timer_register(rig->avr, next_event(rig, now) - now, event, rig);
}

static void set_count(rig_t *rig, uint16_t count) {
    timer1_t *timer = &rig->timer1;
    timer->held = count;
    timer->base_cycle = rig->avr->cycle - (uint64_t)count * timer->prescaler;
}

static uint32_t selected_prescaler(const avr_t *avr) {
    static const uint32_t prescalers[] = {0, 1, 8, 64, 256, 1024, 0, 0};
    return prescalers[avr->data[REG_TCCR1B] & 7];
}

static bool is_known(unsigned mode) {
    return mode == MODE_NORMAL || mode == MODE_CTC_OCR1A || mode == MODE_CTC_ICR1 ||
           is_fast_pwm(mode);
}

/* The Arduino core passes through a phase-correct mode, without an output, at its start. */
static void refuse_output_in_unknown_mode(rig_t *rig) {
    const unsigned mode = mode_of(rig->avr);
    const bool output = match_action(rig, RIG_OC1A) || match_action(rig, RIG_OC1B);
    if (is_known(mode) || !output || rig->timer1.prescaler == 0) return;
    snprintf(rig->trouble, sizeof rig->trouble, "timer 1 in mode %u, which the rig lacks", mode);
}

static void control_write(avr_t *avr, avr_io_addr_t address, uint8_t value, void *param) {
    rig_t *rig = param;
    timer1_t *timer = &rig->timer1;
    const uint16_t count = count_at(rig, avr->cycle);
    avr->data[address] = value;
    if (!is_fast_pwm(mode_of(avr))) latch_compare_values(timer);
    if (selected_prescaler(avr) != timer->prescaler) {
        timer->prescaler = selected_prescaler(avr);
        set_count(rig, count);
    }
    refuse_output_in_unknown_mode(rig);
    schedule(rig);
    pins_update(rig, avr->cycle);
}

static void compare_write(rig_t *rig, rig_pin_t pin, avr_io_addr_t low, uint8_t value) {
    rig->avr->data[low] = value;
    rig->timer1.written[pin] = pair(rig->avr, low);
    if (is_fast_pwm(mode_of(rig->avr))) return;
    rig->timer1.compare[pin] = rig->timer1.written[pin];
    schedule(rig);
}

static void compare_a_write(avr_t *avr, avr_io_addr_t address, uint8_t value, void *param) {
    (void)avr;
    compare_write(param, RIG_OC1A, address, value);
}

static void compare_b_write(avr_t *avr, avr_io_addr_t address, uint8_t value, void *param) {
    (void)avr;
    compare_write(param, RIG_OC1B, address, value);
}

static void top_write(avr_t *avr, avr_io_addr_t address, uint8_t value, void *param) {
    avr->data[address] = value;
    schedule(param);
}

static uint8_t count_read(avr_t *avr, avr_io_addr_t address, void *param) {
    const uint16_t count = count_at(param, avr->cycle);
    avr->data[address + 1] = count >> 8;
    return (uint8_t)count;
}

static void count_write(avr_t *avr, avr_io_addr_t address, uint8_t value, void *param) {
    avr->data[address] = value;
    set_count(param, pair(avr, address));
    schedule(param);
}

bool timer1_drives(const rig_t *rig, rig_pin_t pin) {
    const unsigned action = match_action(rig, pin);
    const unsigned mode = mode_of(rig->avr);
    if (action != MATCH_TOGGLES || !is_fast_pwm(mode)) return action != MATCH_NONE;
    return pin == RIG_OC1A && (mode == MODE_FAST_ICR1 || mode == MODE_FAST_OCR1A);
}

void timer1_attach(rig_t *rig) {
    avr_t *avr = rig->avr;
    rig->timer1.vectors = find_timer(avr, '1');
    rig->timer1.vectors->io.reset = NULL;
    replace_write(avr, REG_TCCR1A, control_write, rig);
    replace_write(avr, REG_TCCR1B, control_write, rig);
    replace_write(avr, REG_OCR1AL, compare_a_write, rig);
    replace_write(avr, REG_OCR1BL, compare_b_write, rig);
    replace_write(avr, REG_ICR1L, top_write, rig);
    replace_write(avr, REG_TCNT1L, count_write, rig);
    replace_read(avr, REG_TCNT1L, count_read, rig);
    /* simavr captures ICR1 by its pin even if it is the top, which the chip does not. */
    avr_unconnect_irq(avr_io_getirq(avr, AVR_IOCTL_IOPORT_GETIRQ('B'), IOPORT_IRQ_PIN0),
                      avr_io_getirq(avr, AVR_IOCTL_TIMER_GETIRQ('1'), TIMER_IRQ_IN_ICP));
}

void timer1_reset(rig_t *rig) {
    timer1_t *timer = &rig->timer1;
    *timer = (timer1_t){.vectors = timer->vectors, .base_cycle = rig->avr->cycle};
}
