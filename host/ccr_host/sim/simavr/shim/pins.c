/* The pins as an oscilloscope would show them. simavr's own pin signals report changes that do
 * not happen, whenever a port is written. */
#include "parts.h"

#include <avr_extint.h>

enum { DIRECTION = 1, PORT = 2 };

static bool is_set(const rig_t *rig, place_t place, unsigned which) {
    return rig->avr->data[place.port + which] >> place.bit & 1;
}

static bool level_of(const rig_t *rig, unsigned pin) {
    const place_t place = rig->chip->pin[pin];
    if (place.port == 0 || !is_set(rig, place, DIRECTION)) return false;
    if (pin < rig->chip->servos) {
        const unsigned channel = rig->chip->output[pin].channel;
        const timer16_t *timer = &rig->timers[rig->chip->output[pin].timer];
        if (timer16_drives(timer, channel)) return timer->output[channel];
    }
    return is_set(rig, place, PORT);
}

void pins_update(rig_t *rig, uint64_t cycle) {
    for (unsigned pin = 0; pin < RIG_PINS; pin++) {
        const bool level = level_of(rig, pin);
        if (level == rig->pins.level[pin]) continue;
        rig->pins.level[pin] = level;
        log_add(&rig->pins.edges, &(rig_edge_t){.cycle = cycle, .pin = pin, .level = level});
    }
}

static void write_and_update(avr_t *avr, avr_io_addr_t address, uint8_t value, void *param) {
    const port_hook_t *hook = param;
    hook->inner.call(avr, address, value, hook->inner.param);
    pins_update(hook->rig, avr->cycle);
}

/* The emergency-stop input is 0 while its switch to ground is closed; the other pins of the port have
 * the level that they are driven or pulled to. */
static uint8_t emergency_stop_read(avr_t *avr, avr_io_addr_t address, void *param) {
    const rig_t *rig = param;
    const place_t place = rig->chip->emergency_stop;
    const uint8_t *data = avr->data;
    const uint8_t switched = rig->pins.switch_open ? 0 : 1 << place.bit & ~data[place.port + DIRECTION];
    (void)address;
    return data[place.port + PORT] & ~switched;
}

void rig_open_switch(rig_t *rig, bool open) { rig->pins.switch_open = open; }

void pins_attach(rig_t *rig) {
    const chip_t *chip = rig->chip;
    rig->pins.edges.record_size = sizeof(rig_edge_t);
    for (unsigned port = 0; port < MOST_PORTS && chip->ports[port]; port++) {
        for (unsigned which = 0; which < 3; which++) {
            port_hook_t *hook = &rig->pins.hooks[port][which];
            hook->rig = rig;
            hook->inner = replace_write(rig->avr, chip->ports[port] + which, write_and_update, hook);
        }
    }
    replace_read(rig->avr, chip->emergency_stop.port, emergency_stop_read, rig);
    /* While a pin with an external interrupt is low simavr looks at it in each cycle, even if the
     * interrupt is off: a thousandth of the speed with servos at the pins. Its reset turns that on. */
    find_module(rig->avr, "extint")->reset = NULL;
    for (unsigned number = 0; number < EXTINT_COUNT; number++)
        avr_extint_set_strict_lvl_trig(rig->avr, number, 0);
}

size_t rig_take_edges(rig_t *rig, rig_edge_t *out, size_t room) {
    return log_take(&rig->pins.edges, out, room);
}
