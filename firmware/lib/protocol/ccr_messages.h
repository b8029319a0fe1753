// Messages of the wire protocol. Generated from protocol/spec.toml: do not edit.
#ifndef CCR_MESSAGES_H
#define CCR_MESSAGES_H

#include <stdint.h>

#include "little_endian.h"

// Axes of the board: a flag of the build, as it decides on the length of messages.
#ifndef CCR_AXES
#define CCR_AXES 2
#endif

namespace ccr {

constexpr uint8_t kProtocolVersion = 2;
constexpr uint32_t kSpecHash = 0xF2E09CD6UL;
constexpr uint8_t kFirmwareVersion[3] = {0, 2, 0};

constexpr uint8_t kAxes = CCR_AXES;
constexpr uint8_t kMaxAxes = 12;
static_assert(CCR_AXES >= 1 && CCR_AXES <= kMaxAxes, "as the spec says");
constexpr bool kIsLarge = kAxes > 2;

constexpr uint32_t kBaud = 250000UL;
constexpr uint32_t kBaudFallback = 115200UL;
constexpr uint8_t kFrameDelimiter = 0;
constexpr uint8_t kMaxPayload = kIsLarge ? 98 : 48;
constexpr uint8_t kMaxDecodedFrame = kMaxPayload + 4;
constexpr uint8_t kMaxEncodedFrame = kMaxDecodedFrame + 1;  ///< Without the delimiter.

/// Period of the control tick and of the servo pulses. [us]
constexpr uint16_t kTickUs = 20000U;
/// Time from the start of a pulse frame to its control tick. No pulse is longer than 2.5 ms, so at
/// the tick all pins are low and pulses can be switched on or off without cutting one short; the
/// widths that the tick computes take effect 2 ms later, at the start of the next frame. [us]
constexpr uint16_t kTickPhaseUs = 18000U;
/// Duration of the self-test after a reset: control tick 5, the sixth, ends it. [tick]
constexpr uint8_t kBootTicks = 5U;
/// A request repeated within this time is answered from memory instead of being executed again.
/// [tick]
constexpr uint8_t kRetryWindowTicks = 50U;
/// Longest time to reach the rest pose with any configuration: 270 deg at the lowest slew and relax
/// slew allowed, plus 6 s to brake and accelerate at the lowest acceleration. [ms]
constexpr uint16_t kWayToRestMs = 60000U;
/// Time from a reset until the board accepts requests; anything received earlier is lost. [us]
constexpr uint16_t kListensAfterUs = 2000U;
/// Number of requests that a host may have sent without having received their replies (REQ-5),
/// unless the board announces another (`link_limits`): the longest replies to them and two reports
/// fit into send_bytes. [request]
constexpr uint8_t kOutstandingRequests = 5U;
/// Number of bytes that these requests may have in total, as encoded frames, unless the board
/// announces another: they fit into the receive buffer. [byte]
constexpr uint8_t kOutstandingBytes = kIsLarge ? 127U : 63U;
/// Size of the send buffer. A frame that does not fit is dropped and counted. All frames except the
/// reply to `stop` leave room for that reply. [byte]
constexpr uint16_t kSendBytes = kIsLarge ? 1023U : 255U;
/// Number of consecutive ticks with too low a servo supply that raise the fault: longer than the
/// inrush of starting servos. [tick]
constexpr uint8_t kSagTicks = 10U;
/// Address of the fault log in EEPROM (LOG-1). [byte]
constexpr uint16_t kFaultLogAddress = 320U;
/// Number of faults kept in the log. [record]
constexpr uint8_t kFaultLogRecords = 8U;
/// Duration of each of the eight steps in which the LED shows the state (LED-1). [tick]
constexpr uint8_t kLedStepTicks = 8U;
/// Half the period of the blinking on request (LED-2). [tick]
constexpr uint8_t kBlinkStepTicks = 4U;
/// No pulse is ever shorter, whatever the calibration says. [0.5 us]
constexpr uint16_t kPulseFloorHalfUs = 1000U;
/// No pulse is ever longer, whatever the calibration says. [0.5 us]
constexpr uint16_t kPulseCeilingHalfUs = 5000U;

constexpr uint16_t kEepromSize = 1024;
constexpr uint16_t kEepromSlotA = 0;
constexpr uint16_t kEepromSlotB = kIsLarge ? 512 : 128;
constexpr uint16_t kEepromSlotSize = 34 + 18 * kAxes;
constexpr uint16_t kEepromBootCounter = 256;
constexpr uint8_t kEepromBootCounters = 32;
constexpr uint16_t kEepromMagic = 0xCC52U;
constexpr uint8_t kEepromLayout = 2;

/// State of the board. Only `arming`, `active`, `hold`, `relaxing` and `disarming` put pulses on
/// the pins.
enum class State : uint8_t {
  /// Self-test after a reset. No pulses.
  kBoot = 0,
  /// Ready. No pulses.
  kDisarmed = 1,
  /// Servos are enabled one after another at the last setpoint, then moved slowly to rest.
  kArming = 2,
  /// Follows targets.
  kActive = 3,
  /// Armed, but without a valid target: the setpoint does not move.
  kHold = 4,
  /// The host has been silent: slow return to the rest pose. A new target ends it.
  kRelaxing = 5,
  /// The host asked to disarm: slow return to the rest pose, then no pulses.
  kDisarming = 6,
  /// Latched. No pulses. The first fault is kept until it is cleared.
  kFault = 7,
  /// Emergency stop, latched. No pulses until it is cleared.
  kStopped = 8,
};

constexpr bool is_state(uint8_t value) {
  return value <= 8U;
}

/// Cause of a change of state; never on the wire.
enum class Event : uint8_t {
  /// `boot_ticks` after a reset, without a fault.
  kSelfTestPassed = 0,
  /// `arm` accepted.
  kArmRequested = 1,
  /// All servos have pulses, and the setpoint is at rest.
  kAxesEnabled = 2,
  /// `set_target` accepted.
  kTargetAccepted = 3,
  /// The validity of the last target has run out.
  kTargetExpired = 4,
  /// `hold` has lasted `relax_after_ms`.
  kHoldExpired = 5,
  /// The setpoint is at rest.
  kRestReached = 6,
  /// `disarm` accepted.
  kDisarmRequested = 7,
  /// `stop` received.
  kStopRequested = 8,
  /// A fault was detected.
  kFaultRaised = 9,
  /// `clear_fault` accepted.
  kClearRequested = 10,
};

/// Why the board is in `fault`.
enum class Fault : uint8_t {
  /// No fault.
  kNone = 0,
  /// No target arrived during `hold` and `relaxing`; the robot is at rest.
  kLinkLoss = 1,
  /// The hardware watchdog has reset the board.
  kWatchdogReset = 2,
  /// The supply fell below the brown-out level.
  kBrownOutReset = 3,
  /// A control tick was not finished before the next one was due.
  kTickOverrun = 4,
  /// Less than the minimum of free stack was left.
  kStackLow = 5,
  /// A byte read back from EEPROM was not the one written.
  kEepromFailed = 6,
  /// An invariant of the firmware did not hold.
  kInternal = 7,
  /// The board restarted while it generated pulses, and the boot loader has cleared the cause.
  kResetWhileArmed = 8,
  /// The emergency-stop input is open: pressed, or its wire is broken.
  kEmergencyStop = 9,
  /// The servos' supply was too low (SUP-3).
  kSupplyLow = 10,
};

constexpr bool is_fault(uint8_t value) {
  return value <= 10U;
}

/// Why the board last started.
enum class ResetCause : uint8_t {
  /// The boot loader has cleared the cause.
  kUnknown = 0,
  /// Supply switched on.
  kPowerOn = 1,
  /// Reset pin, as when a serial port is opened (DTR).
  kExternal = 2,
  /// Supply too low.
  kBrownOut = 3,
  /// Hardware watchdog.
  kWatchdog = 4,
};

constexpr bool is_reset_cause(uint8_t value) {
  return value <= 4U;
}

/// Why a request was refused. Checks are made in this order; the first that fails is reported.
enum class NackCode : uint8_t {
  /// No request has this id.
  kUnknownId = 1,
  /// The payload does not have the length of this message.
  kBadLength = 2,
  /// The session is not the open one. Detail: 0.
  kBadSession = 3,
  /// Not allowed in this state. Detail: the state.
  kBadState = 4,
  /// A field is out of its range. Detail: index of the field in the payload, from 0.
  kOutOfRange = 5,
  /// Each field is in range, but together they are contradictory. Detail: the axis.
  kInconsistent = 6,
  /// The host was built from another spec: it may only identify, read and stop.
  kSpecMismatch = 7,
  /// A configuration group was neither loaded from EEPROM nor set. Detail: the missing groups.
  kNotConfigured = 8,
  /// Repeat the request later. `arm`, `save_config` and requests that set a configuration group: a
  /// save is being written to EEPROM. `clear_fault`: no tick has switched off the pulses yet.
  /// `get_fault_record`: a byte is being written to EEPROM.
  kBusy = 9,
  /// The emergency-stop input is open: close it before `clear_fault`.
  kEmergencyStopOpen = 10,
};

constexpr bool is_nack_code(uint8_t value) {
  return value >= 1U && value <= 10U;
}

/// What was found in EEPROM at boot.
enum class EepromStatus : uint8_t {
  /// Neither slot has ever been written.
  kBlank = 0,
  /// The newest slot was good, or one was good and the other blank.
  kLoaded = 1,
  /// One slot is corrupt; the other was loaded.
  kOneSlotBad = 2,
  /// Nothing could be loaded and at least one slot is corrupt: arming is refused until the host
  /// configures the board.
  kBothBad = 3,
};

constexpr bool is_eeprom_status(uint8_t value) {
  return value <= 3U;
}

/// Details of the state.
namespace status_flags {
/// The last tick commanded a pulse for axis 1; `pulse_half_us` tells for all axes.
constexpr uint8_t kAxis1Pulses = 0x01;
/// The last tick commanded a pulse for axis 2, if there is one.
constexpr uint8_t kAxis2Pulses = 0x02;
/// The setpoint has not reached its goal: the target in `active`, otherwise the rest pose.
constexpr uint8_t kMoving = 0x04;
/// The last accepted target was clamped to the angle limits, or its pulse to the pulse limits.
constexpr uint8_t kClamped = 0x08;
/// A save is being written.
constexpr uint8_t kEepromBusy = 0x10;
/// All configuration groups are present.
constexpr uint8_t kConfigured = 0x20;
/// A session is open.
constexpr uint8_t kSessionOpen = 0x40;
/// A configuration group has been set since the last save or load.
constexpr uint8_t kUnsaved = 0x80;
}  // namespace status_flags

/// What this board can do.
namespace capabilities {
/// Stores its configuration.
constexpr uint16_t kEeprom = 0x01;
/// Pulses come from a timer, not from software.
constexpr uint16_t kHardwarePulses = 0x02;
/// Reports the least free stack.
constexpr uint16_t kStackMonitor = 0x04;
/// What may be outstanding is not what the constants say: `get_link_limits` tells.
constexpr uint16_t kLinkLimits = 0x08;
/// Knows `set_target_at`.
constexpr uint16_t kTimedTargets = 0x10;
}  // namespace capabilities

/// Groups of the configuration.
namespace config_groups {
/// `set_limits`
constexpr uint8_t kLimits = 0x01;
/// `set_slew`
constexpr uint8_t kSlew = 0x02;
/// `set_watchdog`
constexpr uint8_t kWatchdog = 0x04;
/// `set_calibration`
constexpr uint8_t kCalibration = 0x08;
/// `set_equipment`; missing only if no EEPROM slot could be loaded and one is corrupt
constexpr uint8_t kEquipment = 0x10;
}  // namespace config_groups

/// What became of a payload.
enum class Reading : uint8_t {
  kOk,
  kBadLength,
  kUndefinedValue,  ///< An enumeration does not have the value.
};

/// Answer of `first_out_of_range` and `inconsistent_axis` where there is nothing to report.
constexpr int8_t kNone = -1;

/// Angle limits and rest pose of each axis.
struct Limits {
  enum : uint8_t { kSize = 6 * kAxes };

