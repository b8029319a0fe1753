// Keeps the configuration in two EEPROM slots of which one is always whole, and counts boots.
#ifndef CCR_CONFIG_STORE_H
#define CCR_CONFIG_STORE_H

#include <stdint.h>

#include "ccr_messages.h"
#include "config_slot.h"
#include "configuration.h"
#include "hardware.h"

namespace ccr {

class ConfigStore {
 public:
  explicit ConfigStore(Hardware& hardware) : hardware_(hardware) {}

  /// Loads the newest good slot; without one the configuration stays as it is, but that its
  /// equipment is missing where a slot is corrupt.
  EepromStatus load(Configuration& configuration);

  /// Counts this boot in EEPROM and returns its number.
  uint16_t count_boot();

  bool is_saving() const { return is_saving_; }
  /// Over the slot that is not the newest.
  void begin_save();

  enum class Step : uint8_t { kNothing, kFinished, kFailed };

  /// Reads back the byte written before, then writes the next one. Once a tick: EEPROM takes 3.4 ms
  /// a byte.
  Step continue_save(const Configuration& configuration);

 private:
  uint16_t read_u16(uint16_t address);
  bool was_last_byte_kept();
  void finish_save();

  Hardware& hardware_;
  SlotWriter writer_;
  uint16_t newest_generation_ = 0;
  uint16_t newest_address_ = kEepromSlotB;
  uint16_t generation_ = 0;
  uint16_t address_ = kEepromSlotA;
  uint8_t last_byte_ = 0;
  bool has_newest_ = false;
  bool is_saving_ = false;
};

}  // namespace ccr

#endif
