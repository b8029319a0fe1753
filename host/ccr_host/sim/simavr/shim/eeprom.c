/* EEPROM that is busy during a write; simavr's writes take no time. */
#include "parts.h"

#include <stdlib.h>

enum {
    EECR_EERIE = 1 << 3,
    EECR_EEMPE = 1 << 2,
    EECR_EEPE = 1 << 1,
    WRITE_CYCLES = 54400, /* 3.4 ms, datasheet "EEPROM Programming Time" */
};

static void update_ready_flag(rig_t *rig) {
    const eeprom_t *eeprom = &rig->eeprom;
    set_level_flag(rig->avr, &eeprom->memory->ready, !eeprom->busy);
}

static void service_routine_returned(avr_irq_t *irq, uint32_t running, void *param) {
    (void)irq;
    if (!running) update_ready_flag(param);
}

static avr_cycle_count_t written(avr_t *avr, avr_cycle_count_t when, void *param) {
    rig_t *rig = param;
    (void)when;
    rig->eeprom.busy = false;
    avr->data[REG_EECR] &= ~EECR_EEPE;
    update_ready_flag(rig);
    return 0;
}

static uint16_t addressed(const rig_t *rig) {
    const uint8_t *data = rig->avr->data;
    return (data[REG_EEARL] | data[REG_EEARH] << 8) % rig->eeprom.memory->size;
}

static void start_write(rig_t *rig, uint8_t before) {
    eeprom_t *eeprom = &rig->eeprom;
    avr_t *avr = rig->avr;
    const uint16_t address = addressed(rig);
    if (eeprom->worn_out[address]) eeprom->memory->eeprom[address] = before;
    log_add(&eeprom->writes,
            &(rig_eeprom_write_t){.address = address, .value = eeprom->memory->eeprom[address]});
    eeprom->busy = true;
    avr->data[REG_EECR] |= EECR_EEPE;
    avr_cycle_timer_register(avr, WRITE_CYCLES, written, rig);
}

static void control_write(avr_t *avr, avr_io_addr_t address, uint8_t value, void *param) {
    rig_t *rig = param;
    eeprom_t *eeprom = &rig->eeprom;
    const bool enabled = avr->data[REG_EECR] & EECR_EEMPE;
    const uint8_t before = eeprom->memory->eeprom[addressed(rig)];
    if (eeprom->busy) {
        avr->data[address] = (value & EECR_EERIE) | EECR_EEPE;
        return;
    }
    /* Missing address bits read as 0 on the chip; simavr would access memory beyond its EEPROM. */
    avr->data[REG_EEARH] &= (eeprom->memory->size - 1) >> 8;
    eeprom->control_write.call(avr, address, value, eeprom->control_write.param);
    if (enabled && value & EECR_EEPE) start_write(rig, before);
    update_ready_flag(rig);
}

void eeprom_attach(rig_t *rig) {
    eeprom_t *eeprom = &rig->eeprom;
    eeprom->memory = (avr_eeprom_t *)find_module(rig->avr, "eeprom");
    eeprom->worn_out = calloc(eeprom->memory->size, 1);
    eeprom->writes.record_size = sizeof(rig_eeprom_write_t);
    eeprom->control_write = replace_write(rig->avr, REG_EECR, control_write, rig);
    on_return_from(&eeprom->memory->ready, service_routine_returned, rig);
}

void eeprom_reset(rig_t *rig) { rig->eeprom.busy = false; }

void eeprom_free(rig_t *rig) {
    free(rig->eeprom.worn_out);
    free(rig->eeprom.writes.records);
}

uint8_t *rig_eeprom(rig_t *rig) { return rig->eeprom.memory->eeprom; }
uint32_t rig_eeprom_size(const rig_t *rig) { return rig->eeprom.memory->size; }
void rig_wear_out_eeprom(rig_t *rig, uint16_t address) {
    rig->eeprom.worn_out[address % rig->eeprom.memory->size] = 1;
}

size_t rig_take_eeprom_writes(rig_t *rig, rig_eeprom_write_t *out, size_t room) {
    return log_take(&rig->eeprom.writes, out, room);
}