  /// Lower limit of the servo angle. [0.01 deg] -13500 to 13500.
  int16_t angle_min_cdeg[kAxes];
  /// Upper limit of the servo angle. [0.01 deg] -13500 to 13500.
  int16_t angle_max_cdeg[kAxes];
  /// Pose to which the robot moves when it is armed, relaxed or disarmed. [0.01 deg] -13500 to
  /// 13500.
  int16_t rest_cdeg[kAxes];
};
static_assert(Limits::kSize == sizeof(Limits::angle_min_cdeg) + sizeof(Limits::angle_max_cdeg) +
              sizeof(Limits::rest_cdeg) && uint8_t{Limits::kSize} <= kMaxPayload, "payload layout");

inline void encode(const Limits& value, uint8_t* bytes) {
  if (lies_as_on_the_wire<Limits>()) {
    __builtin_memcpy(bytes, &value, Limits::kSize);
    return;
  }
  for (uint8_t at = 0; at < kAxes; ++at) {
    put_i16(bytes + 2 * at, value.angle_min_cdeg[at]);
  }
  for (uint8_t at = 0; at < kAxes; ++at) {
    put_i16(bytes + 2 * kAxes + 2 * at, value.angle_max_cdeg[at]);
  }
  for (uint8_t at = 0; at < kAxes; ++at) {
    put_i16(bytes + 4 * kAxes + 2 * at, value.rest_cdeg[at]);
  }
}

inline Reading decode(const uint8_t* bytes, Limits& value) {
  if (lies_as_on_the_wire<Limits>()) {
    __builtin_memcpy(&value, bytes, Limits::kSize);
    return Reading::kOk;
  }
  for (uint8_t at = 0; at < kAxes; ++at) {
    value.angle_min_cdeg[at] = get_i16(bytes + 2 * at);
  }
  for (uint8_t at = 0; at < kAxes; ++at) {
    value.angle_max_cdeg[at] = get_i16(bytes + 2 * kAxes + 2 * at);
  }
  for (uint8_t at = 0; at < kAxes; ++at) {
    value.rest_cdeg[at] = get_i16(bytes + 4 * kAxes + 2 * at);
  }
  return Reading::kOk;
}

/// Index of the first field out of its range; an array is one field.
inline int8_t first_out_of_range(const Limits& value) {
  for (uint8_t at = 0; at < kAxes; ++at) {
    if (value.angle_min_cdeg[at] < -13500 || value.angle_min_cdeg[at] > 13500) {
      return 0;
    }
  }
  for (uint8_t at = 0; at < kAxes; ++at) {
    if (value.angle_max_cdeg[at] < -13500 || value.angle_max_cdeg[at] > 13500) {
      return 1;
    }
  }
  for (uint8_t at = 0; at < kAxes; ++at) {
    if (value.rest_cdeg[at] < -13500 || value.rest_cdeg[at] > 13500) {
      return 2;
    }
  }
  return kNone;
}

/// First axis whose fields, each in range, contradict each other.
inline int8_t inconsistent_axis(const Limits& value) {
  for (int8_t axis = 0; axis < kAxes; ++axis) {
    const bool consistent =
        value.angle_min_cdeg[axis] < value.angle_max_cdeg[axis] &&
        value.angle_min_cdeg[axis] <= value.rest_cdeg[axis] &&
        value.rest_cdeg[axis] <= value.angle_max_cdeg[axis];
    if (!consistent) {
      return axis;
    }
  }
  return kNone;
}

/// Limit of the setpoint's rate.
struct Slew {
  enum : uint8_t { kSize = 2 * kAxes };

  /// Largest change of the setpoint in one 20 ms tick. The lowest value bounds the time to reach
  /// rest (WDG-6). [0.01 deg/tick] 10 to 2000.
  uint16_t slew_cdeg_tick[kAxes];
};
static_assert(Slew::kSize == sizeof(Slew::slew_cdeg_tick) && uint8_t{Slew::kSize} <= kMaxPayload,
              "payload layout");

inline void encode(const Slew& value, uint8_t* bytes) {
  if (lies_as_on_the_wire<Slew>()) {
    __builtin_memcpy(bytes, &value, Slew::kSize);
    return;
  }
  for (uint8_t at = 0; at < kAxes; ++at) {
    put_u16(bytes + 2 * at, value.slew_cdeg_tick[at]);
  }
}

inline Reading decode(const uint8_t* bytes, Slew& value) {
  if (lies_as_on_the_wire<Slew>()) {
    __builtin_memcpy(&value, bytes, Slew::kSize);
    return Reading::kOk;
  }
  for (uint8_t at = 0; at < kAxes; ++at) {
    value.slew_cdeg_tick[at] = get_u16(bytes + 2 * at);
  }
  return Reading::kOk;
}

/// Index of the first field out of its range; an array is one field.
inline int8_t first_out_of_range(const Slew& value) {
  for (uint8_t at = 0; at < kAxes; ++at) {
    if (value.slew_cdeg_tick[at] < 10U || value.slew_cdeg_tick[at] > 2000U) {
      return 0;
    }
  }
  return kNone;
}

inline int8_t inconsistent_axis(const Slew&) {
  return kNone;
}

/// Limit of the setpoint's acceleration. The default, zeros, sets no limit.
struct Acceleration {
  enum : uint8_t { kSize = 2 * kAxes };

  /// Largest change of the setpoint's step from one tick to the next; 0: no limit. [0.01
  /// deg/tick^2] 0 to 2000.
  uint16_t acceleration_cdeg_tick2[kAxes];
};
static_assert(Acceleration::kSize == sizeof(Acceleration::acceleration_cdeg_tick2) &&
              uint8_t{Acceleration::kSize} <= kMaxPayload, "payload layout");

inline void encode(const Acceleration& value, uint8_t* bytes) {
  if (lies_as_on_the_wire<Acceleration>()) {
    __builtin_memcpy(bytes, &value, Acceleration::kSize);
    return;
  }
  for (uint8_t at = 0; at < kAxes; ++at) {
    put_u16(bytes + 2 * at, value.acceleration_cdeg_tick2[at]);
  }
}

inline Reading decode(const uint8_t* bytes, Acceleration& value) {
  if (lies_as_on_the_wire<Acceleration>()) {
    __builtin_memcpy(&value, bytes, Acceleration::kSize);
    return Reading::kOk;
  }
  for (uint8_t at = 0; at < kAxes; ++at) {
    value.acceleration_cdeg_tick2[at] = get_u16(bytes + 2 * at);
  }
  return Reading::kOk;
}

/// Index of the first field out of its range; an array is one field.
inline int8_t first_out_of_range(const Acceleration& value) {
  for (uint8_t at = 0; at < kAxes; ++at) {
    if (value.acceleration_cdeg_tick2[at] > 2000U) {
      return 0;
    }
  }
  return kNone;
}

inline int8_t inconsistent_axis(const Acceleration&) {
  return kNone;
}

/// Staged reaction to a silent host. It cannot be switched off.
struct Watchdog {
  enum : uint8_t { kSize = 6 };

  /// Duration of `hold` before `relaxing`. [ms] 20 to 60000.
  uint16_t relax_after_ms;
  /// Rate of the slow return to rest, also while arming and disarming. The lower of this and the
  /// slew limit applies. [0.01 deg/tick] 10 to 500.
  uint16_t relax_slew_cdeg_tick;
  /// Pause after enabling each servo. [ms] 20 to 5000.
  uint16_t arm_axis_ms;
};
static_assert(Watchdog::kSize == sizeof(Watchdog::relax_after_ms) +
              sizeof(Watchdog::relax_slew_cdeg_tick) + sizeof(Watchdog::arm_axis_ms) &&
              uint8_t{Watchdog::kSize} <= kMaxPayload, "payload layout");

inline void encode(const Watchdog& value, uint8_t* bytes) {
  if (lies_as_on_the_wire<Watchdog>()) {
    __builtin_memcpy(bytes, &value, Watchdog::kSize);
    return;
  }
  put_u16(bytes, value.relax_after_ms);
  put_u16(bytes + 2, value.relax_slew_cdeg_tick);
  put_u16(bytes + 4, value.arm_axis_ms);
}

inline Reading decode(const uint8_t* bytes, Watchdog& value) {
  if (lies_as_on_the_wire<Watchdog>()) {
    __builtin_memcpy(&value, bytes, Watchdog::kSize);
    return Reading::kOk;
  }
  value.relax_after_ms = get_u16(bytes);
  value.relax_slew_cdeg_tick = get_u16(bytes + 2);
  value.arm_axis_ms = get_u16(bytes + 4);
  return Reading::kOk;
}

/// Index of the first field out of its range; an array is one field.
inline int8_t first_out_of_range(const Watchdog& value) {
  if (value.relax_after_ms < 20U || value.relax_after_ms > 60000U) {
    return 0;
  }
  if (value.relax_slew_cdeg_tick < 10U || value.relax_slew_cdeg_tick > 500U) {
    return 1;
  }
  if (value.arm_axis_ms < 20U || value.arm_axis_ms > 5000U) {
    return 2;
  }
  return kNone;
}

inline int8_t inconsistent_axis(const Watchdog&) {
  return kNone;
}

/// From angle to pulse: pulse = neutral + round(angle_cdeg * per_90_deg / 9000), halves away from
/// zero, then clamped to min and max.
struct Calibration {
  enum : uint8_t { kSize = 8 * kAxes };

  /// Pulse at 0 deg. [0.5 us] 1000 to 5000.
  uint16_t neutral_half_us[kAxes];
  /// Change of the pulse for +90 deg; negative where the servo turns the other way. [0.5 us] -4000
  /// to 4000.
  int16_t per_90_deg_half_us[kAxes];
  /// Shortest pulse for this servo. [0.5 us] 1000 to 5000.
  uint16_t pulse_min_half_us[kAxes];
  /// Longest pulse for this servo. [0.5 us] 1000 to 5000.
  uint16_t pulse_max_half_us[kAxes];
};
static_assert(Calibration::kSize == sizeof(Calibration::neutral_half_us) +
              sizeof(Calibration::per_90_deg_half_us) + sizeof(Calibration::pulse_min_half_us) +
              sizeof(Calibration::pulse_max_half_us) && uint8_t{Calibration::kSize} <= kMaxPayload,
              "payload layout");

inline void encode(const Calibration& value, uint8_t* bytes) {
  if (lies_as_on_the_wire<Calibration>()) {
    __builtin_memcpy(bytes, &value, Calibration::kSize);
    return;
  }
  for (uint8_t at = 0; at < kAxes; ++at) {
    put_u16(bytes + 2 * at, value.neutral_half_us[at]);
  }
  for (uint8_t at = 0; at < kAxes; ++at) {
    put_i16(bytes + 2 * kAxes + 2 * at, value.per_90_deg_half_us[at]);
  }
  for (uint8_t at = 0; at < kAxes; ++at) {
    put_u16(bytes + 4 * kAxes + 2 * at, value.pulse_min_half_us[at]);
  }
  for (uint8_t at = 0; at < kAxes; ++at) {
    put_u16(bytes + 6 * kAxes + 2 * at, value.pulse_max_half_us[at]);
  }
}

inline Reading decode(const uint8_t* bytes, Calibration& value) {
  if (lies_as_on_the_wire<Calibration>()) {
    __builtin_memcpy(&value, bytes, Calibration::kSize);
    return Reading::kOk;
  }
  for (uint8_t at = 0; at < kAxes; ++at) {
    value.neutral_half_us[at] = get_u16(bytes + 2 * at);
  }
  for (uint8_t at = 0; at < kAxes; ++at) {
    value.per_90_deg_half_us[at] = get_i16(bytes + 2 * kAxes + 2 * at);
  }
  for (uint8_t at = 0; at < kAxes; ++at) {
    value.pulse_min_half_us[at] = get_u16(bytes + 4 * kAxes + 2 * at);
  }
  for (uint8_t at = 0; at < kAxes; ++at) {
    value.pulse_max_half_us[at] = get_u16(bytes + 6 * kAxes + 2 * at);
  }
  return Reading::kOk;
}

/// Index of the first field out of its range; an array is one field.
inline int8_t first_out_of_range(const Calibration& value) {
  for (uint8_t at = 0; at < kAxes; ++at) {
    if (value.neutral_half_us[at] < 1000U || value.neutral_half_us[at] > 5000U) {
      return 0;
    }
  }
  for (uint8_t at = 0; at < kAxes; ++at) {
    if (value.per_90_deg_half_us[at] < -4000 || value.per_90_deg_half_us[at] > 4000) {
      return 1;
    }
  }
  for (uint8_t at = 0; at < kAxes; ++at) {
    if (value.pulse_min_half_us[at] < 1000U || value.pulse_min_half_us[at] > 5000U) {
      return 2;
    }
  }
  for (uint8_t at = 0; at < kAxes; ++at) {
    if (value.pulse_max_half_us[at] < 1000U || value.pulse_max_half_us[at] > 5000U) {
      return 3;
    }
  }
  return kNone;
}

/// First axis whose fields, each in range, contradict each other.
inline int8_t inconsistent_axis(const Calibration& value) {
  for (int8_t axis = 0; axis < kAxes; ++axis) {
    const bool consistent =
        value.pulse_min_half_us[axis] < value.pulse_max_half_us[axis] &&
        value.pulse_min_half_us[axis] <= value.neutral_half_us[axis] &&
        value.neutral_half_us[axis] <= value.pulse_max_half_us[axis] &&
        (value.per_90_deg_half_us[axis] < -99 || value.per_90_deg_half_us[axis] > 99);
    if (!consistent) {
      return axis;
    }
  }
  return kNone;
}

/// The board's name, and what is wired to it. It belongs to the board, not to a robot's
/// description. Zeros: a board without a name to which only servos are wired.
struct Equipment {
  enum : uint8_t { kSize = 19 };

