// Outputs of the board other than the servo pulses.
#include <string>

#include "test_bench.h"

using namespace ccr;

namespace {

/// Pattern of the next eight steps, from the first on, with a mark for each with the LED on.
std::string shown(Bench& bench) {
  while (bench.report().tick % (8 * kLedStepTicks) != 8 * kLedStepTicks - 1) {
    bench.tick();
  }
  std::string steps;
  for (unsigned step = 0; step < 8; ++step) {
    bench.tick();
    const bool is_on = bench.hardware.is_led_on;
    for (unsigned tick = 1; tick < kLedStepTicks; ++tick) {
      bench.tick();
      CHECK(bench.hardware.is_led_on == is_on);
    }
    steps += is_on ? '#' : '.';
  }
  return steps;
}

}  // namespace

TEST_CASE("LED-1: the LED shows the state") {
  Bench bench;
  bench.tick();
  CHECK(bench.hardware.is_led_on);
  bench.make_ready();
  CHECK(shown(bench) == "#.......");
  bench.acknowledged(Stop{});
  CHECK(shown(bench) == "#.#.....");
  bench.acknowledged(ClearFault{kSession});
  bench.board().raise_fault(Fault::kInternal);
  CHECK(shown(bench) == "#.#.#...");
  bench.acknowledged(ClearFault{kSession});
  bench.acknowledged(SetWatchdog{kSession, {60000, 10, 5000}});
  bench.arm();
  CHECK(shown(bench) == "#.#.#.#.");
  while (bench.state() == State::kArming) {
    bench.tick();
  }
  CHECK(shown(bench) == "#######.");
  bench.target(6000, 6000, 0, 10000);
  CHECK(shown(bench) == "########");
  bench.acknowledged(Disarm{kSession});
  CHECK(shown(bench) == "##..##..");
}

TEST_CASE("LED-2: the LED blinks for the requested time") {
  Bench bench;
  bench.make_ready();
  CHECK((bench.acknowledged(Blink{1}) == State::kDisarmed));
  for (unsigned tick = 0; tick < 50; ++tick) {
    bench.tick();
    CHECK(bench.hardware.is_led_on == (bench.report().tick / kBlinkStepTicks % 2 == 0));
  }
  CHECK(shown(bench) == "#.......");
}

TEST_CASE("SUP-1: the servo supply is on from arming until the pulses end") {
  Bench bench;
  bench.make_ready();
  CHECK_FALSE(bench.hardware.is_supply_on);
  bench.arm();
  CHECK_FALSE(bench.hardware.is_supply_on);
  while (bench.state() != State::kHold) {
    bench.tick();
    CHECK(bench.hardware.is_supply_on);
  }
  bench.target(1000, 1000);
  bench.tick(3);
  bench.acknowledged(Disarm{kSession});
  while (bench.state() != State::kDisarmed) {
    CHECK(bench.hardware.is_supply_on);
    bench.tick();
  }
  CHECK_FALSE(bench.hardware.is_supply_on);
  bench.arm();
  bench.tick();
  bench.board().raise_fault(Fault::kInternal);
  CHECK(bench.hardware.is_supply_on);
  bench.tick();
  CHECK_FALSE(bench.hardware.is_supply_on);
}
