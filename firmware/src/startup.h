// What has to happen before variables are set up.
#ifndef CCR_UNO_STARTUP_H
#define CCR_UNO_STARTUP_H

#include <stdint.h>

namespace uno {

/// MCUSR as it was found; 0 where a boot loader has cleared it.
uint8_t reset_flags_found();

}  // namespace uno

#endif