  /// ASCII, padded with zeros. The board stores any bytes; the host checks them.
  uint8_t board_name[16];
  /// 1: a switch is wired to the emergency-stop input, closed unless it is pressed. 0 to 1.
  uint8_t emergency_stop;
  /// Servo supply at which the divider outputs 5 V; 0: no divider is wired. [0.1 V]
  uint8_t supply_full_dv;
  /// Lowest permitted servo supply; 0: no limit. [0.1 V]
  uint8_t supply_min_dv;
};
static_assert(Equipment::kSize == sizeof(Equipment::board_name) + sizeof(Equipment::emergency_stop)
              + sizeof(Equipment::supply_full_dv) + sizeof(Equipment::supply_min_dv) &&
              uint8_t{Equipment::kSize} <= kMaxPayload, "payload layout");

inline void encode(const Equipment& value, uint8_t* bytes) {
  if (lies_as_on_the_wire<Equipment>()) {
    __builtin_memcpy(bytes, &value, Equipment::kSize);
    return;
  }
  for (uint8_t at = 0; at < 16; ++at) {
    put_u8(bytes + at, value.board_name[at]);
  }
  put_u8(bytes + 16, value.emergency_stop);
  put_u8(bytes + 17, value.supply_full_dv);
  put_u8(bytes + 18, value.supply_min_dv);
}

inline Reading decode(const uint8_t* bytes, Equipment& value) {
  if (lies_as_on_the_wire<Equipment>()) {
    __builtin_memcpy(&value, bytes, Equipment::kSize);
    return Reading::kOk;
  }
  for (uint8_t at = 0; at < 16; ++at) {
    value.board_name[at] = get_u8(bytes + at);
  }
  value.emergency_stop = get_u8(bytes + 16);
  value.supply_full_dv = get_u8(bytes + 17);
  value.supply_min_dv = get_u8(bytes + 18);
  return Reading::kOk;
}

/// Index of the first field out of its range; an array is one field.
inline int8_t first_out_of_range(const Equipment& value) {
  if (value.emergency_stop > 1U) {
    return 1;
  }
  return kNone;
}

inline int8_t inconsistent_axis(const Equipment&) {
  return kNone;
}

/// A fault as stored in EEPROM. The reader verifies `check`, which is wrong for a record that was
/// never written, or not completely.
struct FaultRecord {
  enum : uint8_t { kSize = 14 };

  /// Counts faults; 0 follows 0xFFFF.
  uint16_t number;
  /// The fault.
  uint8_t fault;
  /// State at the end of the previous tick.
  uint8_t state;
  /// As in `hello_reply`: the start during which it occurred.
  uint16_t boot_id;
  /// Tick in which it was detected, numbered as in reports. [tick]
  uint32_t tick;
  /// CRC-32 (ISO-HDLC) of the preceding bytes.
  uint32_t check;
};
static_assert(FaultRecord::kSize == sizeof(FaultRecord::number) + sizeof(FaultRecord::fault) +
              sizeof(FaultRecord::state) + sizeof(FaultRecord::boot_id) + sizeof(FaultRecord::tick)
              + sizeof(FaultRecord::check) && uint8_t{FaultRecord::kSize} <= kMaxPayload,
              "payload layout");

inline void encode(const FaultRecord& value, uint8_t* bytes) {
  if (lies_as_on_the_wire<FaultRecord>()) {
    __builtin_memcpy(bytes, &value, FaultRecord::kSize);
    return;
  }
  put_u16(bytes, value.number);
  put_u8(bytes + 2, value.fault);
  put_u8(bytes + 3, value.state);
  put_u16(bytes + 4, value.boot_id);
  put_u32(bytes + 6, value.tick);
  put_u32(bytes + 10, value.check);
}

inline Reading decode(const uint8_t* bytes, FaultRecord& value) {
  if (lies_as_on_the_wire<FaultRecord>()) {
    __builtin_memcpy(&value, bytes, FaultRecord::kSize);
    return Reading::kOk;
  }
  value.number = get_u16(bytes);
  value.fault = get_u8(bytes + 2);
  value.state = get_u8(bytes + 3);
  value.boot_id = get_u16(bytes + 4);
  value.tick = get_u32(bytes + 6);
  value.check = get_u32(bytes + 10);
  return Reading::kOk;
}

/// Index of the first field out of its range; an array is one field.
inline int8_t first_out_of_range(const FaultRecord&) {
  return kNone;
}

inline int8_t inconsistent_axis(const FaultRecord&) {
  return kNone;
}

/// Tick, setpoint, pulses, supply and the flags `axis_1_pulses`, `axis_2_pulses` and `moving` are
/// those of the last control tick; the rest is current.
struct StateReport {
  enum : uint8_t { kSize = 15 + 6 * kAxes };

  /// Control ticks since the reset. [tick]
  uint32_t tick;
  /// State.
  State state;
  /// First fault since the last clear.
  Fault fault;
  /// Details. Bits of `status_flags`.
  uint8_t flags;
  /// Sequence number of the last accepted target; 0 before the first.
  uint8_t target_sequence;
  /// Time since the last accepted target in whole control ticks: 20 in the report of the first tick
  /// after it; 65535 before the first target, or if longer. [ms]
  uint16_t target_age_ms;
  /// Last accepted target, after clamping; 0 before the first. [0.01 deg]
  int16_t target_cdeg[kAxes];
  /// Angle that ramp and slew limit have reached. Clamping by `set_limits` is reported from the
  /// next tick on. [0.01 deg]
  int16_t setpoint_cdeg[kAxes];
  /// Pulses computed by the last tick, output from the start of the next frame; 0: no pulse. [0.5
  /// us]
  uint16_t pulse_half_us[kAxes];
  /// bad_crc + bad_encoding + bad_size + overruns, wrapping.
  uint16_t link_errors;
  /// Least free stack so far; 65535 if it is not measured. [byte]
  uint16_t free_stack_bytes;
  /// Servo supply in the last tick; 0 without a divider. [0.1 V]
  uint8_t supply_dv;
};
static_assert(StateReport::kSize == sizeof(StateReport::tick) + sizeof(StateReport::state) +
              sizeof(StateReport::fault) + sizeof(StateReport::flags) +
              sizeof(StateReport::target_sequence) + sizeof(StateReport::target_age_ms) +
              sizeof(StateReport::target_cdeg) + sizeof(StateReport::setpoint_cdeg) +
              sizeof(StateReport::pulse_half_us) + sizeof(StateReport::link_errors) +
              sizeof(StateReport::free_stack_bytes) + sizeof(StateReport::supply_dv) &&
              uint8_t{StateReport::kSize} <= kMaxPayload, "payload layout");

inline void encode(const StateReport& value, uint8_t* bytes) {
  if (lies_as_on_the_wire<StateReport>()) {
    __builtin_memcpy(bytes, &value, StateReport::kSize);
    return;
  }
  put_u32(bytes, value.tick);
  put_u8(bytes + 4, static_cast<uint8_t>(value.state));
  put_u8(bytes + 5, static_cast<uint8_t>(value.fault));
  put_u8(bytes + 6, value.flags);
  put_u8(bytes + 7, value.target_sequence);
  put_u16(bytes + 8, value.target_age_ms);
  for (uint8_t at = 0; at < kAxes; ++at) {
    put_i16(bytes + 10 + 2 * at, value.target_cdeg[at]);
  }
  for (uint8_t at = 0; at < kAxes; ++at) {
    put_i16(bytes + 10 + 2 * kAxes + 2 * at, value.setpoint_cdeg[at]);
  }
  for (uint8_t at = 0; at < kAxes; ++at) {
    put_u16(bytes + 10 + 4 * kAxes + 2 * at, value.pulse_half_us[at]);
  }
  put_u16(bytes + 10 + 6 * kAxes, value.link_errors);
  put_u16(bytes + 12 + 6 * kAxes, value.free_stack_bytes);
  put_u8(bytes + 14 + 6 * kAxes, value.supply_dv);
}

inline Reading decode(const uint8_t* bytes, StateReport& value) {
  value.tick = get_u32(bytes);
  if (!is_state(get_u8(bytes + 4))) {
    return Reading::kUndefinedValue;
  }
  value.state = static_cast<State>(get_u8(bytes + 4));
  if (!is_fault(get_u8(bytes + 5))) {
    return Reading::kUndefinedValue;
  }
  value.fault = static_cast<Fault>(get_u8(bytes + 5));
  value.flags = get_u8(bytes + 6);
  value.target_sequence = get_u8(bytes + 7);
  value.target_age_ms = get_u16(bytes + 8);
  for (uint8_t at = 0; at < kAxes; ++at) {
    value.target_cdeg[at] = get_i16(bytes + 10 + 2 * at);
  }
  for (uint8_t at = 0; at < kAxes; ++at) {
    value.setpoint_cdeg[at] = get_i16(bytes + 10 + 2 * kAxes + 2 * at);
  }
  for (uint8_t at = 0; at < kAxes; ++at) {
    value.pulse_half_us[at] = get_u16(bytes + 10 + 4 * kAxes + 2 * at);
  }
  value.link_errors = get_u16(bytes + 10 + 6 * kAxes);
  value.free_stack_bytes = get_u16(bytes + 12 + 6 * kAxes);
  value.supply_dv = get_u8(bytes + 14 + 6 * kAxes);
  return Reading::kOk;
}

/// Index of the first field out of its range; an array is one field.
inline int8_t first_out_of_range(const StateReport&) {
  return kNone;
}

inline int8_t inconsistent_axis(const StateReport&) {
  return kNone;
}

/// Asks for the identity of the board. The layout of `hello` and `hello_reply` is the same in all
/// protocol versions.
struct Hello {
  enum : uint8_t { kId = 0x01, kSize = 5 };

  /// Version the host speaks.
  uint8_t protocol_version;
  /// Hash of the spec the host was built from.
  uint32_t spec_hash;
};
static_assert(Hello::kSize == sizeof(Hello::protocol_version) + sizeof(Hello::spec_hash) &&
              uint8_t{Hello::kSize} <= kMaxPayload, "payload layout");

inline void encode(const Hello& value, uint8_t* payload) {
  if (lies_as_on_the_wire<Hello>()) {
    __builtin_memcpy(payload, &value, Hello::kSize);
    return;
  }
  put_u8(payload, value.protocol_version);
  put_u32(payload + 1, value.spec_hash);
}

inline Reading decode(const uint8_t* payload, uint8_t size, Hello& value) {
  if (size != Hello::kSize) {
    return Reading::kBadLength;
  }
  if (lies_as_on_the_wire<Hello>()) {
    __builtin_memcpy(&value, payload, Hello::kSize);
    return Reading::kOk;
  }
  value.protocol_version = get_u8(payload);
  value.spec_hash = get_u32(payload + 1);
  return Reading::kOk;
}

/// Index of the first field out of its range; an array is one field.
inline int8_t first_out_of_range(const Hello&) {
  return kNone;
}

inline int8_t inconsistent_axis(const Hello&) {
  return kNone;
}

/// Identity and limits of the board.
struct HelloReply {
  enum : uint8_t { kId = 0x81, kSize = 18 };

  /// Version the board speaks.
  uint8_t protocol_version;
  /// Hash of the spec the board was built from.
  uint32_t spec_hash;
  /// Major, minor, patch.
  uint8_t firmware_version[3];
  /// Counts resets, so that the host notices a restart.
  uint16_t boot_id;
  /// Why it last started.
  ResetCause reset_cause;
  /// What was found in EEPROM.
  EepromStatus eeprom_status;
  /// What it can do. Bits of `capabilities`.
  uint16_t capabilities;
  /// Number of servos, which is the length of fields with one element per axis.
  uint8_t axes;
  /// Longest payload it accepts. [byte]
  uint8_t max_payload;
  /// Period of the control tick. [us]
  uint16_t tick_us;
};
static_assert(HelloReply::kSize == sizeof(HelloReply::protocol_version) +
              sizeof(HelloReply::spec_hash) + sizeof(HelloReply::firmware_version) +
              sizeof(HelloReply::boot_id) + sizeof(HelloReply::reset_cause) +
              sizeof(HelloReply::eeprom_status) + sizeof(HelloReply::capabilities) +
              sizeof(HelloReply::axes) + sizeof(HelloReply::max_payload) +
              sizeof(HelloReply::tick_us) && uint8_t{HelloReply::kSize} <= kMaxPayload,
              "payload layout");

inline void encode(const HelloReply& value, uint8_t* payload) {
  if (lies_as_on_the_wire<HelloReply>()) {
    __builtin_memcpy(payload, &value, HelloReply::kSize);
    return;
  }
  put_u8(payload, value.protocol_version);
  put_u32(payload + 1, value.spec_hash);
  put_u8(payload + 5, value.firmware_version[0]);
  put_u8(payload + 6, value.firmware_version[1]);
  put_u8(payload + 7, value.firmware_version[2]);
  put_u16(payload + 8, value.boot_id);
  put_u8(payload + 10, static_cast<uint8_t>(value.reset_cause));
  put_u8(payload + 11, static_cast<uint8_t>(value.eeprom_status));
  put_u16(payload + 12, value.capabilities);
  put_u8(payload + 14, value.axes);
  put_u8(payload + 15, value.max_payload);
  put_u16(payload + 16, value.tick_us);
}

inline Reading decode(const uint8_t* payload, uint8_t size, HelloReply& value) {
  if (size != HelloReply::kSize) {
    return Reading::kBadLength;
  }
  value.protocol_version = get_u8(payload);
  value.spec_hash = get_u32(payload + 1);
  value.firmware_version[0] = get_u8(payload + 5);
  value.firmware_version[1] = get_u8(payload + 6);
  value.firmware_version[2] = get_u8(payload + 7);
  value.boot_id = get_u16(payload + 8);
  if (!is_reset_cause(get_u8(payload + 10))) {
    return Reading::kUndefinedValue;
  }
  value.reset_cause = static_cast<ResetCause>(get_u8(payload + 10));
  if (!is_eeprom_status(get_u8(payload + 11))) {
    return Reading::kUndefinedValue;
  }
  value.eeprom_status = static_cast<EepromStatus>(get_u8(payload + 11));
  value.capabilities = get_u16(payload + 12);
  value.axes = get_u8(payload + 14);
  value.max_payload = get_u8(payload + 15);
  value.tick_us = get_u16(payload + 16);
  return Reading::kOk;
}

/// Index of the first field out of its range; an array is one field.
inline int8_t first_out_of_range(const HelloReply&) {
  return kNone;
}

inline int8_t inconsistent_axis(const HelloReply&) {
  return kNone;
}

/// Opens a session and ends any other, so that requests of another host are refused from then on.
/// The state does not change; the telemetry stream ends and the memory of answered requests is
/// cleared.
struct OpenSession {
  enum : uint8_t { kId = 0x02, kSize = 6 };

