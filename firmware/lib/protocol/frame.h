// Frames: id, sequence number, payload and CRC, COBS-encoded and closed by a zero.
#ifndef CCR_FRAME_H
#define CCR_FRAME_H

#include <stdint.h>

#include "ccr_messages.h"
#include "cobs.h"
#include "crc16_x25.h"
#include "little_endian.h"

namespace ccr {

constexpr uint8_t kFrameHeader = 2;
constexpr uint8_t kFrameOverhead = kFrameHeader + 2;
/// Largest size on the wire, including the closing zero.
constexpr uint8_t kMaxWireFrame = kMaxEncodedFrame + 1;

static_assert(kMaxDecodedFrame == kMaxPayload + kFrameOverhead, "as the spec says");
static_assert(kMaxDecodedFrame <= kCobsMaxData, "one code byte");

/// Place of the payload before a frame is closed: after the first code byte and the header.
constexpr uint8_t kPayloadAt = 1 + kFrameHeader;

/// Size on the wire, including the closing zero.
constexpr uint8_t wire_size(uint8_t payload_size) {
  return static_cast<uint8_t>(payload_size + kFrameOverhead + 2);
}
static_assert(wire_size(kMaxPayload) == kMaxWireFrame, "as the spec says");

/// Builds a frame in place around the payload at `wire + kPayloadAt`; returns its size.
inline uint8_t close_frame(uint8_t id, uint8_t sequence, uint8_t payload_size, uint8_t* wire) {
  uint8_t* const content = wire + 1;
  const uint8_t checked_size = static_cast<uint8_t>(kFrameHeader + payload_size);
  content[0] = id;
  content[1] = sequence;
  Crc16X25 crc;
  for (uint8_t at = 0; at < checked_size; ++at) {
    crc.add(content[at]);
  }
  put_u16(content + checked_size, crc.value());
  return encode_cobs(wire, static_cast<uint8_t>(payload_size + kFrameOverhead));
}

/// Writes a frame including its zero; returns its size, or 0 if the payload is too long.
inline uint8_t encode_frame(uint8_t id, uint8_t sequence, const uint8_t* payload, uint8_t size,
                            uint8_t (&wire)[kMaxWireFrame]) {
  if (size > kMaxPayload) {
    return 0;
  }
  for (uint8_t at = 0; at < size; ++at) {
    wire[kPayloadAt + at] = payload[at];
  }
  return close_frame(id, sequence, size, wire);
}

/// What a received byte completes.
enum class Received : uint8_t {
  kNothing,
  kFrame,
  kBadCrc,
  kBadEncoding,
  kBadSize,
};

/// Finds frames in arbitrary received bytes. Bounded in memory and in time per byte.
class FrameDecoder {
 public:
  Received feed(uint8_t byte) {
    if (byte == kFrameDelimiter) {
      const Received received = judge();
      place_ = Place::kBetween;
      return received;
    }
    switch (place_) {
      case Place::kBetween:
        begin(byte);
        break;
      case Place::kInside:
        take(cobs_.next(byte));
        break;
      case Place::kTooLong:
        break;
    }
    return Received::kNothing;
  }

  /// Fields of the frame just received; valid until the next byte is fed.
  uint8_t id() const { return content_[0]; }
  uint8_t sequence() const { return content_[1]; }
  const uint8_t* payload() const { return content_ + kFrameHeader; }
  uint8_t payload_size() const { return static_cast<uint8_t>(size_ - kFrameOverhead); }

 private:
  enum class Place : uint8_t { kBetween, kInside, kTooLong };

  void begin(uint8_t code) {
    cobs_.begin(code);
    crc_ = Crc16X25();
    size_ = 0;
    place_ = Place::kInside;
  }

  void take(uint8_t data) {
    if (size_ == kMaxDecodedFrame) {
      place_ = Place::kTooLong;
      return;
    }
    content_[size_++] = data;
    crc_.add(data);
  }

  Received judge() const {
    if (place_ == Place::kBetween) {
      return Received::kNothing;
    }
    if (place_ == Place::kTooLong) {
      return Received::kBadSize;
    }
    if (!cobs_.is_complete()) {
      return Received::kBadEncoding;
    }
    if (size_ < kFrameOverhead) {
      return Received::kBadSize;
    }
    return crc_.is_residue() ? Received::kFrame : Received::kBadCrc;
  }

  CobsReader cobs_;
  Crc16X25 crc_;
  Place place_ = Place::kBetween;
  uint8_t size_ = 0;
  uint8_t content_[kMaxDecodedFrame] = {};
};

}  // namespace ccr

#endif
