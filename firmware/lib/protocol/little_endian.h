// Little-endian integers as on the wire, independent of the machine.
#ifndef CCR_LITTLE_ENDIAN_H
#define CCR_LITTLE_ENDIAN_H

#include <stdint.h>

namespace ccr {

inline void put_u8(uint8_t* bytes, uint8_t value) { bytes[0] = value; }

inline void put_u16(uint8_t* bytes, uint16_t value) {
  bytes[0] = static_cast<uint8_t>(value);
  bytes[1] = static_cast<uint8_t>(value >> 8);
}

inline void put_u32(uint8_t* bytes, uint32_t value) {
  put_u16(bytes, static_cast<uint16_t>(value));
  put_u16(bytes + 2, static_cast<uint16_t>(value >> 16));
}

inline void put_i8(uint8_t* bytes, int8_t value) { put_u8(bytes, static_cast<uint8_t>(value)); }
inline void put_i16(uint8_t* bytes, int16_t value) { put_u16(bytes, static_cast<uint16_t>(value)); }
inline void put_i32(uint8_t* bytes, int32_t value) { put_u32(bytes, static_cast<uint32_t>(value)); }

inline uint8_t get_u8(const uint8_t* bytes) { return bytes[0]; }

inline uint16_t get_u16(const uint8_t* bytes) {
  return static_cast<uint16_t>(bytes[0] | static_cast<uint16_t>(bytes[1]) << 8);
}

inline uint32_t get_u32(const uint8_t* bytes) {
  return get_u16(bytes) | static_cast<uint32_t>(get_u16(bytes + 2)) << 16;
}

inline int8_t get_i8(const uint8_t* bytes) { return static_cast<int8_t>(get_u8(bytes)); }
inline int16_t get_i16(const uint8_t* bytes) { return static_cast<int16_t>(get_u16(bytes)); }
inline int32_t get_i32(const uint8_t* bytes) { return static_cast<int32_t>(get_u32(bytes)); }

/// Whether a struct has the same layout in memory as on the wire, so that it can be copied as a
/// whole, which takes less flash.
template <typename Layout>
constexpr bool lies_as_on_the_wire() {
  return sizeof(Layout) == uint8_t{Layout::kSize} && __BYTE_ORDER__ == __ORDER_LITTLE_ENDIAN__;
}

}  // namespace ccr

#endif