  /// Hash of the spec the host was built from; must be that of the board.
  uint32_t spec_hash;
  /// Chosen at random by the host. Every request that changes something carries it, so that the
  /// board obeys neither noise nor a superseded host. 1 to 65535.
  uint16_t session;
};
static_assert(OpenSession::kSize == sizeof(OpenSession::spec_hash) + sizeof(OpenSession::session) &&
              uint8_t{OpenSession::kSize} <= kMaxPayload, "payload layout");

inline void encode(const OpenSession& value, uint8_t* payload) {
  if (lies_as_on_the_wire<OpenSession>()) {
    __builtin_memcpy(payload, &value, OpenSession::kSize);
    return;
  }
  put_u32(payload, value.spec_hash);
  put_u16(payload + 4, value.session);
}

inline Reading decode(const uint8_t* payload, uint8_t size, OpenSession& value) {
  if (size != OpenSession::kSize) {
    return Reading::kBadLength;
  }
  if (lies_as_on_the_wire<OpenSession>()) {
    __builtin_memcpy(&value, payload, OpenSession::kSize);
    return Reading::kOk;
  }
  value.spec_hash = get_u32(payload);
  value.session = get_u16(payload + 4);
  return Reading::kOk;
}

/// Index of the first field out of its range; an array is one field.
inline int8_t first_out_of_range(const OpenSession& value) {
  if (value.session < 1U) {
    return 1;
  }
  return kNone;
}

inline int8_t inconsistent_axis(const OpenSession&) {
  return kNone;
}

/// The session is open.
struct SessionReply {
  enum : uint8_t { kId = 0x82, kSize = 5 };

  /// The open session.
  uint16_t session;
  /// As in `hello_reply`.
  uint16_t boot_id;
  /// State.
  State state;
};
static_assert(SessionReply::kSize == sizeof(SessionReply::session) + sizeof(SessionReply::boot_id) +
              sizeof(SessionReply::state) && uint8_t{SessionReply::kSize} <= kMaxPayload,
              "payload layout");

inline void encode(const SessionReply& value, uint8_t* payload) {
  if (lies_as_on_the_wire<SessionReply>()) {
    __builtin_memcpy(payload, &value, SessionReply::kSize);
    return;
  }
  put_u16(payload, value.session);
  put_u16(payload + 2, value.boot_id);
  put_u8(payload + 4, static_cast<uint8_t>(value.state));
}

inline Reading decode(const uint8_t* payload, uint8_t size, SessionReply& value) {
  if (size != SessionReply::kSize) {
    return Reading::kBadLength;
  }
  value.session = get_u16(payload);
  value.boot_id = get_u16(payload + 2);
  if (!is_state(get_u8(payload + 4))) {
    return Reading::kUndefinedValue;
  }
  value.state = static_cast<State>(get_u8(payload + 4));
  return Reading::kOk;
}

/// Index of the first field out of its range; an array is one field.
inline int8_t first_out_of_range(const SessionReply&) {
  return kNone;
}

inline int8_t inconsistent_axis(const SessionReply&) {
  return kNone;
}

/// Reads the board's clock, to relate it to the host's.
struct ClockSync {
  enum : uint8_t { kId = 0x03, kSize = 4 };

  /// Any value; returned in the reply. [us]
  uint32_t host_time_us;
};
static_assert(ClockSync::kSize == sizeof(ClockSync::host_time_us) && uint8_t{ClockSync::kSize} <=
              kMaxPayload, "payload layout");

inline void encode(const ClockSync& value, uint8_t* payload) {
  if (lies_as_on_the_wire<ClockSync>()) {
    __builtin_memcpy(payload, &value, ClockSync::kSize);
    return;
  }
  put_u32(payload, value.host_time_us);
}

inline Reading decode(const uint8_t* payload, uint8_t size, ClockSync& value) {
  if (size != ClockSync::kSize) {
    return Reading::kBadLength;
  }
  if (lies_as_on_the_wire<ClockSync>()) {
    __builtin_memcpy(&value, payload, ClockSync::kSize);
    return Reading::kOk;
  }
  value.host_time_us = get_u32(payload);
  return Reading::kOk;
}

/// Index of the first field out of its range; an array is one field.
inline int8_t first_out_of_range(const ClockSync&) {
  return kNone;
}

inline int8_t inconsistent_axis(const ClockSync&) {
  return kNone;
}

/// The board's clock when the request was dispatched.
struct ClockReply {
  enum : uint8_t { kId = 0x83, kSize = 8 };

  /// From the request. [us]
  uint32_t host_time_us;
  /// Since the reset; wraps after 71.6 minutes. [us]
  uint32_t board_time_us;
};
static_assert(ClockReply::kSize == sizeof(ClockReply::host_time_us) +
              sizeof(ClockReply::board_time_us) && uint8_t{ClockReply::kSize} <= kMaxPayload,
              "payload layout");

inline void encode(const ClockReply& value, uint8_t* payload) {
  if (lies_as_on_the_wire<ClockReply>()) {
    __builtin_memcpy(payload, &value, ClockReply::kSize);
    return;
  }
  put_u32(payload, value.host_time_us);
  put_u32(payload + 4, value.board_time_us);
}

inline Reading decode(const uint8_t* payload, uint8_t size, ClockReply& value) {
  if (size != ClockReply::kSize) {
    return Reading::kBadLength;
  }
  if (lies_as_on_the_wire<ClockReply>()) {
    __builtin_memcpy(&value, payload, ClockReply::kSize);
    return Reading::kOk;
  }
  value.host_time_us = get_u32(payload);
  value.board_time_us = get_u32(payload + 4);
  return Reading::kOk;
}

/// Index of the first field out of its range; an array is one field.
inline int8_t first_out_of_range(const ClockReply&) {
  return kNone;
}

inline int8_t inconsistent_axis(const ClockReply&) {
  return kNone;
}

/// Reads the state once.
struct GetState {
  enum : uint8_t { kId = 0x07, kSize = 0 };
};
static_assert(GetState::kSize == 0 && uint8_t{GetState::kSize} <= kMaxPayload, "payload layout");

inline void encode(const GetState&, uint8_t*) {}

inline Reading decode(const uint8_t*, uint8_t size, GetState&) {
  if (size != GetState::kSize) {
    return Reading::kBadLength;
  }
  return Reading::kOk;
}

/// Index of the first field out of its range; an array is one field.
inline int8_t first_out_of_range(const GetState&) {
  return kNone;
}

inline int8_t inconsistent_axis(const GetState&) {
  return kNone;
}

/// The state.
struct StateReply {
  enum : uint8_t { kId = 0x87, kSize = 15 + 6 * kAxes };

  StateReport report;
};
static_assert(StateReply::kSize == 0 + StateReport::kSize && uint8_t{StateReply::kSize} <=
              kMaxPayload, "payload layout");

inline void encode(const StateReply& value, uint8_t* payload) {
  if (lies_as_on_the_wire<StateReply>()) {
    __builtin_memcpy(payload, &value, StateReply::kSize);
    return;
  }
  encode(value.report, payload);
}

inline Reading decode(const uint8_t* payload, uint8_t size, StateReply& value) {
  if (size != StateReply::kSize) {
    return Reading::kBadLength;
  }
  return decode(payload, value.report);
}

/// Index of the first field out of its range; an array is one field.
inline int8_t first_out_of_range(const StateReply&) {
  return kNone;
}

inline int8_t inconsistent_axis(const StateReply&) {
  return kNone;
}

/// Reads the counters, which start at 0 at a reset and wrap.
struct GetCounters {
  enum : uint8_t { kId = 0x05, kSize = 0 };
};
static_assert(GetCounters::kSize == 0 && uint8_t{GetCounters::kSize} <= kMaxPayload,
              "payload layout");

inline void encode(const GetCounters&, uint8_t*) {}

inline Reading decode(const uint8_t*, uint8_t size, GetCounters&) {
  if (size != GetCounters::kSize) {
    return Reading::kBadLength;
  }
  return Reading::kOk;
}

/// Index of the first field out of its range; an array is one field.
inline int8_t first_out_of_range(const GetCounters&) {
  return kNone;
}

inline int8_t inconsistent_axis(const GetCounters&) {
  return kNone;
}

/// The counters since the reset.
struct CountersReply {
  enum : uint8_t { kId = 0x85, kSize = 30 };

  /// Frames with a good CRC.
  uint32_t frames_accepted;
  /// Frames with a bad CRC. They are not answered.
  uint16_t bad_crc;
  /// Frames that are not COBS.
  uint16_t bad_encoding;
  /// Frames that are too short or too long.
  uint16_t bad_size;
  /// Bytes lost because they were not read in time.
  uint16_t overruns;
  /// Frames that were not sent because the send buffer was full.
  uint16_t replies_dropped;
  /// Requests refused.
  uint16_t nacks;
  /// Requests answered from memory.
  uint16_t repeats_answered;
  /// Accepted targets.
  uint32_t targets_accepted;
  /// Accepted targets that had to be clamped.
  uint16_t targets_clamped;
  /// Entries into `hold` from `active`.
  uint16_t holds;
  /// Entries into `relaxing`.
  uint16_t relaxes;
  /// Saves finished.
  uint16_t saves;
};
static_assert(CountersReply::kSize == sizeof(CountersReply::frames_accepted) +
              sizeof(CountersReply::bad_crc) + sizeof(CountersReply::bad_encoding) +
              sizeof(CountersReply::bad_size) + sizeof(CountersReply::overruns) +
              sizeof(CountersReply::replies_dropped) + sizeof(CountersReply::nacks) +
              sizeof(CountersReply::repeats_answered) + sizeof(CountersReply::targets_accepted) +
              sizeof(CountersReply::targets_clamped) + sizeof(CountersReply::holds) +
              sizeof(CountersReply::relaxes) + sizeof(CountersReply::saves) &&
              uint8_t{CountersReply::kSize} <= kMaxPayload, "payload layout");

inline void encode(const CountersReply& value, uint8_t* payload) {
  if (lies_as_on_the_wire<CountersReply>()) {
    __builtin_memcpy(payload, &value, CountersReply::kSize);
    return;
  }
  put_u32(payload, value.frames_accepted);
  put_u16(payload + 4, value.bad_crc);
  put_u16(payload + 6, value.bad_encoding);
  put_u16(payload + 8, value.bad_size);
  put_u16(payload + 10, value.overruns);
  put_u16(payload + 12, value.replies_dropped);
  put_u16(payload + 14, value.nacks);
  put_u16(payload + 16, value.repeats_answered);
  put_u32(payload + 18, value.targets_accepted);
  put_u16(payload + 22, value.targets_clamped);
  put_u16(payload + 24, value.holds);
  put_u16(payload + 26, value.relaxes);
  put_u16(payload + 28, value.saves);
}

inline Reading decode(const uint8_t* payload, uint8_t size, CountersReply& value) {
  if (size != CountersReply::kSize) {
    return Reading::kBadLength;
  }
  if (lies_as_on_the_wire<CountersReply>()) {
    __builtin_memcpy(&value, payload, CountersReply::kSize);
    return Reading::kOk;
  }
  value.frames_accepted = get_u32(payload);
  value.bad_crc = get_u16(payload + 4);
  value.bad_encoding = get_u16(payload + 6);
  value.bad_size = get_u16(payload + 8);
  value.overruns = get_u16(payload + 10);
  value.replies_dropped = get_u16(payload + 12);
  value.nacks = get_u16(payload + 14);
  value.repeats_answered = get_u16(payload + 16);
  value.targets_accepted = get_u32(payload + 18);
  value.targets_clamped = get_u16(payload + 22);
  value.holds = get_u16(payload + 24);
  value.relaxes = get_u16(payload + 26);
  value.saves = get_u16(payload + 28);
  return Reading::kOk;
}

/// Index of the first field out of its range; an array is one field.
inline int8_t first_out_of_range(const CountersReply&) {
  return kNone;
}

inline int8_t inconsistent_axis(const CountersReply&) {
  return kNone;
}

/// Starts or stops the stream of `telemetry`.
struct SetTelemetry {
  enum : uint8_t { kId = 0x06, kSize = 3 };

