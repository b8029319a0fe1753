// CRC-16/X-25, as in HDLC and PPP: reflected 0x1021, starts at 0xFFFF, inverted at the end.
#ifndef CCR_CRC16_X25_H
#define CCR_CRC16_X25_H

#include <stdint.h>

namespace ccr {

class Crc16X25 {
 public:
  // Eight steps of the polynomial at once: the byte acts as itself and three shifted copies. Its
  // nibbles are swapped instead of shifted, which an AVR does in one cycle. Always inlined, even if
  // optimised for size: a call would double the time per byte.
  __attribute__((always_inline)) void add(uint8_t byte) {
    const uint8_t difference = static_cast<uint8_t>(byte ^ low_);
    const uint8_t mix = static_cast<uint8_t>(difference ^ (swap_halves(difference) & 0xF0));
    const uint8_t quarter = swap_halves(mix) & 0x0F;
    low_ = static_cast<uint8_t>(high_ ^ quarter ^ static_cast<uint8_t>(mix << 3));
    high_ = static_cast<uint8_t>(mix ^ (quarter >> 1));
  }

  uint16_t value() const { return static_cast<uint16_t>(~(static_cast<uint16_t>(high_) << 8 | low_)); }

  /// After the data and their CRC, low byte first: whether they were good.
  bool is_residue() const { return high_ == (kResidue >> 8) && low_ == (kResidue & 0xFF); }

 private:
  static constexpr uint16_t kResidue = 0xF0B8;

  static uint8_t swap_halves(uint8_t byte) {
    return static_cast<uint8_t>(byte << 4 | byte >> 4);
  }

  uint8_t low_ = 0xFF;
  uint8_t high_ = 0xFF;
};

}  // namespace ccr

#endif
