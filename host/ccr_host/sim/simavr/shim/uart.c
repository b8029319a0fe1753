/* Replaces simavr's USART0, whose bytes last 11 bits, whose receiver holds 64 bytes, and whose
 * transmitter may wait for the time of a byte before it starts. 8N1 only; PRR, parity and MPCM have no effect.
 */
#include "parts.h"

#include <stdlib.h>
#include <string.h>

enum {
    UCSRA_RXC = 1 << 7,
    UCSRA_TXC = 1 << 6,
    UCSRA_UDRE = 1 << 5,
    UCSRA_FE = 1 << 4,
    UCSRA_DOR = 1 << 3,
    UCSRA_U2X = 1 << 1,
    UCSRA_MPCM = 1 << 0,
    UCSRB_RXEN = 1 << 4,
    UCSRB_TXEN = 1 << 3,
    UCSRC_8_BITS = 3 << 1,
    BITS_PER_BYTE = 10,
    /* Datasheet, "Recommended Maximum Receiver Baud Rate Error", 8 data bits: +-4 % is the limit. */
    GREATEST_BAUD_ERROR_PERCENT = 4,
};

static uint32_t own_bit_cycles(const avr_t *avr) {
    const uint32_t divisor = (avr->data[REG_UBRR0H] & 0x0F) << 8 | avr->data[REG_UBRR0L];
    return (divisor + 1) * (avr->data[REG_UCSR0A] & UCSRA_U2X ? 8 : 16);
}

static bool bauds_differ(uint32_t one, uint32_t other) {
    const uint32_t difference = one > other ? one - other : other - one;
    return 100 * difference > GREATEST_BAUD_ERROR_PERCENT * other;
}

static void update_flags(rig_t *rig) {
    uart_t *uart = &rig->uart;
    avr_t *avr = rig->avr;
    uint8_t status = avr->data[REG_UCSR0A] & (UCSRA_TXC | UCSRA_U2X | UCSRA_MPCM);
    if (uart->buffered) {
        status |= UCSRA_RXC;
        if (uart->buffer[0].frame_error) status |= UCSRA_FE;
    }
    if (uart->overrun) status |= UCSRA_DOR;
    if (!uart->send_buffer_full) status |= UCSRA_UDRE;
    avr->data[REG_UCSR0A] = status;
    set_level_flag(avr, &uart->vectors->rxc, uart->buffered > 0);
    set_level_flag(avr, &uart->vectors->udrc, !uart->send_buffer_full);
}

static void service_routine_returned(avr_irq_t *irq, uint32_t running, void *param) {
    (void)irq;
    if (!running) update_flags(param);
}

/* Receiver */

static void move_into_buffer(uart_t *uart) {
    if (!uart->shift_full || uart->buffered == RECEIVE_BUFFER) return;
    uart->buffer[uart->buffered++] = uart->shift;
    uart->shift_full = false;
    uart->overrun = false;
}

/* A third byte waits in the shift register and is lost only to the next start bit. */
static void hear_start_bit(rig_t *rig) {
    uart_t *uart = &rig->uart;
    if (!uart->shift_full) return;
    uart->shift_full = false;
    uart->overrun = true;
    rig->statistics.overruns++;
    update_flags(rig);
}

static void start_next_byte(rig_t *rig, uint64_t cycle) {
    wire_t *wire = &rig->uart.wire;
    const uint32_t own = own_bit_cycles(rig->avr);
    const uint32_t peer = wire->bit_cycles[wire->next];
    const uint32_t bit_cycles = peer ? peer : own;
    wire->busy = true;
    wire->value = wire->bytes[wire->next++];
    wire->end_cycle = cycle + BITS_PER_BYTE * (uint64_t)bit_cycles;
    wire->garbled = bauds_differ(bit_cycles, own);
    wire->heard = rig->avr->data[REG_UCSR0B] & UCSRB_RXEN;
    rig->uart.peer_bit_cycles = peer;
    if (wire->heard) hear_start_bit(rig);
}