  /// The open session.
  uint16_t session;
  /// Ticks per report; 0 stops the stream. [tick]
  uint8_t period_ticks;
};
static_assert(SetTelemetry::kSize == sizeof(SetTelemetry::session) +
              sizeof(SetTelemetry::period_ticks) && uint8_t{SetTelemetry::kSize} <= kMaxPayload,
              "payload layout");

inline void encode(const SetTelemetry& value, uint8_t* payload) {
  if (lies_as_on_the_wire<SetTelemetry>()) {
    __builtin_memcpy(payload, &value, SetTelemetry::kSize);
    return;
  }
  put_u16(payload, value.session);
  put_u8(payload + 2, value.period_ticks);
}

inline Reading decode(const uint8_t* payload, uint8_t size, SetTelemetry& value) {
  if (size != SetTelemetry::kSize) {
    return Reading::kBadLength;
  }
  if (lies_as_on_the_wire<SetTelemetry>()) {
    __builtin_memcpy(&value, payload, SetTelemetry::kSize);
    return Reading::kOk;
  }
  value.session = get_u16(payload);
  value.period_ticks = get_u8(payload + 2);
  return Reading::kOk;
}

/// Index of the first field out of its range; an array is one field.
inline int8_t first_out_of_range(const SetTelemetry&) {
  return kNone;
}

inline int8_t inconsistent_axis(const SetTelemetry&) {
  return kNone;
}

/// Makes the LED blink to identify one of several boards. Needs no session and changes nothing
/// else.
struct Blink {
  enum : uint8_t { kId = 0x08, kSize = 1 };

  /// Duration of the blinking from the next tick on; 0 stops it. [s] 0 to 60.
  uint8_t duration_s;
};
static_assert(Blink::kSize == sizeof(Blink::duration_s) && uint8_t{Blink::kSize} <= kMaxPayload,
              "payload layout");

inline void encode(const Blink& value, uint8_t* payload) {
  if (lies_as_on_the_wire<Blink>()) {
    __builtin_memcpy(payload, &value, Blink::kSize);
    return;
  }
  put_u8(payload, value.duration_s);
}

inline Reading decode(const uint8_t* payload, uint8_t size, Blink& value) {
  if (size != Blink::kSize) {
    return Reading::kBadLength;
  }
  if (lies_as_on_the_wire<Blink>()) {
    __builtin_memcpy(&value, payload, Blink::kSize);
    return Reading::kOk;
  }
  value.duration_s = get_u8(payload);
  return Reading::kOk;
}

/// Index of the first field out of its range; an array is one field.
inline int8_t first_out_of_range(const Blink& value) {
  if (value.duration_s > 60U) {
    return 0;
  }
  return kNone;
}

inline int8_t inconsistent_axis(const Blink&) {
  return kNone;
}

/// Reads a record of the fault log. Refused with busy while a byte is being written to EEPROM.
struct GetFaultRecord {
  enum : uint8_t { kId = 0x09, kSize = 1 };

  /// Place of the record in EEPROM; the records' numbers tell which is the newest. 0 to 7.
  uint8_t place;
};
static_assert(GetFaultRecord::kSize == sizeof(GetFaultRecord::place) &&
              uint8_t{GetFaultRecord::kSize} <= kMaxPayload, "payload layout");

inline void encode(const GetFaultRecord& value, uint8_t* payload) {
  if (lies_as_on_the_wire<GetFaultRecord>()) {
    __builtin_memcpy(payload, &value, GetFaultRecord::kSize);
    return;
  }
  put_u8(payload, value.place);
}

inline Reading decode(const uint8_t* payload, uint8_t size, GetFaultRecord& value) {
  if (size != GetFaultRecord::kSize) {
    return Reading::kBadLength;
  }
  if (lies_as_on_the_wire<GetFaultRecord>()) {
    __builtin_memcpy(&value, payload, GetFaultRecord::kSize);
    return Reading::kOk;
  }
  value.place = get_u8(payload);
  return Reading::kOk;
}

/// Index of the first field out of its range; an array is one field.
inline int8_t first_out_of_range(const GetFaultRecord& value) {
  if (value.place > 7U) {
    return 0;
  }
  return kNone;
}

inline int8_t inconsistent_axis(const GetFaultRecord&) {
  return kNone;
}

/// The record as it is in EEPROM.
struct FaultRecordReply {
  enum : uint8_t { kId = 0x89, kSize = 14 };

  FaultRecord record;
};
static_assert(FaultRecordReply::kSize == 0 + FaultRecord::kSize && uint8_t{FaultRecordReply::kSize}
              <= kMaxPayload, "payload layout");

inline void encode(const FaultRecordReply& value, uint8_t* payload) {
  if (lies_as_on_the_wire<FaultRecordReply>()) {
    __builtin_memcpy(payload, &value, FaultRecordReply::kSize);
    return;
  }
  encode(value.record, payload);
}

inline Reading decode(const uint8_t* payload, uint8_t size, FaultRecordReply& value) {
  if (size != FaultRecordReply::kSize) {
    return Reading::kBadLength;
  }
  if (lies_as_on_the_wire<FaultRecordReply>()) {
    __builtin_memcpy(&value, payload, FaultRecordReply::kSize);
    return Reading::kOk;
  }
  return decode(payload, value.record);
}

/// Index of the first field out of its range; an array is one field.
inline int8_t first_out_of_range(const FaultRecordReply&) {
  return kNone;
}

inline int8_t inconsistent_axis(const FaultRecordReply&) {
  return kNone;
}

/// Asks how much a host may have outstanding. Until it knows, a host sends one request at a time.
struct GetLinkLimits {
  enum : uint8_t { kId = 0x0A, kSize = 0 };
};
static_assert(GetLinkLimits::kSize == 0 && uint8_t{GetLinkLimits::kSize} <= kMaxPayload,
              "payload layout");

inline void encode(const GetLinkLimits&, uint8_t*) {}

inline Reading decode(const uint8_t*, uint8_t size, GetLinkLimits&) {
  if (size != GetLinkLimits::kSize) {
    return Reading::kBadLength;
  }
  return Reading::kOk;
}

/// Index of the first field out of its range; an array is one field.
inline int8_t first_out_of_range(const GetLinkLimits&) {
  return kNone;
}

inline int8_t inconsistent_axis(const GetLinkLimits&) {
  return kNone;
}

/// What a host may have outstanding, in place of the constants of the same names.
struct LinkLimitsReply {
  enum : uint8_t { kId = 0x8A, kSize = 3 };

  /// Number of requests without a reply. [request] 1 to 255.
  uint8_t outstanding_requests;
  /// Their bytes in total, as encoded frames; a single request may be longer. [byte]
  uint16_t outstanding_bytes;
};
static_assert(LinkLimitsReply::kSize == sizeof(LinkLimitsReply::outstanding_requests) +
              sizeof(LinkLimitsReply::outstanding_bytes) && uint8_t{LinkLimitsReply::kSize} <=
              kMaxPayload, "payload layout");

inline void encode(const LinkLimitsReply& value, uint8_t* payload) {
  if (lies_as_on_the_wire<LinkLimitsReply>()) {
    __builtin_memcpy(payload, &value, LinkLimitsReply::kSize);
    return;
  }
  put_u8(payload, value.outstanding_requests);
  put_u16(payload + 1, value.outstanding_bytes);
}

inline Reading decode(const uint8_t* payload, uint8_t size, LinkLimitsReply& value) {
  if (size != LinkLimitsReply::kSize) {
    return Reading::kBadLength;
  }
  if (lies_as_on_the_wire<LinkLimitsReply>()) {
    __builtin_memcpy(&value, payload, LinkLimitsReply::kSize);
    return Reading::kOk;
  }
  value.outstanding_requests = get_u8(payload);
  value.outstanding_bytes = get_u16(payload + 1);
  return Reading::kOk;
}

/// Index of the first field out of its range; an array is one field.
inline int8_t first_out_of_range(const LinkLimitsReply& value) {
  if (value.outstanding_requests < 1U) {
    return 0;
  }
  return kNone;
}

inline int8_t inconsistent_axis(const LinkLimitsReply&) {
  return kNone;
}

/// Enables the servos one after another. Refused while the configuration is incomplete or being
/// saved.
struct Arm {
  enum : uint8_t { kId = 0x10, kSize = 2 };

  /// The open session.
  uint16_t session;
};
static_assert(Arm::kSize == sizeof(Arm::session) && uint8_t{Arm::kSize} <= kMaxPayload,
              "payload layout");

inline void encode(const Arm& value, uint8_t* payload) {
  if (lies_as_on_the_wire<Arm>()) {
    __builtin_memcpy(payload, &value, Arm::kSize);
    return;
  }
  put_u16(payload, value.session);
}

inline Reading decode(const uint8_t* payload, uint8_t size, Arm& value) {
  if (size != Arm::kSize) {
    return Reading::kBadLength;
  }
  if (lies_as_on_the_wire<Arm>()) {
    __builtin_memcpy(&value, payload, Arm::kSize);
    return Reading::kOk;
  }
  value.session = get_u16(payload);
  return Reading::kOk;
}

/// Index of the first field out of its range; an array is one field.
inline int8_t first_out_of_range(const Arm&) {
  return kNone;
}

inline int8_t inconsistent_axis(const Arm&) {
  return kNone;
}

/// Moves the robot slowly to rest, then switches off the pulses. No effect in `disarmed` and
/// `disarming`.
struct Disarm {
  enum : uint8_t { kId = 0x11, kSize = 2 };

  /// The open session.
  uint16_t session;
};
static_assert(Disarm::kSize == sizeof(Disarm::session) && uint8_t{Disarm::kSize} <= kMaxPayload,
              "payload layout");

inline void encode(const Disarm& value, uint8_t* payload) {
  if (lies_as_on_the_wire<Disarm>()) {
    __builtin_memcpy(payload, &value, Disarm::kSize);
    return;
  }
  put_u16(payload, value.session);
}

inline Reading decode(const uint8_t* payload, uint8_t size, Disarm& value) {
  if (size != Disarm::kSize) {
    return Reading::kBadLength;
  }
  if (lies_as_on_the_wire<Disarm>()) {
    __builtin_memcpy(&value, payload, Disarm::kSize);
    return Reading::kOk;
  }
  value.session = get_u16(payload);
  return Reading::kOk;
}

/// Index of the first field out of its range; an array is one field.
inline int8_t first_out_of_range(const Disarm&) {
  return kNone;
}

inline int8_t inconsistent_axis(const Disarm&) {
  return kNone;
}

/// Emergency stop: switches off the pulses at the next frame. Needs no session.
struct Stop {
  enum : uint8_t { kId = 0x12, kSize = 0 };
};
static_assert(Stop::kSize == 0 && uint8_t{Stop::kSize} <= kMaxPayload, "payload layout");

inline void encode(const Stop&, uint8_t*) {}

inline Reading decode(const uint8_t*, uint8_t size, Stop&) {
  if (size != Stop::kSize) {
    return Reading::kBadLength;
  }
  return Reading::kOk;
}

/// Index of the first field out of its range; an array is one field.
inline int8_t first_out_of_range(const Stop&) {
  return kNone;
}

inline int8_t inconsistent_axis(const Stop&) {
  return kNone;
}

/// Acknowledges a fault or a stop once the pulses are off. The board is then disarmed; it never
/// arms by itself.
struct ClearFault {
  enum : uint8_t { kId = 0x13, kSize = 2 };

  /// The open session.
  uint16_t session;
};
static_assert(ClearFault::kSize == sizeof(ClearFault::session) && uint8_t{ClearFault::kSize} <=
              kMaxPayload, "payload layout");

inline void encode(const ClearFault& value, uint8_t* payload) {
  if (lies_as_on_the_wire<ClearFault>()) {
    __builtin_memcpy(payload, &value, ClearFault::kSize);
    return;
  }
  put_u16(payload, value.session);
}

inline Reading decode(const uint8_t* payload, uint8_t size, ClearFault& value) {
  if (size != ClearFault::kSize) {
    return Reading::kBadLength;
  }
  if (lies_as_on_the_wire<ClearFault>()) {
    __builtin_memcpy(&value, payload, ClearFault::kSize);
    return Reading::kOk;
  }
  value.session = get_u16(payload);
  return Reading::kOk;
}

/// Index of the first field out of its range; an array is one field.
inline int8_t first_out_of_range(const ClearFault&) {
  return kNone;
}

inline int8_t inconsistent_axis(const ClearFault&) {
  return kNone;
}

/// New target of all axes, which replaces the previous one. No other message feeds the link
/// watchdog.
struct SetTarget {
  enum : uint8_t { kId = 0x20, kSize = 6 + 2 * kAxes };

