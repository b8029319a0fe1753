#include "config_store.h"

#include "little_endian.h"

namespace ccr {

namespace {

constexpr uint16_t kBootCounterErased = 0xFFFF;

constexpr uint16_t boot_counter_address(uint8_t number) {
  return static_cast<uint16_t>(kEepromBootCounter + number * sizeof(uint16_t));
}

EepromStatus status_of(SlotContent a, SlotContent b) {
  if (a == SlotContent::kBlank && b == SlotContent::kBlank) {
    return EepromStatus::kBlank;
  }
  if (a != SlotContent::kCorrupt && b != SlotContent::kCorrupt) {
    return EepromStatus::kLoaded;
  }
  const bool is_one_good = a == SlotContent::kGood || b == SlotContent::kGood;
  return is_one_good ? EepromStatus::kOneSlotBad : EepromStatus::kBothBad;
}

}  // namespace

EepromStatus ConfigStore::load(Configuration& configuration) {
  Configuration read = {};
  uint16_t generation_b = 0;
  const SlotContent b = read_slot(hardware_, kEepromSlotB, generation_b, read);
  if (b == SlotContent::kGood) {
    configuration = read;
    newest_address_ = kEepromSlotB;
    newest_generation_ = generation_b;
  }
  uint16_t generation_a = 0;
  const SlotContent a = read_slot(hardware_, kEepromSlotA, generation_a, read);
  const bool is_b_newer = b == SlotContent::kGood && is_newer(generation_b, generation_a);
  if (a == SlotContent::kGood && !is_b_newer) {
    configuration = read;
    newest_address_ = kEepromSlotA;
    newest_generation_ = generation_a;
  }
  has_newest_ = a == SlotContent::kGood || b == SlotContent::kGood;
  const EepromStatus status = status_of(a, b);
  if (status == EepromStatus::kBothBad) {
    configuration.missing_groups |= config_groups::kEquipment;
  }
  return status;
}

uint16_t ConfigStore::count_boot() {
  uint16_t newest = kBootCounterErased;
  for (uint8_t number = 0; number < kEepromBootCounters; ++number) {
    const uint16_t stored = read_u16(boot_counter_address(number));
    const bool is_first = newest == kBootCounterErased;
    if (stored != kBootCounterErased && (is_first || is_newer(stored, newest))) {
      newest = stored;
    }
  }
  const uint16_t counted = newest == kBootCounterErased       ? uint16_t{1}
                           : newest == kBootCounterErased - 1 ? uint16_t{0}
                                                              : static_cast<uint16_t>(newest + 1);
  uint8_t bytes[sizeof(counted)];
  put_u16(bytes, counted);
  for (uint8_t at = 0; at < sizeof(bytes); ++at) {
    const uint16_t address =
        static_cast<uint16_t>(boot_counter_address(counted % kEepromBootCounters) + at);
    if (hardware_.read_eeprom(address) != bytes[at]) {
      hardware_.write_eeprom(address, bytes[at]);
    }
  }
  return counted;
}

uint16_t ConfigStore::read_u16(uint16_t address) {
  const uint8_t bytes[] = {hardware_.read_eeprom(address),
                           hardware_.read_eeprom(static_cast<uint16_t>(address + 1))};
  return get_u16(bytes);
}

void ConfigStore::begin_save() {
  const bool is_over_b = has_newest_ && newest_address_ == kEepromSlotA;
  address_ = is_over_b ? kEepromSlotB : kEepromSlotA;
  generation_ = has_newest_ ? static_cast<uint16_t>(newest_generation_ + 1) : uint16_t{0};
  writer_.begin(generation_);
  is_saving_ = true;
}

ConfigStore::Step ConfigStore::continue_save(const Configuration& configuration) {
  if (!is_saving_ || !hardware_.is_eeprom_ready()) {
    return Step::kNothing;
  }
  if (writer_.size() > 0 && !was_last_byte_kept()) {
    is_saving_ = false;
    return Step::kFailed;
  }
  if (writer_.is_done()) {
    finish_save();
    return Step::kFinished;
  }
  const uint16_t address = static_cast<uint16_t>(address_ + writer_.size());
  last_byte_ = writer_.next(configuration);
  hardware_.write_eeprom(address, last_byte_);
  return Step::kNothing;
}

bool ConfigStore::was_last_byte_kept() {
  const uint16_t address = static_cast<uint16_t>(address_ + writer_.size() - 1);
  return hardware_.read_eeprom(address) == last_byte_;
}

void ConfigStore::finish_save() {
  is_saving_ = false;
  has_newest_ = true;
  newest_address_ = address_;
  newest_generation_ = generation_;
}

}  // namespace ccr
