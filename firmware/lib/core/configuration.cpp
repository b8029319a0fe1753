#include "configuration.h"

namespace ccr {

namespace {

template <typename Group>
bool is_usable(const Group& group) {
  return first_out_of_range(group) == kNone && inconsistent_axis(group) == kNone;
}

}  // namespace

Configuration empty_configuration() {
  Configuration configuration = {};
  configuration.missing_groups = kRobotsGroups;
  return configuration;
}

void encode(const Configuration& configuration, uint8_t* bytes) {
  encode(configuration.limits, bytes + kLimitsAt);
  encode(configuration.slew, bytes + kSlewAt);
  encode(configuration.watchdog, bytes + kWatchdogAt);
  encode(configuration.calibration, bytes + kCalibrationAt);
  encode(configuration.equipment, bytes + kEquipmentAt);
  encode(configuration.acceleration, bytes + kAccelerationAt);
}

bool decode(const uint8_t* bytes, Configuration& configuration) {
  decode(bytes + kLimitsAt, configuration.limits);
  decode(bytes + kSlewAt, configuration.slew);
  decode(bytes + kWatchdogAt, configuration.watchdog);
  decode(bytes + kCalibrationAt, configuration.calibration);
  decode(bytes + kEquipmentAt, configuration.equipment);
  decode(bytes + kAccelerationAt, configuration.acceleration);
  configuration.missing_groups = 0;
  return is_usable(configuration.limits) && is_usable(configuration.slew) &&
         is_usable(configuration.watchdog) && is_usable(configuration.calibration) &&
         is_usable(configuration.equipment) && is_usable(configuration.acceleration);
}

}  // namespace ccr
