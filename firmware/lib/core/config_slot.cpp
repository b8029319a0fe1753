#include "config_slot.h"

#include "little_endian.h"

namespace ccr {

namespace {

constexpr uint8_t kErased = 0xFF;
constexpr uint8_t kFirstLayout = 1;

bool is_blank(const uint8_t (&bytes)[kSlotSize]) {
  for (const uint8_t byte : bytes) {
    if (byte != kErased) {
      return false;
    }
  }
  return true;
}

bool is_intact(const uint8_t (&bytes)[kSlotSize], uint8_t crc_at) {
  return get_u16(bytes + kSlotMagicAt) == kEepromMagic &&
         get_u32(bytes + crc_at) == crc32_of(bytes, crc_at);
}

/// Converts a slot to the current layout; false if its layout is unknown or it is damaged.
bool bring_to_layout(uint8_t (&bytes)[kSlotSize]) {
  const uint8_t layout = get_u8(bytes + kSlotLayoutAt);
  if (layout != kFirstLayout) {
    return layout == kEepromLayout && is_intact(bytes, kSlotCrcAt);
  }
  const bool is_good = is_intact(bytes, kFirstSlotCrcAt);
  for (uint8_t at = kFirstSlotCrcAt; at < kSlotCrcAt; ++at) {
    bytes[at] = 0;
  }
  return is_good;
}

}  // namespace

// Not inlined: it would be in flash four times.
__attribute__((noinline)) void Crc32::add(uint8_t byte) {
  constexpr uint32_t kReflectedPolynomial = 0xEDB88320UL;
  remainder_ ^= byte;
  if (kIsLarge) {
    // Four bits at a time: otherwise two long slots would take 6 ms at the start.
    static constexpr uint32_t kTable[] = {
        0x00000000UL, 0x1DB71064UL, 0x3B6E20C8UL, 0x26D930ACUL, 0x76DC4190UL, 0x6B6B51F4UL,
        0x4DB26158UL, 0x5005713CUL, 0xEDB88320UL, 0xF00F9344UL, 0xD6D6A3E8UL, 0xCB61B38CUL,
        0x9B64C2B0UL, 0x86D3D2D4UL, 0xA00AE278UL, 0xBDBDF21CUL};
    remainder_ = (remainder_ >> 4) ^ kTable[remainder_ & 0x0F];
    remainder_ = (remainder_ >> 4) ^ kTable[remainder_ & 0x0F];
    return;
  }
  for (uint8_t bit = 0; bit < 8; ++bit) {
    const bool carry = (remainder_ & 1U) != 0;
    remainder_ >>= 1;
    if (carry) {
      remainder_ ^= kReflectedPolynomial;
    }
  }
}

uint32_t crc32_of(const uint8_t* bytes, uint8_t size) {
  Crc32 crc;
  for (uint8_t at = 0; at < size; ++at) {
    crc.add(bytes[at]);
  }
  return crc.value();
}

SlotContent read_slot(Hardware& hardware, uint16_t address, uint16_t& generation,
                      Configuration& configuration) {
  uint8_t bytes[kSlotSize] = {};
  for (uint8_t at = 0; at < kSlotSize; ++at) {
    bytes[at] = hardware.read_eeprom(static_cast<uint16_t>(address + at));
  }
  if (is_blank(bytes)) {
    return SlotContent::kBlank;
  }
  generation = get_u16(bytes + kSlotGenerationAt);
  const bool is_good =
      bring_to_layout(bytes) && decode(bytes + kSlotConfigurationAt, configuration);
  return is_good ? SlotContent::kGood : SlotContent::kCorrupt;
}

void SlotWriter::begin(uint16_t generation) {
  crc_ = Crc32();
  generation_ = generation;
  size_ = 0;
}

uint8_t SlotWriter::next(const Configuration& configuration) {
  const uint8_t byte = content_at(size_, configuration);
  if (size_ < kSlotCrcAt) {
    crc_.add(byte);
  }
  ++size_;
  return byte;
}

uint8_t SlotWriter::content_at(uint8_t offset, const Configuration& configuration) const {
  uint8_t bytes[kSlotSize];
  put_u16(bytes + kSlotMagicAt, kEepromMagic);
  put_u8(bytes + kSlotLayoutAt, kEepromLayout);
  put_u16(bytes + kSlotGenerationAt, generation_);
  encode(configuration, bytes + kSlotConfigurationAt);
  put_u32(bytes + kSlotCrcAt, crc_.value());
  return bytes[offset];
}

}  // namespace ccr
