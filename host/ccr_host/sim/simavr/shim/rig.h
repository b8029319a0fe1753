/* An Arduino UNO or Mega 2560 in libsimavr, advanced cycle by cycle by the caller: interface for ctypes.
 *
 * This source is under the project's MIT licence. libsimavr is GPL-3, so the shared object linked
 * from both is GPL-3 as a whole: it is built on the user's machine, only when the simulator is
 * requested, and not distributed.
 */
#pragma once

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

typedef struct rig rig_t;

/* Values are the bits of MCUSR. */
typedef enum {
    RESET_UNKNOWN = 0, /* left by a boot loader that clears the flags */
    RESET_POWER_ON = 1 << 0,
    RESET_EXTERNAL = 1 << 1,
    RESET_BROWN_OUT = 1 << 2,
    RESET_WATCHDOG = 1 << 3,
} rig_reset_cause_t;

/* The pins of the axes, in their order, of which an UNO has two, and two outputs. */
enum {
    RIG_SERVO_PINS = 12,
    RIG_SERVO_SUPPLY = RIG_SERVO_PINS,
    RIG_LED,
    RIG_PINS
};

/* An edge at a pin; released (high impedance) counts as low. */
typedef struct {
    uint64_t cycle;
    uint8_t pin;
    uint8_t level;
} rig_edge_t;

/* A byte sent by the board: from the falling edge of its start bit to the end of its stop bit. */
typedef struct {
    uint64_t start_cycle;
    uint64_t end_cycle;
    uint8_t value;
} rig_departure_t;

typedef struct {
    uint16_t address;
    uint8_t value;
} rig_eeprom_write_t;

enum { RIG_VECTORS = 57 }; /* ATmega2560; the ATmega328P has the first 26 */

typedef struct {
    uint64_t cycle;
    uint64_t slept_cycles;
    uint64_t resets;
    uint64_t overruns;                    /* bytes lost by the receiver */
    uint64_t last_arrival_cycle;          /* end of the last stop bit sent to the board */
    uint64_t interrupts[RIG_VECTORS];     /* served, per vector */
    /* Only while profiling. */
    uint64_t longest_masked_cycles;       /* longest time with the I bit of SREG clear */
    uint32_t longest_masked_pc;           /* where that time started, byte address */
    uint16_t least_stack_pointer;
} rig_statistics_t;

/* A board, "uno" or "mega2560"; null if libsimavr lacks its chip. */
rig_t *rig_new(const char *board);
unsigned rig_servos(const rig_t *rig);
void rig_free(rig_t *rig);

uint32_t rig_flash_size(const rig_t *rig);
uint8_t *rig_flash(rig_t *rig);
void rig_set_reset_vector(rig_t *rig, uint32_t address);
void rig_set_profiling(rig_t *rig, bool on);

void rig_reset(rig_t *rig, rig_reset_cause_t cause);
/* Fill registers and SRAM, whose content is arbitrary after a power-up. */
void rig_fill_sram(rig_t *rig, uint8_t value);

/* Events while running, so that the caller need not fetch empty lists. */
typedef enum {
    RIG_TROUBLE = 1 << 0, /* the program has left flash or SRAM; rig_trouble() gives details */
    RIG_EDGES = 1 << 1,
    RIG_EEPROM_WRITES = 1 << 2,
    RIG_LINE_BUSY = 1 << 3, /* a byte is being transmitted in either direction */
} rig_news_t;

/* Run to `cycle`, excluding events at that cycle; the current instruction is finished. The result
 * does not depend on how the time is divided into calls. Returns bits of rig_news_t. */
unsigned rig_run_until(rig_t *rig, uint64_t cycle);
const char *rig_trouble(const rig_t *rig);

/* The switch between the emergency-stop input and ground; initially closed. */
void rig_open_switch(rig_t *rig, bool open);
/* Voltage at pin A0, mV; the reference is 5000. */
void rig_set_voltage(rig_t *rig, uint32_t voltage_mv);

/* Transmit bytes to the board from `cycle` on, one after the other.
 * `bit_cycles`: length of the sender's bits; 0 for the board's setting. */
void rig_send(rig_t *rig, uint64_t cycle, const uint8_t *bytes, size_t count, uint32_t bit_cycles);
void rig_forget_unsent(rig_t *rig);

/* Each fetches up to `room` of the oldest records and returns their number. */
size_t rig_take_departures(rig_t *rig, rig_departure_t *out, size_t room);
size_t rig_take_edges(rig_t *rig, rig_edge_t *out, size_t room);
size_t rig_take_eeprom_writes(rig_t *rig, rig_eeprom_write_t *out, size_t room);

uint8_t *rig_eeprom(rig_t *rig);
uint32_t rig_eeprom_size(const rig_t *rig);
/* Make later writes to this address have no effect. */
void rig_wear_out_eeprom(rig_t *rig, uint16_t address);

/* Registers, I/O and SRAM by their data address; I/O is read and written without side effects. */
uint8_t *rig_memory(rig_t *rig);
uint32_t rig_memory_size(const rig_t *rig);

void rig_statistics(const rig_t *rig, rig_statistics_t *out);
void rig_forget_statistics(rig_t *rig);
