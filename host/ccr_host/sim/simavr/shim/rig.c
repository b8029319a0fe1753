#include "parts.h"

#include <sim_core.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

enum {
    CLOCK_HZ = 16000000,
    SUPPLY_MV = 5000,
    UNLIMITED_CYCLES = 1000000, /* simavr's default of 1 steps every instruction, 10 times slower */
    /* Datasheet, "Interrupt Response Time"; in simavr interrupts take no time. */
    RESPONSE_CYCLES = 4,
    WAKE_UP_CYCLES = 4,
    DATA_SPACE = 1 << 16,
    PROGRAM_SPACE = 1 << 19,
    OPCODE_OUT_SPH = 0xBE0E,
    OPCODE_OUT_SPL = 0xBE0D,
    OPCODE_OUT_MASK = 0xFE0F,
};

rig_t *rig_of(avr_t *avr) { return avr ? avr->custom.data : NULL; }

write_handler_t replace_write(avr_t *avr, avr_io_addr_t address, avr_io_write_t call, void *param) {
    const avr_io_addr_t io = AVR_DATA_TO_IO(address);
    const write_handler_t before = {avr->io[io].w.c, avr->io[io].w.param};
    avr->io[io].w.c = call;
    avr->io[io].w.param = param;
    return before;
}

void replace_read(avr_t *avr, avr_io_addr_t address, avr_io_read_t call, void *param) {
    const avr_io_addr_t io = AVR_DATA_TO_IO(address);
    avr->io[io].r.c = call;
    avr->io[io].r.param = param;
}

void on_return_from(avr_int_vector_t *vector, avr_irq_notify_t again, void *param) {
    avr_irq_register_notify(&vector->irq[AVR_INT_IRQ_RUNNING], again, param);
}

void set_level_flag(avr_t *avr, avr_int_vector_t *vector, bool active) {
    if (active) {
        avr_raise_interrupt(avr, vector);
        return;
    }
    vector->pending = 0;
    if (vector->raised.reg) avr_regbit_clear(avr, vector->raised);
}

avr_io_t *find_module(avr_t *avr, const char *kind) {
    avr_io_t *module = avr->io_port;
    while (module && strcmp(module->kind, kind) != 0) module = module->next;
    return module;
}

avr_timer_t *find_timer(avr_t *avr, char name) {
    for (avr_io_t *module = avr->io_port; module; module = module->next)
        if (strcmp(module->kind, "timer") == 0 && ((avr_timer_t *)module)->name == name)
            return (avr_timer_t *)module;
    return NULL;
}

static void keep_first_error(avr_t *avr, const int level, const char *format, va_list arguments) {
    rig_t *rig = rig_of(avr);
    if (!rig || level != LOG_ERROR || rig->trouble[0]) return;
    vsnprintf(rig->trouble, sizeof rig->trouble, format, arguments);
}

/* Running */

static avr_cycle_count_t stop(avr_t *avr, avr_cycle_count_t when, void *param) {
    (void)avr, (void)when, (void)param;
    return 0;
}

static void arrange_stop(rig_t *rig) {
    const uint64_t now = rig->avr->cycle;
    if (rig->stop_cycle > now) avr_cycle_timer_register(rig->avr, rig->stop_cycle - now, stop, rig);
}

static uint16_t opcode_at(const avr_t *avr, avr_flashaddr_t pc) {
    if (pc >= avr->flashend) return 0; /* simavr reports such a jump in its next step */
    return avr->flash[pc] | avr->flash[pc + 1] << 8;
}

/* The stack pointer is invalid between the writes of its halves; avr-gcc writes SPH first. */
static void watch_stack(rig_t *rig, uint16_t opcode) {
    const avr_t *avr = rig->avr;
    const uint16_t pointer = avr->data[R_SPL] | avr->data[R_SPH] << 8;
    if ((opcode & OPCODE_OUT_MASK) == OPCODE_OUT_SPH) rig->profile.stack_pointer_split = true;
    if ((opcode & OPCODE_OUT_MASK) == OPCODE_OUT_SPL) rig->profile.stack_pointer_split = false;
    if (!rig->profile.stack_pointer_split && pointer < rig->statistics.least_stack_pointer)
        rig->statistics.least_stack_pointer = pointer;
}

