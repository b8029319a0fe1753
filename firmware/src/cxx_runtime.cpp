// The one thing that pure virtual functions need of a C++ runtime, which avr-gcc comes without.

#include <avr/interrupt.h>

/// Called where an object is used before it is made. The watchdog ends it.
extern "C" void __cxa_pure_virtual() {
  cli();
  for (;;) {
  }
}