static avr_cycle_count_t byte_has_arrived(avr_t *avr, avr_cycle_count_t when, void *param) {
    rig_t *rig = param;
    uart_t *uart = &rig->uart;
    wire_t *wire = &uart->wire;
    wire->busy = false;
    rig->statistics.last_arrival_cycle = when;
    if (wire->heard && avr->data[REG_UCSR0B] & UCSRB_RXEN) {
        const uint8_t noise = wire->garbled ? 0xFF : 0;
        uart->shift = (received_t){.value = wire->value ^ noise, .frame_error = wire->garbled};
        uart->shift_full = true;
        move_into_buffer(uart);
        update_flags(rig);
    }
    if (wire->next == wire->count) return 0;
    start_next_byte(rig, when);
    return wire->end_cycle;
}

static void listen_to_wire(rig_t *rig) {
    const wire_t *wire = &rig->uart.wire;
    const uint64_t now = rig->avr->cycle;
    const uint64_t wait = wire->end_cycle > now ? wire->end_cycle - now : 0;
    avr_cycle_timer_register(rig->avr, wait, byte_has_arrived, rig);
}

void rig_send(rig_t *rig, uint64_t cycle, const uint8_t *bytes, size_t count, uint32_t bit_cycles) {
    wire_t *wire = &rig->uart.wire;
    if (count == 0) return;
    if (wire->next == wire->count) wire->next = wire->count = 0;
    if (wire->count + count > wire->room) {
        wire->room = 2 * (wire->count + count);
        wire->bytes = realloc(wire->bytes, wire->room);
        wire->bit_cycles = realloc(wire->bit_cycles, wire->room * sizeof *wire->bit_cycles);
    }
    memcpy(wire->bytes + wire->count, bytes, count);
    for (size_t i = 0; i < count; i++) wire->bit_cycles[wire->count + i] = bit_cycles;
    wire->count += count;
    if (wire->busy) return;
    start_next_byte(rig, cycle > wire->end_cycle ? cycle : wire->end_cycle);
    listen_to_wire(rig);
}

void rig_forget_unsent(rig_t *rig) { rig->uart.wire.next = rig->uart.wire.count = 0; }

static void silence_receiver(uart_t *uart) {
    uart->buffered = 0;
    uart->shift_full = false;
    uart->overrun = false;
}

static uint8_t data_read(avr_t *avr, avr_io_addr_t address, void *param) {
    rig_t *rig = param;
    uart_t *uart = &rig->uart;
    (void)avr, (void)address;
    if (uart->buffered == 0) return 0;
    const uint8_t value = uart->buffer[0].value;
    uart->buffer[0] = uart->buffer[1];
    uart->buffered--;
    move_into_buffer(uart);
    update_flags(rig);
    return value;
}

/* Transmitter */

static avr_cycle_count_t byte_has_left(avr_t *avr, avr_cycle_count_t when, void *param);

static void start_sending(rig_t *rig, uint64_t cycle, uint8_t value) {
    uart_t *uart = &rig->uart;
    uart->sending = true;
    uart->sending_value = value;
    uart->send_end_cycle = cycle + BITS_PER_BYTE * (uint64_t)own_bit_cycles(rig->avr);
}

static avr_cycle_count_t byte_has_left(avr_t *avr, avr_cycle_count_t when, void *param) {
    rig_t *rig = param;
    uart_t *uart = &rig->uart;
    const uint32_t own = own_bit_cycles(avr);
    const bool garbled = uart->peer_bit_cycles && bauds_differ(own, uart->peer_bit_cycles);
    log_add(&uart->departures, &(rig_departure_t){
        .start_cycle = when - BITS_PER_BYTE * (uint64_t)own,
        .end_cycle = when,
        .value = uart->sending_value ^ (garbled ? 0xFF : 0),
    });
    uart->sending = false;
    if (uart->send_buffer_full) {
        uart->send_buffer_full = false;
        start_sending(rig, when, uart->send_buffer);
        update_flags(rig);
        return uart->send_end_cycle;
    }
    avr_raise_interrupt(avr, &uart->vectors->txc);
    return 0;
}