static void watch_mask(rig_t *rig) {
    const avr_t *avr = rig->avr;
    profile_t *profile = &rig->profile;
    const bool masked = !avr->sreg[S_I];
    if (masked == profile->masked) return;
    profile->masked = masked;
    if (masked) {
        profile->masked_since = avr->cycle;
        profile->masked_pc = avr->pc;
        return;
    }
    const uint64_t cycles = avr->cycle - profile->masked_since;
    if (cycles <= rig->statistics.longest_masked_cycles) return;
    rig->statistics.longest_masked_cycles = cycles;
    rig->statistics.longest_masked_pc = profile->masked_pc;
}

static void serve_interrupt(rig_t *rig, bool woken) {
    avr_t *avr = rig->avr;
    const uint8_t nested = avr->interrupts.running_ptr;
    avr_service_interrupts(avr);
    if (avr->interrupts.running_ptr == nested) return;
    rig->statistics.interrupts[avr->interrupts.running[nested]->vector % RIG_VECTORS]++;
    if (rig->profile.on) watch_mask(rig);
    avr->cycle += RESPONSE_CYCLES + (woken ? WAKE_UP_CYCLES : 0);
    avr_cycle_timer_process(avr);
}

/* Replaces simavr's step, which sleeps one cycle too long, ends at a sleep with interrupts off (from
 * which a watchdog or a reset can still wake), and serves interrupts in no time. */
static void step(avr_t *avr) {
    rig_t *rig = rig_of(avr);
    const uint16_t opcode = opcode_at(avr, avr->pc);
    avr_flashaddr_t next_pc = avr->pc;
    if (avr->state == cpu_Running) next_pc = avr_run_one(avr);
    const bool slept = avr->state == cpu_Sleeping;
    const avr_cycle_count_t idle = avr_cycle_timer_process(avr);
    avr->pc = next_pc;
    if (avr->run != step) { /* the watchdog has expired and stored its reset there */
        avr->run(avr);
        return;
    }
    if (rig->profile.on) {
        watch_stack(rig, opcode);
        watch_mask(rig);
    }
    if (avr->state == cpu_Sleeping) {
        avr->cycle += idle;
        rig->statistics.slept_cycles += idle;
    } else if (avr->interrupt_state) {
        serve_interrupt(rig, slept);
    }
}

static unsigned news(const rig_t *rig) {
    return (rig->trouble[0] ? RIG_TROUBLE : 0) | (rig->pins.edges.count ? RIG_EDGES : 0) |
           (rig->eeprom.writes.count ? RIG_EEPROM_WRITES : 0) |
           (uart_is_busy(rig) ? RIG_LINE_BUSY : 0);
}

unsigned rig_run_until(rig_t *rig, uint64_t cycle) {
    avr_t *avr = rig->avr;
    rig->stop_cycle = cycle;
    arrange_stop(rig);
    while (avr->cycle < cycle && !rig->trouble[0]) avr->run(avr);
    return news(rig);
}

const char *rig_trouble(const rig_t *rig) { return rig->trouble; }

void rig_set_profiling(rig_t *rig, bool on) {
    rig->profile.on = on;
    rig->profile.masked = !rig->avr->sreg[S_I];
    rig->profile.masked_since = rig->avr->cycle;
    rig->avr->run_cycle_limit = rig->avr->run_cycle_count = 1;
    if (!on) rig->avr->run_cycle_limit = UNLIMITED_CYCLES;
}

/* Resets */

static void module_reset(avr_io_t *module) {
    rig_t *rig = (rig_t *)module;
    rig->statistics.resets++;
    uart_reset(rig);
    timers16_reset(rig);
    eeprom_reset(rig);
    pins_update(rig, rig->avr->cycle);
    rig->profile.stack_pointer_split = false;
    rig_set_profiling(rig, rig->profile.on);
    arrange_stop(rig);
}

