/* The pins as an oscilloscope would show them. simavr's own pin signals report changes that do
 * not happen, whenever a port is written. */
#include "parts.h"

static const uint8_t PORT_BIT[RIG_PINS] = {
    [RIG_OC1A] = 1, [RIG_OC1B] = 2, [RIG_SERVO_SUPPLY] = 0, [RIG_LED] = 5};

static bool level_of(const rig_t *rig, rig_pin_t pin) {
    const uint8_t bit = 1 << PORT_BIT[pin];
    const uint8_t *data = rig->avr->data;
    if (!(data[REG_DDRB] & bit)) return false;
    const bool is_servo = pin < RIG_SERVO_PINS;
    return is_servo && timer1_drives(rig, pin) ? rig->timer1.output[pin] : (data[REG_PORTB] & bit) != 0;
}

void pins_update(rig_t *rig, uint64_t cycle) {
    for (int pin = 0; pin < RIG_PINS; pin++) {
        const bool level = level_of(rig, pin);
        if (level == rig->pins.level[pin]) continue;
        rig->pins.level[pin] = level;
        log_add(&rig->pins.edges, &(rig_edge_t){.cycle = cycle, .pin = pin, .level = level});
    }
}

static void write_and_update(write_handler_t inner, avr_t *avr, avr_io_addr_t address, uint8_t value,
                             rig_t *rig) {
    inner.call(avr, address, value, inner.param);
    pins_update(rig, avr->cycle);
}

static void port_write(avr_t *avr, avr_io_addr_t address, uint8_t value, void *param) {
    rig_t *rig = param;
    write_and_update(rig->pins.port_write, avr, address, value, rig);
}

static void direction_write(avr_t *avr, avr_io_addr_t address, uint8_t value, void *param) {
    rig_t *rig = param;
    write_and_update(rig->pins.direction_write, avr, address, value, rig);
}

static void toggle_write(avr_t *avr, avr_io_addr_t address, uint8_t value, void *param) {
    rig_t *rig = param;
    write_and_update(rig->pins.toggle_write, avr, address, value, rig);
}

/* Pin 7 is 0 while its switch to ground is closed; the other pins of the port have the level that
 * they are driven or pulled to. */
static uint8_t port_d_read(avr_t *avr, avr_io_addr_t address, void *param) {
    const rig_t *rig = param;
    const uint8_t *data = rig->avr->data;
    const uint8_t switched = rig->pins.switch_open ? 0 : 1 << 7 & ~data[REG_DDRD];
    (void)avr, (void)address;
    return data[REG_PORTD] & ~switched;
}

void rig_open_switch(rig_t *rig, bool open) { rig->pins.switch_open = open; }

void pins_attach(rig_t *rig) {
    rig->pins.edges.record_size = sizeof(rig_edge_t);
    rig->pins.port_write = replace_write(rig->avr, REG_PORTB, port_write, rig);
    rig->pins.direction_write = replace_write(rig->avr, REG_DDRB, direction_write, rig);
    rig->pins.toggle_write = replace_write(rig->avr, REG_PINB, toggle_write, rig);
    replace_read(rig->avr, REG_PIND, port_d_read, rig);
}

size_t rig_take_edges(rig_t *rig, rig_edge_t *out, size_t room) {
    return log_take(&rig->pins.edges, out, room);
}
