// Consistent Overhead Byte Stuffing of short frames, a byte at a time.
#ifndef CCR_COBS_H
#define CCR_COBS_H

#include <stdint.h>

namespace ccr {

/// From so many data bytes on, COBS needs a second code byte, which nothing here does.
constexpr uint8_t kCobsMaxData = 253;

/// Encodes in place: data of so many bytes at `encoded + 1`, with room for a byte after them.
/// Returns the size with the closing zero.
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

/// Decodes the bytes of one frame, its zero excluded.
class CobsReader {
 public:
  /// Takes the first byte of a frame, which is no data.
  void begin(uint8_t code) { left_in_block_ = static_cast<uint8_t>(code - 1); }

  /// Takes any further byte and returns the data byte that it stands for.
  uint8_t next(uint8_t byte) {
    if (left_in_block_ == 0) {
      begin(byte);
      return 0;
    }
    --left_in_block_;
    return byte;
  }

  /// May the frame end here?
  bool is_complete() const { return left_in_block_ == 0; }

 private:
  uint8_t left_in_block_ = 0;
};

}  // namespace ccr

#endif