static void data_write(avr_t *avr, avr_io_addr_t address, uint8_t value, void *param) {
    rig_t *rig = param;
    uart_t *uart = &rig->uart;
    (void)address;
    if (!(avr->data[REG_UCSR0B] & UCSRB_TXEN) || uart->send_buffer_full) return;
    if (uart->sending) {
        uart->send_buffer = value;
        uart->send_buffer_full = true;
    } else {
        start_sending(rig, avr->cycle, value);
        avr_cycle_timer_register(avr, uart->send_end_cycle - avr->cycle, byte_has_left, rig);
    }
    update_flags(rig);
}

/* Control */

static void status_write(avr_t *avr, avr_io_addr_t address, uint8_t value, void *param) {
    rig_t *rig = param;
    const uint8_t writable = UCSRA_U2X | UCSRA_MPCM;
    if (value & UCSRA_TXC) avr_clear_interrupt(avr, &rig->uart.vectors->txc);
    avr->data[address] = (avr->data[address] & ~writable) | (value & writable);
}

static void control_write(avr_t *avr, avr_io_addr_t address, uint8_t value, void *param) {
    rig_t *rig = param;
    avr->data[address] = value;
    if (!(value & UCSRB_RXEN)) silence_receiver(&rig->uart);
    if (avr->data[REG_UCSR0A] & UCSRA_TXC) avr_raise_interrupt(avr, &rig->uart.vectors->txc);
    update_flags(rig);
}

static void plain_write(avr_t *avr, avr_io_addr_t address, uint8_t value, void *param) {
    (void)param;
    avr->data[address] = value;
}

/* A Mega has four. */
static avr_uart_t *find_first_uart(avr_t *avr) {
    for (avr_io_t *module = avr->io_port; module; module = module->next)
        if (strcmp(module->kind, "uart") == 0 && ((avr_uart_t *)module)->name == '0')
            return (avr_uart_t *)module;
    return NULL;
}

void uart_attach(rig_t *rig) {
    avr_t *avr = rig->avr;
    uart_t *uart = &rig->uart;
    uart->vectors = find_first_uart(avr);
    uart->vectors->io.reset = NULL;
    uart->departures.record_size = sizeof(rig_departure_t);
    replace_read(avr, REG_UDR0, data_read, rig);
    replace_read(avr, REG_UCSR0A, NULL, NULL);
    replace_write(avr, REG_UDR0, data_write, rig);
    replace_write(avr, REG_UCSR0A, status_write, rig);
    replace_write(avr, REG_UCSR0B, control_write, rig);
    replace_write(avr, REG_UBRR0L, plain_write, rig);
    on_return_from(&uart->vectors->rxc, service_routine_returned, rig);
    on_return_from(&uart->vectors->udrc, service_routine_returned, rig);
}

void uart_reset(rig_t *rig) {
    uart_t *uart = &rig->uart;
    silence_receiver(uart);
    uart->sending = false;
    uart->send_buffer_full = false;
    rig->avr->data[REG_UCSR0C] = UCSRC_8_BITS;
    update_flags(rig);
    if (uart->wire.busy) {
        uart->wire.heard = false;
        listen_to_wire(rig);
    }
}

void uart_free(rig_t *rig) {
    free(rig->uart.wire.bytes);
    free(rig->uart.wire.bit_cycles);
    free(rig->uart.departures.records);
}

bool uart_is_busy(const rig_t *rig) { return rig->uart.wire.busy || rig->uart.sending; }

size_t rig_take_departures(rig_t *rig, rig_departure_t *out, size_t room) {
    return log_take(&rig->uart.departures, out, room);
}
