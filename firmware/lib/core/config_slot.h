// One of the two EEPROM slots that hold a configuration.
#ifndef CCR_CONFIG_SLOT_H
#define CCR_CONFIG_SLOT_H

#include <stdint.h>

#include "configuration.h"
#include "hardware.h"

namespace ccr {

enum class SlotContent : uint8_t { kBlank, kCorrupt, kGood };

constexpr uint8_t kSlotMagicAt = 0;
constexpr uint8_t kSlotLayoutAt = 2;
constexpr uint8_t kSlotGenerationAt = 3;
constexpr uint8_t kSlotConfigurationAt = 5;
constexpr uint8_t kSlotCrcAt = kSlotConfigurationAt + kConfigurationSize;
/// Place of the CRC in a slot of layout 1.
constexpr uint8_t kFirstSlotCrcAt = kSlotConfigurationAt + kFirstConfigurationSize;
constexpr uint8_t kSlotSize = kSlotCrcAt + sizeof(uint32_t);

static_assert(kSlotSize == kEepromSlotSize, "as the spec says");
static_assert(kEepromSlotA + kSlotSize <= kEepromSlotB, "slots do not overlap");
static_assert(kEepromSlotB + kSlotSize <= kEepromSize, "all fits");
/// Boot counters and fault log lie before or between the slots, or after them.
constexpr uint16_t kFaultLogEnd = kFaultLogAddress + kFaultLogRecords * FaultRecord::kSize;
constexpr bool is_slot_alone(uint16_t address) {
  return address + kSlotSize <= kEepromBootCounter || address >= kFaultLogEnd;
}
static_assert(is_slot_alone(kEepromSlotA) && is_slot_alone(kEepromSlotB), "nothing overlaps");

/// CRC-32 (ISO-HDLC, as in zip and Ethernet). Computed bit by bit: EEPROM is a byte per tick.
class Crc32 {
 public:
  void add(uint8_t byte);
  uint32_t value() const { return ~remainder_; }

 private:
  uint32_t remainder_ = 0xFFFFFFFFUL;
};

uint32_t crc32_of(const uint8_t* bytes, uint8_t size);

/// Generation and configuration are valid only if the content is good.
SlotContent read_slot(Hardware& hardware, uint16_t address, uint16_t& generation,
                      Configuration& configuration);

/// Whether `generation` is newer than `other`, modulo 65536.
constexpr bool is_newer(uint16_t generation, uint16_t other) {
  return generation != other && static_cast<uint16_t>(generation - other) < 0x8000U;
}

/// Generates the bytes of a slot one by one.
class SlotWriter {
 public:
  void begin(uint16_t generation);
  bool is_done() const { return size_ == kSlotSize; }
  /// Number of bytes generated so far.
  uint8_t size() const { return size_; }
  uint8_t next(const Configuration& configuration);

 private:
  uint8_t content_at(uint8_t offset, const Configuration& configuration) const;

  Crc32 crc_;
  uint16_t generation_ = 0;
  uint8_t size_ = 0;
};

}  // namespace ccr

#endif
