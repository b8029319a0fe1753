// The last faults, in a ring of records in EEPROM.
#ifndef CCR_FAULT_LOG_H
#define CCR_FAULT_LOG_H

#include <stdint.h>

#include "ccr_messages.h"
#include "hardware.h"

namespace ccr {

class FaultLog {
 public:
  /// Finds the newest record.
  explicit FaultLog(Hardware& hardware);

  FaultRecord at(uint8_t place) const;

  bool is_writing() const { return written_ < FaultRecord::kSize; }
  /// Starts to write a record; fills in its number and check.
  void begin(FaultRecord record);
  /// Call once per tick while nothing else writes to EEPROM.
  void continue_writing();

 private:
  void read(uint8_t place, uint8_t* bytes) const;

  Hardware& hardware_;
  uint16_t next_number_ = 0;
  uint8_t bytes_[FaultRecord::kSize] = {};
  uint8_t written_ = FaultRecord::kSize;
};

}  // namespace ccr

#endif
