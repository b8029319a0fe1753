/* Interfaces between the parts of the rig. See rig.h for licence and purpose. */
#pragma once

#include "rig.h"

#include <avr_adc.h>
#include <avr_eeprom.h>
#include <avr_ioport.h>
#include <avr_timer.h>
#include <avr_uart.h>
#include <avr_watchdog.h>
#include <sim_avr.h>

/* Registers that are at the same data address in both chips (datasheets, Register Summary). */
enum {
    REG_EECR = 0x3F,
    REG_EEARL = 0x41,
    REG_EEARH = 0x42,
    REG_MCUSR = 0x54,
    REG_WDTCSR = 0x60,
    REG_UCSR0A = 0xC0,
    REG_UCSR0B = 0xC1,
    REG_UCSR0C = 0xC2,
    REG_UBRR0L = 0xC4,
    REG_UBRR0H = 0xC5,
    REG_UDR0 = 0xC6,
};

enum { MOST_TIMERS = 4, MOST_CHANNELS = 3, ALL_TIMERS = 6, MOST_PORTS = 5 };

/* A pin: PINx, which DDRx and PORTx follow, and its bit. */
typedef struct {
    avr_io_addr_t port;
    uint8_t bit;
} place_t;

/* What differs between the boards. */
typedef struct {
    const char *board, *mcu;
    unsigned servos;
    place_t pin[RIG_PINS];
    struct {
        uint8_t timer, channel;
    } output[RIG_SERVO_PINS];
    place_t emergency_stop;
    unsigned timers, channels;
    struct {
        char name;
        avr_io_addr_t base; /* TCCRnA */
    } timer[MOST_TIMERS];
    avr_io_addr_t ports[MOST_PORTS]; /* with pins that are watched */
} chip_t;

/* Queue of records to be fetched; grows as needed. */
typedef struct {
    void *records;
    size_t record_size, count, room;
} log_t;

void log_add(log_t *log, const void *record);
size_t log_take(log_t *log, void *out, size_t room);

typedef struct {
    avr_io_write_t call;
    void *param;
} write_handler_t;

/* simavr refuses to replace its own handlers, so its table is written directly. */
write_handler_t replace_write(avr_t *avr, avr_io_addr_t address, avr_io_write_t call, void *param);
void replace_read(avr_t *avr, avr_io_addr_t address, avr_io_read_t call, void *param);

/* Call `again` each time the service routine of `vector` has returned. */
void on_return_from(avr_int_vector_t *vector, avr_irq_notify_t again, void *param);
/* A flag that requests its interrupt while it is set. */
void set_level_flag(avr_t *avr, avr_int_vector_t *vector, bool active);

/* The line to the board: one byte in transmission, the rest queued. */
typedef struct {
    uint8_t *bytes;
    uint32_t *bit_cycles;
    size_t next, count, room;
    bool busy;
    uint8_t value;
    uint64_t end_cycle;
    bool garbled, heard;
} wire_t;

enum { RECEIVE_BUFFER = 2 };

typedef struct {
    uint8_t value;
    bool frame_error;
} received_t;

typedef struct {
    avr_uart_t *vectors;
    wire_t wire;
    received_t buffer[RECEIVE_BUFFER];
    unsigned buffered;
    received_t shift;
    bool shift_full, overrun;
    uint32_t peer_bit_cycles;
    bool sending, send_buffer_full;
    uint8_t sending_value, send_buffer;
    uint64_t send_end_cycle;
    log_t departures;
} uart_t;

typedef struct {
    rig_t *rig;
    char name;
    avr_io_addr_t base;
    unsigned channels;
    avr_timer_t *vectors;
    uint32_t prescaler;          /* 0: stopped */
    uint64_t base_cycle;         /* when the counter was 0 */
    uint16_t held;               /* the counter while it is stopped */
    uint16_t written[MOST_CHANNELS];
    uint16_t compare[MOST_CHANNELS];
    bool output[MOST_CHANNELS];  /* of the waveform generators, whether connected to a pin or not */
} timer16_t;

typedef struct {
    rig_t *rig;
    write_handler_t inner;
} port_hook_t;

typedef struct {
    bool level[RIG_PINS];
    bool switch_open;
    port_hook_t hooks[MOST_PORTS][3];
    log_t edges;
} pins_t;

typedef struct {
    avr_eeprom_t *memory;
    write_handler_t control_write;
    bool busy;
    uint8_t *worn_out;
    log_t writes;
} eeprom_t;

typedef struct {
    bool on, masked, stack_pointer_split;
    uint64_t masked_since;
    uint32_t masked_pc;
} profile_t;

struct rig {
    avr_io_t module; /* first, so that simavr's callback leads here; is notified of resets */
    avr_t *avr;
    const chip_t *chip;
    uint64_t stop_cycle;
    uart_t uart;
    timer16_t timers[MOST_TIMERS];
    pins_t pins;
    eeprom_t eeprom;
    write_handler_t watchdog_write;
    profile_t profile;
    rig_statistics_t statistics;
    char trouble[256];
};

rig_t *rig_of(avr_t *avr);
avr_io_t *find_module(avr_t *avr, const char *kind);
avr_timer_t *find_timer(avr_t *avr, char name);

void uart_attach(rig_t *rig);
void uart_reset(rig_t *rig);
void uart_free(rig_t *rig);
/* Whether a byte is being transmitted in either direction. */
bool uart_is_busy(const rig_t *rig);

/* The board of this name, or null. */
const chip_t *find_chip(const char *board);

void timers16_attach(rig_t *rig);
void timers16_reset(rig_t *rig);
/* Whether a waveform generator drives its pin instead of the port. */
bool timer16_drives(const timer16_t *timer, unsigned channel);

void timer_flags_attach(avr_t *avr);

void pins_attach(rig_t *rig);
/* Update the levels of the pins. */
void pins_update(rig_t *rig, uint64_t cycle);

void eeprom_attach(rig_t *rig);
void eeprom_reset(rig_t *rig);
void eeprom_free(rig_t *rig);

void watchdog_attach(rig_t *rig);
