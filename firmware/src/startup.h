// Initialisation that must happen before variables are set up.
#ifndef CCR_AVR_STARTUP_H
#define CCR_AVR_STARTUP_H

#include <stdint.h>

namespace avr {

/// MCUSR at the start; 0 if a boot loader has cleared it.
uint8_t reset_flags_found();

}  // namespace avr

#endif
