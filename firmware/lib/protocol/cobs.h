// Consistent Overhead Byte Stuffing of short frames, byte by byte.
#ifndef CCR_COBS_H
#define CCR_COBS_H

#include <stdint.h>

namespace ccr {

/// Largest data size; longer data would need a second code byte, which is not implemented.
constexpr uint8_t kCobsMaxData = 253;

/// Encodes in place: `size` data bytes at `encoded + 1`, with room for one byte after them. Returns
/// the size including the closing zero.
inline uint8_t encode_cobs(uint8_t* encoded, uint8_t size) {
  const uint8_t end = static_cast<uint8_t>(size + 1);
  uint8_t code_at = 0;
  for (uint8_t at = 1; at < end; ++at) {
    if (encoded[at] == 0) {
      encoded[code_at] = static_cast<uint8_t>(at - code_at);
      code_at = at;
    }
  }
  encoded[code_at] = static_cast<uint8_t>(end - code_at);
  encoded[end] = 0;
  return static_cast<uint8_t>(end + 1);
}

/// Decodes the bytes of one frame, excluding its zero.
class CobsReader {
 public:
  /// Processes the first byte of a frame, which is not data.
  void begin(uint8_t code) { left_in_block_ = static_cast<uint8_t>(code - 1); }

  /// Processes any further byte and returns the decoded data byte.
  uint8_t next(uint8_t byte) {
    if (left_in_block_ == 0) {
      begin(byte);
      return 0;
    }
    --left_in_block_;
    return byte;
  }

  /// Whether the frame may end here.
  bool is_complete() const { return left_in_block_ == 0; }

 private:
  uint8_t left_in_block_ = 0;
};

}  // namespace ccr

#endif
