// Equipment wired to the board, and its name.
#include <config_slot.h>

#include "test_bench.h"

using namespace ccr;

namespace {

constexpr Equipment kNothing = {};
constexpr Equipment kFitted = {{'a', 'r', 'm'}, 1, 0, 0};

Equipment equipment(Bench& bench) {
  return read<EquipmentReply>(bench.ask(GetEquipment{})).equipment;
}

EepromStatus status(Bench& bench) {
  return read<HelloReply>(bench.ask(Hello{1, kSpecHash})).eeprom_status;
}

/// Converts slot A to layout 1.
void make_former(EepromImage& eeprom) {
  eeprom[kSlotLayoutAt] = 1;
  put_u32(&eeprom[kFirstSlotCrcAt], crc32_of(&eeprom[0], kFirstSlotCrcAt));
  for (uint8_t at = kFirstSlotCrcAt + 4; at < kSlotSize; ++at) {
    eeprom[at] = 0xFF;
  }
}

}  // namespace

TEST_CASE("EST-1: an open emergency stop is a fault at the next tick, in every state but boot") {
  Bench bench;
  bench.hardware.is_stop_open = true;
  bench.make_ready();
  bench.acknowledged(SetEquipment{kSession, kFitted});
  bench.tick();
  CHECK(bench.state() == State::kFault);
  CHECK(bench.fault() == Fault::kEmergencyStop);
  bench.hardware.is_stop_open = false;
  bench.acknowledged(ClearFault{kSession});
  bench.save();
  bench.arm();
  bench.tick(4);
  CHECK(bench.has_pulses());
  bench.hardware.is_stop_open = true;
  bench.tick();
  CHECK_FALSE(bench.has_pulses());
  CHECK_FALSE(bench.hardware.is_supply_on);
  bench.reset();
  bench.tick(kBootTicks);
  CHECK(bench.state() == State::kBoot);
  bench.tick();
  CHECK(bench.fault() == Fault::kEmergencyStop);
}

TEST_CASE("EST-1: the input is ignored if no emergency stop is fitted") {
  Bench bench;
  bench.hardware.is_stop_open = true;
  bench.make_armed();
  CHECK(bench.fault() == Fault::kNone);
}

TEST_CASE("EST-2: no latch is cleared while the emergency stop is open") {
  Bench bench;
  bench.make_ready();
  bench.acknowledged(SetEquipment{kSession, kFitted});
  bench.hardware.is_stop_open = true;
  bench.tick(2);
  CHECK(bench.refused(ClearFault{kSession}).code == NackCode::kEmergencyStopOpen);
  bench.hardware.is_stop_open = false;
  bench.tick();
  CHECK(bench.state() == State::kFault);
  CHECK((bench.acknowledged(ClearFault{kSession}) == State::kDisarmed));
}

TEST_CASE("SUP-2: the report contains the servo supply voltage, rounded") {
  Bench bench;
  bench.make_ready();
  for (const unsigned full : {0U, 1U, 60U, 100U, 254U, 255U}) {
    bench.acknowledged(SetEquipment{kSession, {{}, 0, static_cast<uint8_t>(full), 0}});
    for (unsigned reading = 0; reading <= 255; ++reading) {
      bench.hardware.supply = static_cast<uint8_t>(reading);
      bench.tick();
      CHECK(bench.report().supply_dv == (2 * full * reading + 255) / 510);
    }
  }
}

TEST_CASE("SUP-3: a servo supply that stays too low while armed is a fault") {
  Bench bench;
  bench.make_ready();
  bench.acknowledged(SetEquipment{kSession, {{}, 0, 100, 50}});
  bench.hardware.supply = 200;
  bench.arm();
  while (bench.state() != State::kHold) {
    bench.tick();
  }
  bench.target(0, 1000);
  bench.hardware.supply = 100;
  bench.tick(kSagTicks - 1U);
  CHECK(bench.has_pulses());
  bench.hardware.supply = 128;
  bench.tick();
  bench.hardware.supply = 100;
  bench.tick(kSagTicks - 1U);
  CHECK(bench.has_pulses());
  bench.tick();
  CHECK_FALSE(bench.has_pulses());
  CHECK(bench.fault() == Fault::kSupplyLow);
  bench.acknowledged(ClearFault{kSession});
  bench.tick(3U * kSagTicks);
  CHECK(bench.state() == State::kDisarmed);
}

TEST_CASE("CFG-7: a slot of layout 1 is loaded with zeros for its equipment") {
  Bench bench;
  bench.make_ready();
  bench.save();
  make_former(bench.hardware.eeprom);
  bench.reset();
  CHECK(status(bench) == EepromStatus::kLoaded);
  CHECK(bench.has_flag(status_flags::kConfigured));
  CHECK(equipment(bench).emergency_stop == 0);
  CHECK(equipment(bench).board_name[0] == 0);
  const Calibration kept = read<CalibrationReply>(bench.ask(GetCalibration{})).calibration;
  CHECK(kept.pulse_max_half_us[1] == some_calibration().pulse_max_half_us[1]);
  bench.tick(kBootTicks + 1);
  bench.open_session();
  bench.acknowledged(SetEquipment{kSession, kFitted});
  bench.save();
  bench.reset();
  CHECK(equipment(bench).emergency_stop == 1);
  CHECK(equipment(bench).board_name[2] == 'm');
}

TEST_CASE("CFG-7: a slot of layout 1 with any byte damaged is corrupt") {
  for (uint8_t at = 0; at < kFirstSlotCrcAt + 4; ++at) {
    Bench bench;
    bench.make_ready();
    bench.save();
    make_former(bench.hardware.eeprom);
    bench.hardware.eeprom[at] ^= 0x40;
    bench.reset();
    CHECK(status(bench) == EepromStatus::kBothBad);
  }
}

TEST_CASE("CFG-8: a board that may have lost its emergency stop is not armed") {
  Bench bench;
  bench.hardware.eeprom[kEepromSlotB] = 0;
  bench.reset();
  bench.make_ready();
  const Nack refusal = bench.refused(Arm{kSession});
  CHECK(refusal.code == NackCode::kNotConfigured);
  CHECK(refusal.detail == config_groups::kEquipment);
  bench.acknowledged(SetEquipment{kSession, kNothing});
  bench.arm();
}
