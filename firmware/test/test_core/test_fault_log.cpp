// The last faults in EEPROM.
#include <config_slot.h>

#include "test_bench.h"

using namespace ccr;

namespace {

FaultRecord record(Bench& bench, uint8_t place) {
  return read<FaultRecordReply>(bench.ask(GetFaultRecord{place})).record;
}

bool is_good(const FaultRecord& record) {
  Bytes bytes(FaultRecord::kSize);
  encode(record, bytes.data());
  return record.check == crc32_of(bytes.data(), FaultRecord::kSize - 4);
}

void make_fault(Bench& bench, Fault fault) {
  bench.board().raise_fault(fault);
  bench.tick();
}

}  // namespace

TEST_CASE("LOG-1: each fault is written once, one byte a tick") {
  Bench bench;
  bench.make_ready();
  const unsigned writes_before = bench.hardware.eeprom_writes;
  for (unsigned number = 0; number < 20; ++number) {
    make_fault(bench, Fault::kStackLow);
    bench.tick(FaultRecord::kSize + 5U);
    make_fault(bench, Fault::kInternal);
    CHECK(bench.hardware.eeprom_writes == writes_before + (number + 1) * FaultRecord::kSize);
    const FaultRecord kept = record(bench, static_cast<uint8_t>(number % kFaultLogRecords));
    CHECK(is_good(kept));
    CHECK(kept.number == number);
    CHECK(kept.fault == static_cast<uint8_t>(Fault::kStackLow));
    CHECK(kept.state == static_cast<uint8_t>(State::kDisarmed));
    bench.acknowledged(ClearFault{kSession});
    bench.tick();
  }
}

TEST_CASE("LOG-1: a second fault raised before the first is written is written after it") {
  Bench bench;
  bench.make_ready();
  make_fault(bench, Fault::kStackLow);
  bench.acknowledged(ClearFault{kSession});
  make_fault(bench, Fault::kInternal);
  bench.tick(2U * FaultRecord::kSize);
  CHECK(record(bench, 0).fault == static_cast<uint8_t>(Fault::kStackLow));
  CHECK(record(bench, 1).fault == static_cast<uint8_t>(Fault::kInternal));
  bench.hardware.is_eeprom_busy = true;
  CHECK(bench.refused(GetFaultRecord{1}).code == NackCode::kBusy);
}

TEST_CASE("LOG-2: a reset at any byte of a record keeps earlier ones, and the next overwrites it") {
  for (unsigned ticks = 0; ticks < FaultRecord::kSize; ++ticks) {
    Bench bench;
    bench.make_ready();
    make_fault(bench, Fault::kStackLow);
    bench.tick(FaultRecord::kSize);
    bench.acknowledged(ClearFault{kSession});
    make_fault(bench, Fault::kInternal);
    bench.tick(ticks);
    bench.reset();
    CHECK(is_good(record(bench, 0)));
    const bool was_whole = ticks == FaultRecord::kSize - 1U;
    CHECK(is_good(record(bench, 1)) == was_whole);
    bench.make_ready();
    make_fault(bench, Fault::kTickOverrun);
    bench.tick(FaultRecord::kSize);
    CHECK(record(bench, was_whole ? 2 : 1).number == (was_whole ? 2 : 1));
    CHECK(is_good(record(bench, was_whole ? 2 : 1)));
  }
}
