#include "fault_log.h"

#include "config_slot.h"
#include "little_endian.h"

namespace ccr {

namespace {

constexpr uint8_t kCheckAt = FaultRecord::kSize - sizeof(FaultRecord::check);

static_assert(kFaultLogAddress >= kEepromBootCounter + kEepromBootCounters * sizeof(uint16_t) &&
                  kFaultLogAddress + kFaultLogRecords * FaultRecord::kSize <= kEepromSize,
              "behind the boot counters");

constexpr uint16_t address_of(uint8_t place) {
  return static_cast<uint16_t>(kFaultLogAddress + place * FaultRecord::kSize);
}

}  // namespace

FaultLog::FaultLog(Hardware& hardware) : hardware_(hardware) {
  for (uint8_t place = 0; place < kFaultLogRecords; ++place) {
    uint8_t bytes[FaultRecord::kSize];
    read(place, bytes);
    const uint16_t number = get_u16(bytes);
    const uint16_t next = static_cast<uint16_t>(number + 1);
    const bool is_good = number % kFaultLogRecords == place &&
                         get_u32(bytes + kCheckAt) == crc32_of(bytes, kCheckAt);
    if (is_good && (next_number_ == 0 || is_newer(next, next_number_))) {
      next_number_ = next;
    }
  }
}

FaultRecord FaultLog::at(uint8_t place) const {
  uint8_t bytes[FaultRecord::kSize];
  read(place, bytes);
  FaultRecord record;
  decode(bytes, record);
  return record;
}

void FaultLog::begin(FaultRecord record) {
  record.number = next_number_;
  encode(record, bytes_);
  put_u32(bytes_ + kCheckAt, crc32_of(bytes_, kCheckAt));
  written_ = 0;
}

void FaultLog::continue_writing() {
  if (!is_writing() || !hardware_.is_eeprom_ready()) {
    return;
  }
  const uint16_t start = address_of(next_number_ % kFaultLogRecords);
  hardware_.write_eeprom(static_cast<uint16_t>(start + written_), bytes_[written_]);
  ++written_;
  if (!is_writing()) {
    ++next_number_;
  }
}

void FaultLog::read(uint8_t place, uint8_t* bytes) const {
  for (uint8_t at = 0; at < FaultRecord::kSize; ++at) {
    bytes[at] = hardware_.read_eeprom(static_cast<uint16_t>(address_of(place) + at));
  }
}

}  // namespace ccr