  /// The open session.
  uint16_t session;
  /// Servo angles; clamped to the angle limits. [0.01 deg] -18000 to 18000.
  int16_t target_cdeg[kAxes];
  /// The setpoint moves there linearly in this time, or more slowly if the slew limit requires it.
  /// [ms] 0 to 10000.
  uint16_t ramp_ms;
  /// The board holds its pose if no other target follows within this time. [ms] 20 to 10000.
  uint16_t validity_ms;
};
static_assert(SetTarget::kSize == sizeof(SetTarget::session) + sizeof(SetTarget::target_cdeg) +
              sizeof(SetTarget::ramp_ms) + sizeof(SetTarget::validity_ms) &&
              uint8_t{SetTarget::kSize} <= kMaxPayload, "payload layout");

inline void encode(const SetTarget& value, uint8_t* payload) {
  if (lies_as_on_the_wire<SetTarget>()) {
    __builtin_memcpy(payload, &value, SetTarget::kSize);
    return;
  }
  put_u16(payload, value.session);
  for (uint8_t at = 0; at < kAxes; ++at) {
    put_i16(payload + 2 + 2 * at, value.target_cdeg[at]);
  }
  put_u16(payload + 2 + 2 * kAxes, value.ramp_ms);
  put_u16(payload + 4 + 2 * kAxes, value.validity_ms);
}

inline Reading decode(const uint8_t* payload, uint8_t size, SetTarget& value) {
  if (size != SetTarget::kSize) {
    return Reading::kBadLength;
  }
  if (lies_as_on_the_wire<SetTarget>()) {
    __builtin_memcpy(&value, payload, SetTarget::kSize);
    return Reading::kOk;
  }
  value.session = get_u16(payload);
  for (uint8_t at = 0; at < kAxes; ++at) {
    value.target_cdeg[at] = get_i16(payload + 2 + 2 * at);
  }
  value.ramp_ms = get_u16(payload + 2 + 2 * kAxes);
  value.validity_ms = get_u16(payload + 4 + 2 * kAxes);
  return Reading::kOk;
}

/// Index of the first field out of its range; an array is one field.
inline int8_t first_out_of_range(const SetTarget& value) {
  for (uint8_t at = 0; at < kAxes; ++at) {
    if (value.target_cdeg[at] < -18000 || value.target_cdeg[at] > 18000) {
      return 1;
    }
  }
  if (value.ramp_ms > 10000U) {
    return 2;
  }
  if (value.validity_ms < 20U || value.validity_ms > 10000U) {
    return 3;
  }
  return kNone;
}

inline int8_t inconsistent_axis(const SetTarget&) {
  return kNone;
}

/// The fields of `set_target`, and the tick for which the target waits (TGT-5). Only the newest one
/// waits; it feeds the link watchdog when it takes effect.
struct SetTargetAt {
  enum : uint8_t { kId = 0x21, kSize = 10 + 2 * kAxes };

  /// The open session.
  uint16_t session;
  /// As in `set_target`. [0.01 deg] -18000 to 18000.
  int16_t target_cdeg[kAxes];
  /// As in `set_target`, from that tick on. [ms] 0 to 10000.
  uint16_t ramp_ms;
  /// As in `set_target`, from that tick on. [ms] 20 to 10000.
  uint16_t validity_ms;
  /// Tick at which it takes effect, numbered as in reports; refused with out_of_range unless it is
  /// ahead. [tick]
  uint32_t tick;
};
static_assert(SetTargetAt::kSize == sizeof(SetTargetAt::session) + sizeof(SetTargetAt::target_cdeg)
              + sizeof(SetTargetAt::ramp_ms) + sizeof(SetTargetAt::validity_ms) +
              sizeof(SetTargetAt::tick) && uint8_t{SetTargetAt::kSize} <= kMaxPayload,
              "payload layout");

inline void encode(const SetTargetAt& value, uint8_t* payload) {
  if (lies_as_on_the_wire<SetTargetAt>()) {
    __builtin_memcpy(payload, &value, SetTargetAt::kSize);
    return;
  }
  put_u16(payload, value.session);
  for (uint8_t at = 0; at < kAxes; ++at) {
    put_i16(payload + 2 + 2 * at, value.target_cdeg[at]);
  }
  put_u16(payload + 2 + 2 * kAxes, value.ramp_ms);
  put_u16(payload + 4 + 2 * kAxes, value.validity_ms);
  put_u32(payload + 6 + 2 * kAxes, value.tick);
}

inline Reading decode(const uint8_t* payload, uint8_t size, SetTargetAt& value) {
  if (size != SetTargetAt::kSize) {
    return Reading::kBadLength;
  }
  if (lies_as_on_the_wire<SetTargetAt>()) {
    __builtin_memcpy(&value, payload, SetTargetAt::kSize);
    return Reading::kOk;
  }
  value.session = get_u16(payload);
  for (uint8_t at = 0; at < kAxes; ++at) {
    value.target_cdeg[at] = get_i16(payload + 2 + 2 * at);
  }
  value.ramp_ms = get_u16(payload + 2 + 2 * kAxes);
  value.validity_ms = get_u16(payload + 4 + 2 * kAxes);
  value.tick = get_u32(payload + 6 + 2 * kAxes);
  return Reading::kOk;
}

/// Index of the first field out of its range; an array is one field.
inline int8_t first_out_of_range(const SetTargetAt& value) {
  for (uint8_t at = 0; at < kAxes; ++at) {
    if (value.target_cdeg[at] < -18000 || value.target_cdeg[at] > 18000) {
      return 1;
    }
  }
  if (value.ramp_ms > 10000U) {
    return 2;
  }
  if (value.validity_ms < 20U || value.validity_ms > 10000U) {
    return 3;
  }
  return kNone;
}

inline int8_t inconsistent_axis(const SetTargetAt&) {
  return kNone;
}

/// The target as accepted.
struct TargetReply {
  enum : uint8_t { kId = 0xA0, kSize = 2 + 2 * kAxes };

  /// State.
  State state;
  /// Details. Bits of `status_flags`.
  uint8_t flags;
  /// Accepted target, after clamping. [0.01 deg]
  int16_t target_cdeg[kAxes];
};
static_assert(TargetReply::kSize == sizeof(TargetReply::state) + sizeof(TargetReply::flags) +
              sizeof(TargetReply::target_cdeg) && uint8_t{TargetReply::kSize} <= kMaxPayload,
              "payload layout");

inline void encode(const TargetReply& value, uint8_t* payload) {
  if (lies_as_on_the_wire<TargetReply>()) {
    __builtin_memcpy(payload, &value, TargetReply::kSize);
    return;
  }
  put_u8(payload, static_cast<uint8_t>(value.state));
  put_u8(payload + 1, value.flags);
  for (uint8_t at = 0; at < kAxes; ++at) {
    put_i16(payload + 2 + 2 * at, value.target_cdeg[at]);
  }
}

inline Reading decode(const uint8_t* payload, uint8_t size, TargetReply& value) {
  if (size != TargetReply::kSize) {
    return Reading::kBadLength;
  }
  if (!is_state(get_u8(payload))) {
    return Reading::kUndefinedValue;
  }
  value.state = static_cast<State>(get_u8(payload));
  value.flags = get_u8(payload + 1);
  for (uint8_t at = 0; at < kAxes; ++at) {
    value.target_cdeg[at] = get_i16(payload + 2 + 2 * at);
  }
  return Reading::kOk;
}

/// Index of the first field out of its range; an array is one field.
inline int8_t first_out_of_range(const TargetReply&) {
  return kNone;
}

inline int8_t inconsistent_axis(const TargetReply&) {
  return kNone;
}

/// Reads the angle limits.
struct GetLimits {
  enum : uint8_t { kId = 0x30, kSize = 0 };
};
static_assert(GetLimits::kSize == 0 && uint8_t{GetLimits::kSize} <= kMaxPayload, "payload layout");

inline void encode(const GetLimits&, uint8_t*) {}

inline Reading decode(const uint8_t*, uint8_t size, GetLimits&) {
  if (size != GetLimits::kSize) {
    return Reading::kBadLength;
  }
  return Reading::kOk;
}

/// Index of the first field out of its range; an array is one field.
inline int8_t first_out_of_range(const GetLimits&) {
  return kNone;
}

inline int8_t inconsistent_axis(const GetLimits&) {
  return kNone;
}

/// The angle limits in use.
struct LimitsReply {
  enum : uint8_t { kId = 0xB0, kSize = 6 * kAxes };

  Limits limits;
};
static_assert(LimitsReply::kSize == 0 + Limits::kSize && uint8_t{LimitsReply::kSize} <= kMaxPayload,
              "payload layout");

inline void encode(const LimitsReply& value, uint8_t* payload) {
  if (lies_as_on_the_wire<LimitsReply>()) {
    __builtin_memcpy(payload, &value, LimitsReply::kSize);
    return;
  }
  encode(value.limits, payload);
}

inline Reading decode(const uint8_t* payload, uint8_t size, LimitsReply& value) {
  if (size != LimitsReply::kSize) {
    return Reading::kBadLength;
  }
  if (lies_as_on_the_wire<LimitsReply>()) {
    __builtin_memcpy(&value, payload, LimitsReply::kSize);
    return Reading::kOk;
  }
  return decode(payload, value.limits);
}

/// Index of the first field out of its range; an array is one field.
inline int8_t first_out_of_range(const LimitsReply& value) {
  return first_out_of_range(value.limits);
}

inline int8_t inconsistent_axis(const LimitsReply& value) {
  return inconsistent_axis(value.limits);
}

/// Sets the angle limits. The stored setpoint is clamped to them.
struct SetLimits {
  enum : uint8_t { kId = 0x31, kSize = 2 + 6 * kAxes };

  /// The open session.
  uint16_t session;
  Limits limits;
};
static_assert(SetLimits::kSize == sizeof(SetLimits::session) + Limits::kSize &&
              uint8_t{SetLimits::kSize} <= kMaxPayload, "payload layout");

inline void encode(const SetLimits& value, uint8_t* payload) {
  if (lies_as_on_the_wire<SetLimits>()) {
    __builtin_memcpy(payload, &value, SetLimits::kSize);
    return;
  }
  put_u16(payload, value.session);
  encode(value.limits, payload + 2);
}

inline Reading decode(const uint8_t* payload, uint8_t size, SetLimits& value) {
  if (size != SetLimits::kSize) {
    return Reading::kBadLength;
  }
  if (lies_as_on_the_wire<SetLimits>()) {
    __builtin_memcpy(&value, payload, SetLimits::kSize);
    return Reading::kOk;
  }
  value.session = get_u16(payload);
  return decode(payload + 2, value.limits);
}

/// Index of the first field out of its range; an array is one field.
inline int8_t first_out_of_range(const SetLimits& value) {
  const int8_t nested = first_out_of_range(value.limits);
  return nested == kNone ? kNone : static_cast<int8_t>(nested + 1);
}

inline int8_t inconsistent_axis(const SetLimits& value) {
  return inconsistent_axis(value.limits);
}

/// Reads the slew limits.
struct GetSlew {
  enum : uint8_t { kId = 0x32, kSize = 0 };
};
static_assert(GetSlew::kSize == 0 && uint8_t{GetSlew::kSize} <= kMaxPayload, "payload layout");

inline void encode(const GetSlew&, uint8_t*) {}

inline Reading decode(const uint8_t*, uint8_t size, GetSlew&) {
  if (size != GetSlew::kSize) {
    return Reading::kBadLength;
  }
  return Reading::kOk;
}

/// Index of the first field out of its range; an array is one field.
inline int8_t first_out_of_range(const GetSlew&) {
  return kNone;
}

inline int8_t inconsistent_axis(const GetSlew&) {
  return kNone;
}

/// The slew limits in use.
struct SlewReply {
  enum : uint8_t { kId = 0xB2, kSize = 2 * kAxes };

  Slew slew;
};
static_assert(SlewReply::kSize == 0 + Slew::kSize && uint8_t{SlewReply::kSize} <= kMaxPayload,
              "payload layout");

inline void encode(const SlewReply& value, uint8_t* payload) {
  if (lies_as_on_the_wire<SlewReply>()) {
    __builtin_memcpy(payload, &value, SlewReply::kSize);
    return;
  }
  encode(value.slew, payload);
}

inline Reading decode(const uint8_t* payload, uint8_t size, SlewReply& value) {
  if (size != SlewReply::kSize) {
    return Reading::kBadLength;
  }
  if (lies_as_on_the_wire<SlewReply>()) {
    __builtin_memcpy(&value, payload, SlewReply::kSize);
    return Reading::kOk;
  }
  return decode(payload, value.slew);
}

/// Index of the first field out of its range; an array is one field.
inline int8_t first_out_of_range(const SlewReply& value) {
  return first_out_of_range(value.slew);
}

inline int8_t inconsistent_axis(const SlewReply&) {
  return kNone;
}

/// Sets the slew limits.
struct SetSlew {
  enum : uint8_t { kId = 0x33, kSize = 2 + 2 * kAxes };

