/* Replaces simavr's 16-bit Timer/Counters, which latch no compare value after the first in fast PWM,
 * accept no new ICRn while they run, and clear all flags of TIFRn at once.
 * Modes: normal, CTC (4, 12), fast PWM (5, 6, 7, 14, 15); others count like normal. No input capture,
 * no external clock, no forced compare; the prescaler starts when the clock is selected.
 */
#include "parts.h"

#include <stdio.h>
#include <string.h>

enum {
    MODE_NORMAL = 0,
    MODE_CTC_OCRA = 4,
    MODE_FAST_8_BITS = 5,
    MODE_FAST_9_BITS = 6,
    MODE_FAST_10_BITS = 7,
    MODE_CTC_ICR = 12,
    MODE_FAST_ICR = 14,
    MODE_FAST_OCRA = 15,
    MATCH_NONE = 0,
    MATCH_TOGGLES = 1,
    MATCH_CLEARS = 2,
    MATCH_SETS = 3,
    COUNTS = 0x10000,
};

/* Places of a timer's registers, from its TCCRnA on. */
enum { AT_CONTROL_B = 1, AT_COUNT = 4, AT_TOP = 6, AT_COMPARE = 8 };

static uint8_t reg(const timer16_t *timer, unsigned at) {
    return timer->rig->avr->data[timer->base + at];
}

static unsigned mode_of(const timer16_t *timer) {
    return (reg(timer, 0) & 3) | (reg(timer, AT_CONTROL_B) >> 1 & 0x0C);
}

static bool is_fast_pwm(unsigned mode) {
    return mode == MODE_FAST_8_BITS || mode == MODE_FAST_9_BITS || mode == MODE_FAST_10_BITS ||
           mode == MODE_FAST_ICR || mode == MODE_FAST_OCRA;
}

static unsigned match_action(const timer16_t *timer, unsigned channel) {
    return reg(timer, 0) >> (6 - 2 * channel) & 3;
}

static uint16_t pair(const timer16_t *timer, unsigned at) {
    return reg(timer, at) | reg(timer, at + 1) << 8;
}

static uint16_t top_of(const timer16_t *timer) {
    switch (mode_of(timer)) {
        case MODE_FAST_8_BITS: return 0x00FF;
        case MODE_FAST_9_BITS: return 0x01FF;
        case MODE_FAST_10_BITS: return 0x03FF;
        case MODE_CTC_ICR:
        case MODE_FAST_ICR: return pair(timer, AT_TOP);
        case MODE_CTC_OCRA:
        case MODE_FAST_OCRA: return timer->compare[0];
        default: return COUNTS - 1;
    }
}

static uint16_t count_at(const timer16_t *timer, uint64_t cycle) {
    if (timer->prescaler == 0) return timer->held;
    /* The base is before cycle 0 where the counter was set soon after the start. */
    const int64_t since = cycle - timer->base_cycle;
    return since < 0 ? 0 : since / timer->prescaler;
}

/* A counter beyond the top, because the top was lowered, runs to its maximum. */
static uint32_t counts_to_wrap(const timer16_t *timer, uint64_t cycle) {
    const uint16_t top = top_of(timer);
    return count_at(timer, cycle) > top ? COUNTS : top + 1u;
}

static uint64_t cycle_of_count(const timer16_t *timer, uint32_t count) {
    return timer->base_cycle + (uint64_t)count * timer->prescaler;
}

static uint64_t next_event(const timer16_t *timer, uint64_t after) {
    uint64_t next = cycle_of_count(timer, counts_to_wrap(timer, after));
    for (unsigned channel = 0; channel < timer->channels; channel++) {
        const uint64_t match = cycle_of_count(timer, timer->compare[channel] + 1u);
        if (match > after && match < next) next = match;
    }
    return next;
}

static void match(timer16_t *timer, unsigned channel) {
    bool *output = &timer->output[channel];
    avr_raise_interrupt(timer->rig->avr, &timer->vectors->comp[channel].interrupt);
    switch (match_action(timer, channel)) {
        case MATCH_TOGGLES: *output = !*output; break;
        case MATCH_CLEARS: *output = false; break;
        case MATCH_SETS: *output = true; break;
        default: break;
    }
}

static void latch_compare_values(timer16_t *timer) {
    memcpy(timer->compare, timer->written, sizeof timer->compare);
}

static void begin_pwm_period(timer16_t *timer) {
    latch_compare_values(timer);
    for (unsigned channel = 0; channel < timer->channels; channel++) {
        const unsigned action = match_action(timer, channel);
        if (action == MATCH_CLEARS) timer->output[channel] = true;
        if (action == MATCH_SETS) timer->output[channel] = false;
    }
}

static void wrap(timer16_t *timer, uint64_t when) {
    avr_t *avr = timer->rig->avr;
    const unsigned mode = mode_of(timer);
    const bool passed_the_end = when == cycle_of_count(timer, COUNTS);
    if (is_fast_pwm(mode) || passed_the_end) avr_raise_interrupt(avr, &timer->vectors->overflow);
    if (mode == MODE_FAST_ICR || mode == MODE_CTC_ICR)
        avr_raise_interrupt(avr, &timer->vectors->icr);
    timer->base_cycle = when;
    if (is_fast_pwm(mode)) begin_pwm_period(timer);
}

