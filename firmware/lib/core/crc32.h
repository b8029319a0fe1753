// CRC-32 (ISO-HDLC, as in zip and Ethernet). Bit by bit: it only sees EEPROM, a byte a tick.
#ifndef CCR_CRC32_H
#define CCR_CRC32_H

#include <stdint.h>

namespace ccr {

class Crc32 {
 public:
  void add(uint8_t byte) {
    remainder_ ^= byte;
    for (uint8_t bit = 0; bit < 8; ++bit) {
      const bool carry = (remainder_ & 1U) != 0;
      remainder_ >>= 1;
      if (carry) {
        remainder_ ^= kReflectedPolynomial;
      }
    }
  }

  uint32_t value() const { return ~remainder_; }

 private:
  static constexpr uint32_t kReflectedPolynomial = 0xEDB88320UL;

  uint32_t remainder_ = 0xFFFFFFFFUL;
};

}  // namespace ccr

#endif
