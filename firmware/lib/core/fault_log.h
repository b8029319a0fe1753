// The last faults, in a ring of records in EEPROM.
#ifndef CCR_FAULT_LOG_H
#define CCR_FAULT_LOG_H

#include <stdint.h>

#include "ccr_messages.h"
#include "hardware.h"

namespace ccr {

class FaultLog {
 public:
  /// Looks for the newest record.
  explicit FaultLog(Hardware& hardware);

  FaultRecord at(uint8_t place) const;

  bool is_writing() const { return written_ < FaultRecord::kSize; }
  /// Number and check are given to it.
  void begin(FaultRecord record);
  /// Once a tick, while nothing else writes to EEPROM.
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