  /// The open session.
  uint16_t session;
  Slew slew;
};
static_assert(SetSlew::kSize == sizeof(SetSlew::session) + Slew::kSize && uint8_t{SetSlew::kSize} <=
              kMaxPayload, "payload layout");

inline void encode(const SetSlew& value, uint8_t* payload) {
  if (lies_as_on_the_wire<SetSlew>()) {
    __builtin_memcpy(payload, &value, SetSlew::kSize);
    return;
  }
  put_u16(payload, value.session);
  encode(value.slew, payload + 2);
}

inline Reading decode(const uint8_t* payload, uint8_t size, SetSlew& value) {
  if (size != SetSlew::kSize) {
    return Reading::kBadLength;
  }
  if (lies_as_on_the_wire<SetSlew>()) {
    __builtin_memcpy(&value, payload, SetSlew::kSize);
    return Reading::kOk;
  }
  value.session = get_u16(payload);
  return decode(payload + 2, value.slew);
}

/// Index of the first field out of its range; an array is one field.
inline int8_t first_out_of_range(const SetSlew& value) {
  const int8_t nested = first_out_of_range(value.slew);
  return nested == kNone ? kNone : static_cast<int8_t>(nested + 1);
}

inline int8_t inconsistent_axis(const SetSlew&) {
  return kNone;
}

/// Reads the link watchdog.
struct GetWatchdog {
  enum : uint8_t { kId = 0x34, kSize = 0 };
};
static_assert(GetWatchdog::kSize == 0 && uint8_t{GetWatchdog::kSize} <= kMaxPayload,
              "payload layout");

inline void encode(const GetWatchdog&, uint8_t*) {}

inline Reading decode(const uint8_t*, uint8_t size, GetWatchdog&) {
  if (size != GetWatchdog::kSize) {
    return Reading::kBadLength;
  }
  return Reading::kOk;
}

/// Index of the first field out of its range; an array is one field.
inline int8_t first_out_of_range(const GetWatchdog&) {
  return kNone;
}

inline int8_t inconsistent_axis(const GetWatchdog&) {
  return kNone;
}

/// The link watchdog in use.
struct WatchdogReply {
  enum : uint8_t { kId = 0xB4, kSize = 6 };

  Watchdog watchdog;
};
static_assert(WatchdogReply::kSize == 0 + Watchdog::kSize && uint8_t{WatchdogReply::kSize} <=
              kMaxPayload, "payload layout");

inline void encode(const WatchdogReply& value, uint8_t* payload) {
  if (lies_as_on_the_wire<WatchdogReply>()) {
    __builtin_memcpy(payload, &value, WatchdogReply::kSize);
    return;
  }
  encode(value.watchdog, payload);
}

inline Reading decode(const uint8_t* payload, uint8_t size, WatchdogReply& value) {
  if (size != WatchdogReply::kSize) {
    return Reading::kBadLength;
  }
  if (lies_as_on_the_wire<WatchdogReply>()) {
    __builtin_memcpy(&value, payload, WatchdogReply::kSize);
    return Reading::kOk;
  }
  return decode(payload, value.watchdog);
}

/// Index of the first field out of its range; an array is one field.
inline int8_t first_out_of_range(const WatchdogReply& value) {
  return first_out_of_range(value.watchdog);
}

inline int8_t inconsistent_axis(const WatchdogReply&) {
  return kNone;
}

/// Sets the link watchdog.
struct SetWatchdog {
  enum : uint8_t { kId = 0x35, kSize = 8 };

  /// The open session.
  uint16_t session;
  Watchdog watchdog;
};
static_assert(SetWatchdog::kSize == sizeof(SetWatchdog::session) + Watchdog::kSize &&
              uint8_t{SetWatchdog::kSize} <= kMaxPayload, "payload layout");

inline void encode(const SetWatchdog& value, uint8_t* payload) {
  if (lies_as_on_the_wire<SetWatchdog>()) {
    __builtin_memcpy(payload, &value, SetWatchdog::kSize);
    return;
  }
  put_u16(payload, value.session);
  encode(value.watchdog, payload + 2);
}

inline Reading decode(const uint8_t* payload, uint8_t size, SetWatchdog& value) {
  if (size != SetWatchdog::kSize) {
    return Reading::kBadLength;
  }
  if (lies_as_on_the_wire<SetWatchdog>()) {
    __builtin_memcpy(&value, payload, SetWatchdog::kSize);
    return Reading::kOk;
  }
  value.session = get_u16(payload);
  return decode(payload + 2, value.watchdog);
}

/// Index of the first field out of its range; an array is one field.
inline int8_t first_out_of_range(const SetWatchdog& value) {
  const int8_t nested = first_out_of_range(value.watchdog);
  return nested == kNone ? kNone : static_cast<int8_t>(nested + 1);
}

inline int8_t inconsistent_axis(const SetWatchdog&) {
  return kNone;
}

/// Reads the pulse calibration.
struct GetCalibration {
  enum : uint8_t { kId = 0x36, kSize = 0 };
};
static_assert(GetCalibration::kSize == 0 && uint8_t{GetCalibration::kSize} <= kMaxPayload,
              "payload layout");

inline void encode(const GetCalibration&, uint8_t*) {}

inline Reading decode(const uint8_t*, uint8_t size, GetCalibration&) {
  if (size != GetCalibration::kSize) {
    return Reading::kBadLength;
  }
  return Reading::kOk;
}

/// Index of the first field out of its range; an array is one field.
inline int8_t first_out_of_range(const GetCalibration&) {
  return kNone;
}

inline int8_t inconsistent_axis(const GetCalibration&) {
  return kNone;
}

/// The pulse calibration in use.
struct CalibrationReply {
  enum : uint8_t { kId = 0xB6, kSize = 8 * kAxes };

  Calibration calibration;
};
static_assert(CalibrationReply::kSize == 0 + Calibration::kSize && uint8_t{CalibrationReply::kSize}
              <= kMaxPayload, "payload layout");

inline void encode(const CalibrationReply& value, uint8_t* payload) {
  if (lies_as_on_the_wire<CalibrationReply>()) {
    __builtin_memcpy(payload, &value, CalibrationReply::kSize);
    return;
  }
  encode(value.calibration, payload);
}

inline Reading decode(const uint8_t* payload, uint8_t size, CalibrationReply& value) {
  if (size != CalibrationReply::kSize) {
    return Reading::kBadLength;
  }
  if (lies_as_on_the_wire<CalibrationReply>()) {
    __builtin_memcpy(&value, payload, CalibrationReply::kSize);
    return Reading::kOk;
  }
  return decode(payload, value.calibration);
}

/// Index of the first field out of its range; an array is one field.
inline int8_t first_out_of_range(const CalibrationReply& value) {
  return first_out_of_range(value.calibration);
}

inline int8_t inconsistent_axis(const CalibrationReply& value) {
  return inconsistent_axis(value.calibration);
}

/// Sets the pulse calibration.
struct SetCalibration {
  enum : uint8_t { kId = 0x37, kSize = 2 + 8 * kAxes };

  /// The open session.
  uint16_t session;
  Calibration calibration;
};
static_assert(SetCalibration::kSize == sizeof(SetCalibration::session) + Calibration::kSize &&
              uint8_t{SetCalibration::kSize} <= kMaxPayload, "payload layout");

inline void encode(const SetCalibration& value, uint8_t* payload) {
  if (lies_as_on_the_wire<SetCalibration>()) {
    __builtin_memcpy(payload, &value, SetCalibration::kSize);
    return;
  }
  put_u16(payload, value.session);
  encode(value.calibration, payload + 2);
}

inline Reading decode(const uint8_t* payload, uint8_t size, SetCalibration& value) {
  if (size != SetCalibration::kSize) {
    return Reading::kBadLength;
  }
  if (lies_as_on_the_wire<SetCalibration>()) {
    __builtin_memcpy(&value, payload, SetCalibration::kSize);
    return Reading::kOk;
  }
  value.session = get_u16(payload);
  return decode(payload + 2, value.calibration);
}

/// Index of the first field out of its range; an array is one field.
inline int8_t first_out_of_range(const SetCalibration& value) {
  const int8_t nested = first_out_of_range(value.calibration);
  return nested == kNone ? kNone : static_cast<int8_t>(nested + 1);
}

inline int8_t inconsistent_axis(const SetCalibration& value) {
  return inconsistent_axis(value.calibration);
}

/// Starts to write the configuration in use to the older EEPROM slot, one byte per control tick.
/// `ack` means that writing has begun; `eeprom_busy` is cleared when it is done. Refused while the
/// configuration is incomplete.
struct SaveConfig {
  enum : uint8_t { kId = 0x38, kSize = 2 };

  /// The open session.
  uint16_t session;
};
static_assert(SaveConfig::kSize == sizeof(SaveConfig::session) && uint8_t{SaveConfig::kSize} <=
              kMaxPayload, "payload layout");

inline void encode(const SaveConfig& value, uint8_t* payload) {
  if (lies_as_on_the_wire<SaveConfig>()) {
    __builtin_memcpy(payload, &value, SaveConfig::kSize);
    return;
  }
  put_u16(payload, value.session);
}

inline Reading decode(const uint8_t* payload, uint8_t size, SaveConfig& value) {
  if (size != SaveConfig::kSize) {
    return Reading::kBadLength;
  }
  if (lies_as_on_the_wire<SaveConfig>()) {
    __builtin_memcpy(&value, payload, SaveConfig::kSize);
    return Reading::kOk;
  }
  value.session = get_u16(payload);
  return Reading::kOk;
}

/// Index of the first field out of its range; an array is one field.
inline int8_t first_out_of_range(const SaveConfig&) {
  return kNone;
}

inline int8_t inconsistent_axis(const SaveConfig&) {
  return kNone;
}

/// Reads the board's name and what is wired to it.
struct GetEquipment {
  enum : uint8_t { kId = 0x3C, kSize = 0 };
};
static_assert(GetEquipment::kSize == 0 && uint8_t{GetEquipment::kSize} <= kMaxPayload,
              "payload layout");

inline void encode(const GetEquipment&, uint8_t*) {}

inline Reading decode(const uint8_t*, uint8_t size, GetEquipment&) {
  if (size != GetEquipment::kSize) {
    return Reading::kBadLength;
  }
  return Reading::kOk;
}

/// Index of the first field out of its range; an array is one field.
inline int8_t first_out_of_range(const GetEquipment&) {
  return kNone;
}

inline int8_t inconsistent_axis(const GetEquipment&) {
  return kNone;
}

/// Name and equipment in use.
struct EquipmentReply {
  enum : uint8_t { kId = 0xBC, kSize = 19 };

  Equipment equipment;
};
static_assert(EquipmentReply::kSize == 0 + Equipment::kSize && uint8_t{EquipmentReply::kSize} <=
              kMaxPayload, "payload layout");

inline void encode(const EquipmentReply& value, uint8_t* payload) {
  if (lies_as_on_the_wire<EquipmentReply>()) {
    __builtin_memcpy(payload, &value, EquipmentReply::kSize);
    return;
  }
  encode(value.equipment, payload);
}

inline Reading decode(const uint8_t* payload, uint8_t size, EquipmentReply& value) {
  if (size != EquipmentReply::kSize) {
    return Reading::kBadLength;
  }
  if (lies_as_on_the_wire<EquipmentReply>()) {
    __builtin_memcpy(&value, payload, EquipmentReply::kSize);
    return Reading::kOk;
  }
  return decode(payload, value.equipment);
}

/// Index of the first field out of its range; an array is one field.
inline int8_t first_out_of_range(const EquipmentReply& value) {
  return first_out_of_range(value.equipment);
}

inline int8_t inconsistent_axis(const EquipmentReply&) {
  return kNone;
}

/// Sets the board's name and what is wired to it.
struct SetEquipment {
  enum : uint8_t { kId = 0x3D, kSize = 21 };

  /// The open session.
  uint16_t session;
  Equipment equipment;
};
static_assert(SetEquipment::kSize == sizeof(SetEquipment::session) + Equipment::kSize &&
              uint8_t{SetEquipment::kSize} <= kMaxPayload, "payload layout");

inline void encode(const SetEquipment& value, uint8_t* payload) {
  if (lies_as_on_the_wire<SetEquipment>()) {
    __builtin_memcpy(payload, &value, SetEquipment::kSize);
    return;
  }
  put_u16(payload, value.session);
  encode(value.equipment, payload + 2);
}

inline Reading decode(const uint8_t* payload, uint8_t size, SetEquipment& value) {
  if (size != SetEquipment::kSize) {
    return Reading::kBadLength;
  }
  if (lies_as_on_the_wire<SetEquipment>()) {
    __builtin_memcpy(&value, payload, SetEquipment::kSize);
    return Reading::kOk;
  }
  value.session = get_u16(payload);
  return decode(payload + 2, value.equipment);
}

/// Index of the first field out of its range; an array is one field.
inline int8_t first_out_of_range(const SetEquipment& value) {
  const int8_t nested = first_out_of_range(value.equipment);
  return nested == kNone ? kNone : static_cast<int8_t>(nested + 1);
}

inline int8_t inconsistent_axis(const SetEquipment&) {
  return kNone;
}

/// Reads the acceleration limits.
struct GetAcceleration {
  enum : uint8_t { kId = 0x3E, kSize = 0 };
};
static_assert(GetAcceleration::kSize == 0 && uint8_t{GetAcceleration::kSize} <= kMaxPayload,
              "payload layout");

inline void encode(const GetAcceleration&, uint8_t*) {}

inline Reading decode(const uint8_t*, uint8_t size, GetAcceleration&) {
  if (size != GetAcceleration::kSize) {
    return Reading::kBadLength;
  }
  return Reading::kOk;
}

/// Index of the first field out of its range; an array is one field.
inline int8_t first_out_of_range(const GetAcceleration&) {
  return kNone;
}

inline int8_t inconsistent_axis(const GetAcceleration&) {
  return kNone;
}

/// The acceleration limits in use.
struct AccelerationReply {
  enum : uint8_t { kId = 0xBE, kSize = 2 * kAxes };

