/* A new time-out takes effect when it is set; simavr keeps the old one until the next WDR. */
#include "parts.h"

static void control_write(avr_t *avr, avr_io_addr_t address, uint8_t value, void *param) {
    rig_t *rig = param;
    const avr_watchdog_t *watchdog = (avr_watchdog_t *)find_module(avr, "watchdog");
    const uint64_t cycles_before = watchdog->cycle_count;
    const write_handler_t inner = rig->watchdog_write;
    inner.call(avr, address, value, inner.param);
    if (watchdog->cycle_count != cycles_before) avr_ioctl(avr, AVR_IOCTL_WATCHDOG_RESET, NULL);
}

void watchdog_attach(rig_t *rig) {
    rig->watchdog_write = replace_write(rig->avr, REG_WDTCSR, control_write, rig);
}
