// Stores the configuration in two EEPROM slots, one of which is always complete, and counts boots.
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

  /// Loads the newest good slot; without one the configuration is unchanged, except that its
  /// equipment is missing if a slot is corrupt.
  EepromStatus load(Configuration& configuration);

  /// Counts this boot in EEPROM and returns its number.
  uint16_t count_boot();

  bool is_saving() const { return is_saving_; }
  /// Starts to overwrite the slot that is not the newest.
  void begin_save();

  enum class Step : uint8_t { kNothing, kFinished, kFailed };

  /// Verifies the byte written before, then writes the next one. Call once per tick: EEPROM takes
  /// 3.4 ms per byte.
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