  Acceleration acceleration;
};
static_assert(AccelerationReply::kSize == 0 + Acceleration::kSize &&
              uint8_t{AccelerationReply::kSize} <= kMaxPayload, "payload layout");

inline void encode(const AccelerationReply& value, uint8_t* payload) {
  if (lies_as_on_the_wire<AccelerationReply>()) {
    __builtin_memcpy(payload, &value, AccelerationReply::kSize);
    return;
  }
  encode(value.acceleration, payload);
}

inline Reading decode(const uint8_t* payload, uint8_t size, AccelerationReply& value) {
  if (size != AccelerationReply::kSize) {
    return Reading::kBadLength;
  }
  if (lies_as_on_the_wire<AccelerationReply>()) {
    __builtin_memcpy(&value, payload, AccelerationReply::kSize);
    return Reading::kOk;
  }
  return decode(payload, value.acceleration);
}

/// Index of the first field out of its range; an array is one field.
inline int8_t first_out_of_range(const AccelerationReply& value) {
  return first_out_of_range(value.acceleration);
}

inline int8_t inconsistent_axis(const AccelerationReply&) {
  return kNone;
}

/// Sets the acceleration limits.
struct SetAcceleration {
  enum : uint8_t { kId = 0x3F, kSize = 2 + 2 * kAxes };

  /// The open session.
  uint16_t session;
  Acceleration acceleration;
};
static_assert(SetAcceleration::kSize == sizeof(SetAcceleration::session) + Acceleration::kSize &&
              uint8_t{SetAcceleration::kSize} <= kMaxPayload, "payload layout");

inline void encode(const SetAcceleration& value, uint8_t* payload) {
  if (lies_as_on_the_wire<SetAcceleration>()) {
    __builtin_memcpy(payload, &value, SetAcceleration::kSize);
    return;
  }
  put_u16(payload, value.session);
  encode(value.acceleration, payload + 2);
}

inline Reading decode(const uint8_t* payload, uint8_t size, SetAcceleration& value) {
  if (size != SetAcceleration::kSize) {
    return Reading::kBadLength;
  }
  if (lies_as_on_the_wire<SetAcceleration>()) {
    __builtin_memcpy(&value, payload, SetAcceleration::kSize);
    return Reading::kOk;
  }
  value.session = get_u16(payload);
  return decode(payload + 2, value.acceleration);
}

/// Index of the first field out of its range; an array is one field.
inline int8_t first_out_of_range(const SetAcceleration& value) {
  const int8_t nested = first_out_of_range(value.acceleration);
  return nested == kNone ? kNone : static_cast<int8_t>(nested + 1);
}

inline int8_t inconsistent_axis(const SetAcceleration&) {
  return kNone;
}

/// The request was executed, or its execution has begun.
struct Ack {
  enum : uint8_t { kId = 0x70, kSize = 2 };

  /// Id of the request.
  uint8_t request;
  /// State after the request.
  State state;
};
static_assert(Ack::kSize == sizeof(Ack::request) + sizeof(Ack::state) && uint8_t{Ack::kSize} <=
              kMaxPayload, "payload layout");

inline void encode(const Ack& value, uint8_t* payload) {
  if (lies_as_on_the_wire<Ack>()) {
    __builtin_memcpy(payload, &value, Ack::kSize);
    return;
  }
  put_u8(payload, value.request);
  put_u8(payload + 1, static_cast<uint8_t>(value.state));
}

inline Reading decode(const uint8_t* payload, uint8_t size, Ack& value) {
  if (size != Ack::kSize) {
    return Reading::kBadLength;
  }
  value.request = get_u8(payload);
  if (!is_state(get_u8(payload + 1))) {
    return Reading::kUndefinedValue;
  }
  value.state = static_cast<State>(get_u8(payload + 1));
  return Reading::kOk;
}

/// Index of the first field out of its range; an array is one field.
inline int8_t first_out_of_range(const Ack&) {
  return kNone;
}

inline int8_t inconsistent_axis(const Ack&) {
  return kNone;
}

/// The request was refused; nothing has changed.
struct Nack {
  enum : uint8_t { kId = 0x71, kSize = 3 };

  /// Id of the request.
  uint8_t request;
  /// Why.
  NackCode code;
  /// See the code.
  uint8_t detail;
};
static_assert(Nack::kSize == sizeof(Nack::request) + sizeof(Nack::code) + sizeof(Nack::detail) &&
              uint8_t{Nack::kSize} <= kMaxPayload, "payload layout");

inline void encode(const Nack& value, uint8_t* payload) {
  if (lies_as_on_the_wire<Nack>()) {
    __builtin_memcpy(payload, &value, Nack::kSize);
    return;
  }
  put_u8(payload, value.request);
  put_u8(payload + 1, static_cast<uint8_t>(value.code));
  put_u8(payload + 2, value.detail);
}

inline Reading decode(const uint8_t* payload, uint8_t size, Nack& value) {
  if (size != Nack::kSize) {
    return Reading::kBadLength;
  }
  value.request = get_u8(payload);
  if (!is_nack_code(get_u8(payload + 1))) {
    return Reading::kUndefinedValue;
  }
  value.code = static_cast<NackCode>(get_u8(payload + 1));
  value.detail = get_u8(payload + 2);
  return Reading::kOk;
}

/// Index of the first field out of its range; an array is one field.
inline int8_t first_out_of_range(const Nack&) {
  return kNone;
}

inline int8_t inconsistent_axis(const Nack&) {
  return kNone;
}

/// The state, sent periodically. Its sequence number counts reports, so that the host can detect
/// lost ones.
struct Telemetry {
  enum : uint8_t { kId = 0xC1, kSize = 15 + 6 * kAxes };

  StateReport report;
};
static_assert(Telemetry::kSize == 0 + StateReport::kSize && uint8_t{Telemetry::kSize} <=
              kMaxPayload, "payload layout");

inline void encode(const Telemetry& value, uint8_t* payload) {
  if (lies_as_on_the_wire<Telemetry>()) {
    __builtin_memcpy(payload, &value, Telemetry::kSize);
    return;
  }
  encode(value.report, payload);
}

inline Reading decode(const uint8_t* payload, uint8_t size, Telemetry& value) {
  if (size != Telemetry::kSize) {
    return Reading::kBadLength;
  }
  return decode(payload, value.report);
}

/// Index of the first field out of its range; an array is one field.
inline int8_t first_out_of_range(const Telemetry&) {
  return kNone;
}

inline int8_t inconsistent_axis(const Telemetry&) {
  return kNone;
}

enum class Retry : uint8_t {
  kRepeat,  ///< Executed again.
  kOnce,    ///< Repeated with the same sequence number it is answered from memory.
  kNever,   ///< Not repeated; the next one replaces it.
};

constexpr uint16_t state_bit(State state) {
  return static_cast<uint16_t>(1U << static_cast<uint8_t>(state));
}

/// How the board treats a request.
struct RequestRule {
  uint8_t id;
  uint8_t reply_id;
  uint8_t size;
  Retry retry;
  bool needs_session;
  uint16_t allowed_states;  ///< Bits of `state_bit`.
};

constexpr RequestRule kRequestRules[] = {
    {Hello::kId, HelloReply::kId, Hello::kSize, Retry::kRepeat, false, 0x01FFU},
    {OpenSession::kId, SessionReply::kId, OpenSession::kSize, Retry::kRepeat, false, 0x01FEU},
    {ClockSync::kId, ClockReply::kId, ClockSync::kSize, Retry::kRepeat, false, 0x01FFU},
    {GetState::kId, StateReply::kId, GetState::kSize, Retry::kRepeat, false, 0x01FFU},
    {GetCounters::kId, CountersReply::kId, GetCounters::kSize, Retry::kRepeat, false, 0x01FFU},
    {SetTelemetry::kId, Ack::kId, SetTelemetry::kSize, Retry::kOnce, true, 0x01FEU},
    {Blink::kId, Ack::kId, Blink::kSize, Retry::kRepeat, false, 0x01FFU},
    {GetFaultRecord::kId, FaultRecordReply::kId, GetFaultRecord::kSize, Retry::kRepeat, false, 0x01FFU},
    {GetLinkLimits::kId, LinkLimitsReply::kId, GetLinkLimits::kSize, Retry::kRepeat, false, 0x01FFU},
    {Arm::kId, Ack::kId, Arm::kSize, Retry::kOnce, true, 0x0002U},
    {Disarm::kId, Ack::kId, Disarm::kSize, Retry::kOnce, true, 0x007EU},
    {Stop::kId, Ack::kId, Stop::kSize, Retry::kRepeat, false, 0x01FFU},
    {ClearFault::kId, Ack::kId, ClearFault::kSize, Retry::kOnce, true, 0x0180U},
    {SetTarget::kId, TargetReply::kId, SetTarget::kSize, Retry::kNever, true, 0x0038U},
    {SetTargetAt::kId, Ack::kId, SetTargetAt::kSize, Retry::kNever, true, 0x0038U},
    {GetLimits::kId, LimitsReply::kId, GetLimits::kSize, Retry::kRepeat, false, 0x01FFU},
    {SetLimits::kId, Ack::kId, SetLimits::kSize, Retry::kOnce, true, 0x0182U},
    {GetSlew::kId, SlewReply::kId, GetSlew::kSize, Retry::kRepeat, false, 0x01FFU},
    {SetSlew::kId, Ack::kId, SetSlew::kSize, Retry::kOnce, true, 0x0182U},
    {GetWatchdog::kId, WatchdogReply::kId, GetWatchdog::kSize, Retry::kRepeat, false, 0x01FFU},
    {SetWatchdog::kId, Ack::kId, SetWatchdog::kSize, Retry::kOnce, true, 0x0182U},
    {GetCalibration::kId, CalibrationReply::kId, GetCalibration::kSize, Retry::kRepeat, false, 0x01FFU},
    {SetCalibration::kId, Ack::kId, SetCalibration::kSize, Retry::kOnce, true, 0x0182U},
    {SaveConfig::kId, Ack::kId, SaveConfig::kSize, Retry::kOnce, true, 0x0182U},
    {GetEquipment::kId, EquipmentReply::kId, GetEquipment::kSize, Retry::kRepeat, false, 0x01FFU},
    {SetEquipment::kId, Ack::kId, SetEquipment::kSize, Retry::kOnce, true, 0x0182U},
    {GetAcceleration::kId, AccelerationReply::kId, GetAcceleration::kSize, Retry::kRepeat, false, 0x01FFU},
    {SetAcceleration::kId, Ack::kId, SetAcceleration::kSize, Retry::kOnce, true, 0x0182U},
};

/// The rule of a request, or null where no request has this id.
constexpr const RequestRule* find_request(uint8_t id) {
  for (const RequestRule& rule : kRequestRules) {
    if (rule.id == id) {
      return &rule;
    }
  }
  return nullptr;
}

constexpr bool is_allowed(const RequestRule& rule, State state) {
  return (rule.allowed_states & state_bit(state)) != 0;
}

struct Transition {
  uint16_t from;  ///< Bits of `state_bit`.
  Event event;
  State to;
};

constexpr Transition kTransitions[] = {
    {0x0001U, Event::kSelfTestPassed, State::kDisarmed},
    {0x0002U, Event::kArmRequested, State::kArming},
    {0x0004U, Event::kAxesEnabled, State::kHold},
    {0x0038U, Event::kTargetAccepted, State::kActive},
    {0x0008U, Event::kTargetExpired, State::kHold},
    {0x0010U, Event::kHoldExpired, State::kRelaxing},
    {0x0020U, Event::kRestReached, State::kFault},
    {0x003CU, Event::kDisarmRequested, State::kDisarming},
    {0x0040U, Event::kRestReached, State::kDisarmed},
    {0x007FU, Event::kFaultRaised, State::kFault},
    {0x00FFU, Event::kStopRequested, State::kStopped},
    {0x0180U, Event::kClearRequested, State::kDisarmed},
};

/// The state after an event; what is not listed changes nothing.
constexpr State next_state(State state, Event event) {
  for (const Transition& transition : kTransitions) {
    if (transition.event == event && (transition.from & state_bit(state)) != 0) {
      return transition.to;
    }
  }
  return state;
}

}  // namespace ccr

#endif
