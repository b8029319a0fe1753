// Consistent Overhead Byte Stuffing of short frames, a byte at a time.
#ifndef CCR_COBS_H
#define CCR_COBS_H

#include <stdint.h>

namespace ccr {

/// From so many data bytes on, COBS needs a second code byte, which nothing here does.
constexpr uint8_t kCobsMaxData = 253;

/// Encodes into a buffer that is two bytes longer than the data.
class CobsWriter {
 public:
  explicit CobsWriter(uint8_t* encoded) : encoded_(encoded) {}

  void put(uint8_t byte) {
    if (byte == 0) {
      close_block();
      code_at_ = size_;
    } else {
      encoded_[size_] = byte;
    }
    ++size_;
  }

  /// Closes the frame with its zero and returns its size.
  uint8_t finish() {
    close_block();
    encoded_[size_++] = 0;
    return size_;
  }

 private:
  void close_block() { encoded_[code_at_] = static_cast<uint8_t>(size_ - code_at_); }

  uint8_t* encoded_;
  uint8_t code_at_ = 0;
  uint8_t size_ = 1;
};

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