static avr_cycle_count_t event(avr_t *avr, avr_cycle_count_t when, void *param) {
    timer16_t *timer = param;
    const bool wraps = when == cycle_of_count(timer, counts_to_wrap(timer, when - 1));
    (void)avr;
    for (unsigned channel = 0; channel < timer->channels; channel++)
        if (when == cycle_of_count(timer, timer->compare[channel] + 1u)) match(timer, channel);
    if (wraps) wrap(timer, when);
    pins_update(timer->rig, when);
    return next_event(timer, when);
}

static void schedule(timer16_t *timer) {
    avr_t *avr = timer->rig->avr;
    const uint64_t now = avr->cycle;
    if (timer->prescaler == 0) {
        avr_cycle_timer_cancel(avr, event, timer);
        return;
    }
    avr_cycle_timer_register(avr, next_event(timer, now) - now, event, timer);
}

static void set_count(timer16_t *timer, uint16_t count) {
    timer->held = count;
    timer->base_cycle = timer->rig->avr->cycle - (uint64_t)count * timer->prescaler;
}

static uint32_t selected_prescaler(const timer16_t *timer) {
    static const uint32_t prescalers[] = {0, 1, 8, 64, 256, 1024, 0, 0};
    return prescalers[reg(timer, AT_CONTROL_B) & 7];
}

static bool is_known(unsigned mode) {
    return mode == MODE_NORMAL || mode == MODE_CTC_OCRA || mode == MODE_CTC_ICR ||
           is_fast_pwm(mode);
}

/* The Arduino core passes through a phase-correct mode, without an output, at its start. */
static void refuse_output_in_unknown_mode(timer16_t *timer) {
    const unsigned mode = mode_of(timer);
    bool output = false;
    for (unsigned channel = 0; channel < timer->channels; channel++)
        output = output || match_action(timer, channel);
    if (is_known(mode) || !output || timer->prescaler == 0) return;
    snprintf(timer->rig->trouble, sizeof timer->rig->trouble,
             "timer %c in mode %u, which the rig lacks", timer->name, mode);
}

static void control_write(avr_t *avr, avr_io_addr_t address, uint8_t value, void *param) {
    timer16_t *timer = param;
    const uint16_t count = count_at(timer, avr->cycle);
    avr->data[address] = value;
    if (!is_fast_pwm(mode_of(timer))) latch_compare_values(timer);
    if (selected_prescaler(timer) != timer->prescaler) {
        timer->prescaler = selected_prescaler(timer);
        set_count(timer, count);
    }
    refuse_output_in_unknown_mode(timer);
    schedule(timer);
    pins_update(timer->rig, avr->cycle);
}

/* The high byte was written before. */
static void compare_write(avr_t *avr, avr_io_addr_t address, uint8_t value, void *param) {
    timer16_t *timer = param;
    const unsigned channel = (address - timer->base - AT_COMPARE) / 2;
    avr->data[address] = value;
    timer->written[channel] = pair(timer, AT_COMPARE + 2 * channel);
    if (is_fast_pwm(mode_of(timer))) return;
    timer->compare[channel] = timer->written[channel];
    schedule(timer);
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
    set_count(param, pair(param, AT_COUNT));
    schedule(param);
}

bool timer16_drives(const timer16_t *timer, unsigned channel) {
    const unsigned action = match_action(timer, channel);
    const unsigned mode = mode_of(timer);
    if (action != MATCH_TOGGLES || !is_fast_pwm(mode)) return action != MATCH_NONE;
    return channel == 0 && (mode == MODE_FAST_ICR || mode == MODE_FAST_OCRA);
}

static void attach(timer16_t *timer) {
    avr_t *avr = timer->rig->avr;
    timer->vectors = find_timer(avr, timer->name);
    timer->vectors->io.reset = NULL;
    replace_write(avr, timer->base, control_write, timer);
    replace_write(avr, timer->base + AT_CONTROL_B, control_write, timer);
    for (unsigned channel = 0; channel < timer->channels; channel++)
        replace_write(avr, timer->base + AT_COMPARE + 2 * channel, compare_write, timer);
    replace_write(avr, timer->base + AT_TOP, top_write, timer);
    replace_write(avr, timer->base + AT_COUNT, count_write, timer);
    replace_read(avr, timer->base + AT_COUNT, count_read, timer);
}

void timers16_attach(rig_t *rig) {
    const chip_t *chip = rig->chip;
    for (unsigned i = 0; i < chip->timers; i++) {
        rig->timers[i] = (timer16_t){.rig = rig,
                                     .name = chip->timer[i].name,
                                     .base = chip->timer[i].base,
                                     .channels = chip->channels};
        attach(&rig->timers[i]);
    }
    /* simavr captures ICR1 by its pin even if it is the top, which the chip does not. On a Mega the
     * capture pins are inputs to which nothing is connected. */
    avr_unconnect_irq(avr_io_getirq(rig->avr, AVR_IOCTL_IOPORT_GETIRQ('B'), IOPORT_IRQ_PIN0),
                      avr_io_getirq(rig->avr, AVR_IOCTL_TIMER_GETIRQ('1'), TIMER_IRQ_IN_ICP));
}

void timers16_reset(rig_t *rig) {
    for (unsigned i = 0; i < rig->chip->timers; i++) {
        timer16_t *timer = &rig->timers[i];
        *timer = (timer16_t){.rig = rig,
                             .name = timer->name,
                             .base = timer->base,
                             .channels = timer->channels,
                             .vectors = timer->vectors,
                             .base_cycle = rig->avr->cycle};
    }
}
