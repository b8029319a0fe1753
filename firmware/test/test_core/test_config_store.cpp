// The configuration in memory and in EEPROM.
#include <config_slot.h>

#include "test_bench.h"

using namespace ccr;

namespace {

const uint16_t kSlots[] = {kEepromSlotA, kEepromSlotB};

bool is_loaded(Bench& bench) { return bench.has_flag(status_flags::kConfigured); }

EepromStatus status(Bench& bench) {
  return read<HelloReply>(bench.ask(Hello{1, kSpecHash})).eeprom_status;
}

uint16_t slew(Bench& bench) {
  return read<SlewReply>(bench.ask(GetSlew{})).slew.slew_cdeg_tick[0];
}

void save_slew(Bench& bench, uint16_t value) {
  bench.acknowledged(SetSlew{kSession, {{value, value}}});
  bench.save();
}

void write_generation(EepromImage& eeprom, uint16_t address, uint16_t generation) {
  put_u16(&eeprom[address + kSlotGenerationAt], generation);
  put_u32(&eeprom[address + kSlotCrcAt], crc32_of(&eeprom[address], kSlotCrcAt));
}

/// Slot A holds slew 11, slot B the newer slew 22.
Bench saved_twice() {
  Bench bench;
  bench.make_ready();
  save_slew(bench, 11);
  save_slew(bench, 22);
  return bench;
}

}  // namespace

TEST_CASE("the CRC in EEPROM is that of zip files") {
  const uint8_t digits[] = {'1', '2', '3', '4', '5', '6', '7', '8', '9'};
  CHECK(crc32_of(digits, sizeof(digits)) == 0xCBF43926UL);
}

TEST_CASE("CFG-1: refusing a group keeps the previous one") {
  Bench bench;
  bench.make_ready();
  Calibration half_good = some_calibration();
  half_good.neutral_half_us[0] = 2000;
  half_good.pulse_max_half_us[1] = 5001;
  bench.refused(SetCalibration{kSession, half_good});
  const Calibration kept = read<CalibrationReply>(bench.ask(GetCalibration{})).calibration;
  CHECK(kept.neutral_half_us[0] == some_calibration().neutral_half_us[0]);
}

TEST_CASE("a missing group reads as zeros") {
  Bench bench;
  CHECK(slew(bench) == 0);
  CHECK_FALSE(is_loaded(bench));
}

TEST_CASE("CFG-2: a saved configuration is in use after a reset") {
  Bench bench;
  bench.make_ready();
  CHECK(bench.has_flag(status_flags::kUnsaved));
  bench.save();
  CHECK_FALSE(bench.has_flag(status_flags::kUnsaved));
  CHECK(bench.counters().saves == 1);
  bench.reset();
  CHECK(status(bench) == EepromStatus::kLoaded);
  CHECK(is_loaded(bench));
  const Calibration loaded = read<CalibrationReply>(bench.ask(GetCalibration{})).calibration;
  CHECK(loaded.per_90_deg_half_us[1] == some_calibration().per_90_deg_half_us[1]);
  const Limits limits = read<LimitsReply>(bench.ask(GetLimits{})).limits;
  CHECK(limits.rest_cdeg[1] == some_limits().rest_cdeg[1]);
}

TEST_CASE("CFG-2: the slot in EEPROM is laid out as the spec says") {
  Bench bench;
  bench.make_ready();
  bench.save();
  const uint8_t* slot = &bench.hardware.eeprom[kEepromSlotA];
  CHECK(get_u16(slot) == kEepromMagic);
  CHECK(slot[2] == kEepromLayout);
  CHECK(get_u16(slot + 3) == 0);
  Bytes limits(Limits::kSize);
  encode(some_limits(), limits.data());
  CHECK(Bytes(slot + 5, slot + 5 + Limits::kSize) == limits);
}

TEST_CASE("CFG-2: saves alternate between the slots, and the newest is loaded") {
  Bench bench = saved_twice();
  for (uint16_t value = 100; value < 110; ++value) {
    bench.reset();
    CHECK(slew(bench) == (value == 100 ? 22 : value - 1));
    bench.tick(kBootTicks + 1);
    bench.open_session();
    save_slew(bench, value);
  }
}

TEST_CASE("CFG-2: the newer generation is loaded even after the counter wraps") {
  Bench bench = saved_twice();
  write_generation(bench.hardware.eeprom, kEepromSlotA, 0);
  write_generation(bench.hardware.eeprom, kEepromSlotB, 0xFFFF);
  bench.reset();
  CHECK(slew(bench) == 11);
  write_generation(bench.hardware.eeprom, kEepromSlotA, 0x8000);
  bench.reset();
  CHECK(slew(bench) == 22);
}

TEST_CASE("CFG-3: a reset at any byte of a save leaves the configuration saved before") {
  for (unsigned ticks = 0; ticks <= kEepromSlotSize; ++ticks) {
    Bench bench = saved_twice();
    bench.acknowledged(SetSlew{kSession, {{33, 33}}});
    bench.acknowledged(SaveConfig{kSession});
    bench.tick(ticks);
    bench.reset();
    // With its last byte written, the new slot is complete.
    CHECK(slew(bench) == (ticks == kEepromSlotSize ? 33 : 22));
    CHECK(is_loaded(bench));
  }
}

TEST_CASE("CFG-3: the loaded slot is not overwritten, whichever it is") {
  for (uint16_t saves = 2; saves <= 5; ++saves) {
    Bench bench = saved_twice();
    for (uint16_t save = 3; save <= saves; ++save) {
      save_slew(bench, static_cast<uint16_t>(100 + save));
    }
    const uint16_t newest = slew(bench);
    bench.reset();
    bench.tick(kBootTicks + 1);
    bench.open_session();
    bench.acknowledged(SaveConfig{kSession});
    bench.tick(10);
    bench.reset();
    CHECK(slew(bench) == newest);
  }
}