void rig_reset(rig_t *rig, rig_reset_cause_t cause) {
    avr_t *avr = rig->avr;
    avr_watchdog_t *watchdog = (avr_watchdog_t *)find_module(avr, "watchdog");
    const uint8_t flags_before = cause == RESET_POWER_ON ? 0 : avr->data[REG_MCUSR];
    if (cause == RESET_WATCHDOG) {
        watchdog->reset_context.wdrf = 1;
        watchdog->reset_context.avr_run = step;
    }
    avr->run = step;
    avr_reset(avr);
    avr->data[REG_MCUSR] = flags_before | cause;
}

void rig_fill_sram(rig_t *rig, uint8_t value) {
    avr_t *avr = rig->avr;
    memset(avr->data, value, 32);
    memset(avr->data + avr->ioend + 1, value, avr->ramend - avr->ioend);
}

/* simavr reports an access beyond the end of a memory, but still executes it. */
static uint8_t *with_room_for_any_address(uint8_t *memory, size_t size, size_t addresses) {
    uint8_t *roomy = realloc(memory, addresses);
    memset(roomy + size, 0xFF, addresses - size);
    return roomy;
}

rig_t *rig_new(const char *board) {
    rig_t *rig = calloc(1, sizeof *rig);
    avr_global_logger_set(keep_first_error);
    rig->chip = find_chip(board);
    avr_t *avr = rig->avr = rig->chip ? avr_make_mcu_by_name(rig->chip->mcu) : NULL;
    if (!avr) {
        free(rig);
        return NULL;
    }
    avr->custom.data = rig;
    avr_init(avr);
    avr->data = with_room_for_any_address(avr->data, avr->ramend + 1, DATA_SPACE);
    /* After the end simavr stores an opcode that catches a program running past it. */
    avr->flash = with_room_for_any_address(avr->flash, avr->flashend + 3, PROGRAM_SPACE);
    avr->log = LOG_ERROR;
    avr->frequency = CLOCK_HZ;
    avr->vcc = avr->avcc = avr->aref = SUPPLY_MV;
    avr->run = step;
    rig->module.kind = "rig";
    rig->module.reset = module_reset;
    avr_register_io(avr, &rig->module);
    rig->statistics.least_stack_pointer = avr->ramend;
    uart_attach(rig);
    timers16_attach(rig);
    timer_flags_attach(avr);
    pins_attach(rig);
    eeprom_attach(rig);
    watchdog_attach(rig);
    return rig;
}

void rig_free(rig_t *rig) {
    uart_free(rig);
    eeprom_free(rig);
    free(rig->pins.edges.records);
    avr_terminate(rig->avr);
    free(rig->avr);
    free(rig);
}

/* Memories and figures */

unsigned rig_servos(const rig_t *rig) { return rig->chip->servos; }
uint32_t rig_flash_size(const rig_t *rig) { return rig->avr->flashend + 1; }
uint8_t *rig_flash(rig_t *rig) { return rig->avr->flash; }
uint32_t rig_memory_size(const rig_t *rig) { return rig->avr->ramend + 1; }
uint8_t *rig_memory(rig_t *rig) { return rig->avr->data; }
void rig_set_reset_vector(rig_t *rig, uint32_t address) { rig->avr->reset_pc = address; }

void rig_set_voltage(rig_t *rig, uint32_t voltage_mv) {
    avr_raise_irq(avr_io_getirq(rig->avr, AVR_IOCTL_ADC_GETIRQ, ADC_IRQ_ADC0), voltage_mv);
}

void rig_statistics(const rig_t *rig, rig_statistics_t *out) {
    *out = rig->statistics;
    out->cycle = rig->avr->cycle;
}

void rig_forget_statistics(rig_t *rig) {
    const uint64_t last_arrival_cycle = rig->statistics.last_arrival_cycle;
    rig->statistics = (rig_statistics_t){.last_arrival_cycle = last_arrival_cycle};
    rig->statistics.least_stack_pointer = rig->avr->ramend;
    rig->profile.masked_since = rig->avr->cycle;
}
