// The only part of a C++ runtime that pure virtual functions need; avr-gcc has none.

#include <avr/interrupt.h>

/// Called if an object is used before it is constructed. The watchdog ends it.
extern "C" void __cxa_pure_virtual() {
  cli();
  for (;;) {
  }
}