TEST_CASE("CFG-4: a slot of another layout is corrupt") {
  Bench bench = saved_twice();
  bench.hardware.eeprom[kEepromSlotB + kSlotLayoutAt] = kEepromLayout + 1;
  write_generation(bench.hardware.eeprom, kEepromSlotB, 1);
  bench.reset();
  CHECK(status(bench) == EepromStatus::kOneSlotBad);
}

TEST_CASE("CFG-4: with any byte of one slot corrupt, the other slot is loaded") {
  for (const uint16_t slot : kSlots) {
    for (unsigned at = 0; at < kEepromSlotSize; ++at) {
      Bench bench = saved_twice();
      bench.hardware.eeprom[slot + at] ^= 0x10;
      bench.reset();
      CHECK(status(bench) == EepromStatus::kOneSlotBad);
      CHECK(slew(bench) == (slot == kEepromSlotA ? 22 : 11));
    }
  }
}

TEST_CASE("CFG-4: with both slots corrupt the board is unconfigured and reports it") {
  Bench bench = saved_twice();
  for (const uint16_t slot : kSlots) {
    bench.hardware.eeprom[slot + 20U] ^= 1;
  }
  bench.reset();
  CHECK(status(bench) == EepromStatus::kBothBad);
  bench.tick(kBootTicks + 1);
  bench.open_session();
  CHECK(bench.refused(Arm{kSession}).code == NackCode::kNotConfigured);
}

TEST_CASE("CFG-4: an intact slot with invalid values is corrupt") {
  Bench bench = saved_twice();
  put_u16(&bench.hardware.eeprom[kEepromSlotB + kSlotConfigurationAt + kSlewAt], 0);
  write_generation(bench.hardware.eeprom, kEepromSlotB, 1);
  bench.reset();
  CHECK(status(bench) == EepromStatus::kOneSlotBad);
  CHECK(slew(bench) == 11);
}

TEST_CASE("CFG-4: a save repairs the older slot") {
  Bench bench = saved_twice();
  bench.hardware.eeprom[kEepromSlotB] ^= 1;
  bench.reset();
  bench.tick(kBootTicks + 1);
  bench.open_session();
  bench.save();
  bench.reset();
  CHECK(status(bench) == EepromStatus::kLoaded);
}

TEST_CASE("CFG-5: during a save, arm, save_config and setting a group get busy") {
  Bench bench;
  bench.make_ready();
  bench.acknowledged(SaveConfig{kSession});
  CHECK(bench.has_flag(status_flags::kEepromBusy));
  CHECK(bench.refused(Arm{kSession}).code == NackCode::kBusy);
  CHECK(bench.refused(SaveConfig{kSession}).code == NackCode::kBusy);
  CHECK(bench.refused(SetLimits{kSession, some_limits()}).code == NackCode::kBusy);
  CHECK(bench.refused(SetSlew{kSession, some_slew()}).code == NackCode::kBusy);
  CHECK(bench.refused(SetWatchdog{kSession, some_watchdog()}).code == NackCode::kBusy);
  CHECK(bench.refused(SetCalibration{kSession, some_calibration()}).code == NackCode::kBusy);
  CHECK(bench.acknowledged(Disarm{kSession}) == State::kDisarmed);
  bench.tick(kEepromSlotSize + 1U);
  bench.arm();
}

TEST_CASE("CFG-6: a save writes one byte a tick, and none while EEPROM is busy") {
  Bench bench;
  bench.make_ready();
  const unsigned before = bench.hardware.eeprom_writes;
  bench.acknowledged(SaveConfig{kSession});
  CHECK(bench.hardware.eeprom_writes == before);
  bench.tick(3);
  CHECK(bench.hardware.eeprom_writes == before + 3);
  bench.hardware.is_eeprom_busy = true;
  bench.tick(10);
  CHECK(bench.hardware.eeprom_writes == before + 3);
  bench.hardware.is_eeprom_busy = false;
  bench.tick(kEepromSlotSize - 3 + 1);
  CHECK(bench.counters().saves == 1);
}

TEST_CASE("CFG-6: a save is finished one tick after its last byte") {
  Bench bench;
  bench.make_ready();
  bench.acknowledged(SaveConfig{kSession});
  bench.tick(kEepromSlotSize);
  CHECK(bench.has_flag(status_flags::kEepromBusy));
  CHECK(bench.counters().saves == 0);
  bench.tick();
  CHECK_FALSE(bench.has_flag(status_flags::kEepromBusy));
  CHECK(bench.counters().saves == 1);
}

TEST_CASE("CFG-6: a byte that does not read back is a fault, and the old configuration stays") {
  for (const unsigned at : {0U, 20U, kEepromSlotSize - 1U}) {
    Bench bench = saved_twice();
    bench.hardware.worn_out_address = static_cast<int>(kEepromSlotA + at);
    bench.acknowledged(SetSlew{kSession, {{33, 33}}});
    // So that the byte that is not stored differs.
    bench.hardware.eeprom[kEepromSlotA + at] ^= 0xFF;
    bench.acknowledged(SaveConfig{kSession});
    bench.tick(kEepromSlotSize + 1U);
    CHECK(bench.fault() == Fault::kEepromFailed);
    CHECK_FALSE(bench.has_flag(status_flags::kEepromBusy));
    CHECK(bench.has_flag(status_flags::kUnsaved));
    bench.reset();
    CHECK(slew(bench) == 22);
  }
}
