// The configuration in use: six groups, each complete or missing.
#ifndef CCR_CONFIGURATION_H
#define CCR_CONFIGURATION_H

#include <stdint.h>

#include "ccr_messages.h"

namespace ccr {

/// Groups that are missing on a new board.
constexpr uint8_t kRobotsGroups = config_groups::kLimits | config_groups::kSlew |
                               config_groups::kWatchdog | config_groups::kCalibration;

/// A missing group is all zeros.
struct Configuration {
  Limits limits;
  Slew slew;
  Watchdog watchdog;
  Calibration calibration;
  Equipment equipment;
  Acceleration acceleration;
  uint8_t missing_groups;

  bool is_complete() const { return missing_groups == 0; }
};

constexpr uint8_t kLimitsAt = 0;
constexpr uint8_t kSlewAt = kLimitsAt + Limits::kSize;
constexpr uint8_t kWatchdogAt = kSlewAt + Slew::kSize;
constexpr uint8_t kCalibrationAt = kWatchdogAt + Watchdog::kSize;
constexpr uint8_t kEquipmentAt = kCalibrationAt + Calibration::kSize;
constexpr uint8_t kAccelerationAt = kEquipmentAt + Equipment::kSize;
constexpr uint8_t kConfigurationSize = kAccelerationAt + Acceleration::kSize;
/// Size in layout 1, which lacks the later groups.
constexpr uint8_t kFirstConfigurationSize = kEquipmentAt;

Configuration empty_configuration();

/// Writes the groups in their order in EEPROM.
void encode(const Configuration& configuration, uint8_t* bytes);

/// Returns false, with an undefined configuration, if a value is not allowed.
bool decode(const uint8_t* bytes, Configuration& configuration);

}  // namespace ccr

#endif
