// The states of the board, observed at the pulses.
#include "test_bench.h"

using namespace ccr;

namespace {

/// Number of ticks until the board is in a state, including the tick that reaches it.
unsigned ticks_until(Bench& bench, State state, unsigned most = 5000) {
  for (unsigned ticks = 0; ticks <= most; ++ticks) {
    if (bench.state() == state) {
      return ticks;
    }
    bench.tick();
  }
  FAIL("never got there");
  return most;
}

void bring_to(Bench& bench, State state) {
  switch (state) {
    case State::kBoot:
      return;
    case State::kDisarmed:
      return bench.make_ready();
    case State::kArming:
      bench.make_ready();
      bench.arm();
      return bench.tick(3);
    case State::kHold:
      return bench.make_armed();
    case State::kActive:
      bench.make_armed();
      bench.target(3000, 3000);
      return bench.tick(4);
    case State::kRelaxing:
      bench.make_armed();
      bench.target(3000, 3000, 0, 200);
      ticks_until(bench, State::kRelaxing);
      return;
    case State::kDisarming:
      bench.make_armed();
      bench.target(3000, 3000);
      bench.tick(6);
      bench.acknowledged(Disarm{kSession});
      return;
    case State::kFault:
      bench.make_armed();
      ticks_until(bench, State::kFault);
      return;
    case State::kStopped:
      bench.make_armed();
      bench.acknowledged(Stop{});
      return;
  }
}

constexpr State kAllStates[] = {State::kBoot,     State::kDisarmed,  State::kArming,
                                State::kActive,   State::kHold,      State::kRelaxing,
                                State::kDisarming, State::kFault,    State::kStopped};

}  // namespace

TEST_CASE("TIM-1: the report counts the ticks") {
  Bench bench;
  CHECK(bench.report().tick == 0);
  bench.tick(7);
  CHECK(bench.report().tick == 7);
}

TEST_CASE("TIM-3: boot ends at the tick after boot_ticks, not earlier") {
  Bench bench;
  bench.tick(kBootTicks);
  CHECK(bench.state() == State::kBoot);
  bench.tick();
  CHECK(bench.state() == State::kDisarmed);
}

TEST_CASE("TIM-3: a target expires after the number of ticks in its validity") {
  for (uint16_t validity_ms = 20; validity_ms <= 121; ++validity_ms) {
    Bench bench;
    bench.make_armed();
    bench.target(0, 1000, 0, validity_ms);
    const unsigned ticks = (validity_ms + 19U) / 20U;
    bench.tick(ticks);
    CHECK(bench.state() == State::kActive);
    bench.tick();
    CHECK(bench.state() == State::kHold);
  }
}

TEST_CASE("TIM-3: conversion of a duration to ticks") {
  CHECK(ticks_of_ms(0) == 0);
  CHECK(ticks_of_ms(1) == 1);
  CHECK(ticks_of_ms(20) == 1);
  CHECK(ticks_of_ms(21) == 2);
  CHECK(ticks_of_ms(65535) == 3277);
}

TEST_CASE("TIM-4: each tick makes one transition, then updates setpoint, pulses and report") {
  Bench bench;
  bench.make_armed();
  bench.target(3000, 1000, 0, 20);
  bench.acknowledged(SetTelemetry{kSession, 1});
  bench.tick();
  const StateReport active = read<Telemetry>(bench.take_sent().back()).report;
  CHECK(active.state == State::kActive);
  CHECK(active.setpoint_cdeg[0] == 500);
  CHECK(active.pulse_half_us[0] == 3111);
  bench.tick();
  const StateReport hold = read<Telemetry>(bench.take_sent().back()).report;
  CHECK(hold.state == State::kHold);
  CHECK(hold.setpoint_cdeg[0] == 500);
}

TEST_CASE("TIM-5: requests are answered during boot") {
  Bench bench;
  CHECK(read<HelloReply>(bench.ask(Hello{1, kSpecHash})).boot_id == 1);
  CHECK(bench.state() == State::kBoot);
}

TEST_CASE("ARM-1: the axes get pulses one after another at their last setpoint, then go to rest") {
  Bench bench;
  bench.make_ready();
  const Limits elsewhere = {{2000, 2000}, {6000, 9000}, {2500, 2100}};
  bench.acknowledged(SetLimits{kSession, elsewhere});
  REQUIRE(bench.report().setpoint_cdeg[0] == 0);  // that of the last tick
  bench.tick();
  REQUIRE(bench.report().setpoint_cdeg[0] == 2000);

  bench.arm();
  for (unsigned tick = 0; tick < 4; ++tick) {
    bench.tick();
    CHECK(bench.pulses.half_us[0] == 3444);
    CHECK((bench.pulses.half_us[1] != kNoPulse) == (tick >= 2));
    CHECK(bench.report().setpoint_cdeg[0] == 2000);
  }
  for (unsigned tick = 1; tick <= 5; ++tick) {
    bench.tick();
    CHECK(bench.report().setpoint_cdeg[0] == static_cast<int16_t>(2000 + 100 * tick));
    CHECK(bench.state() == State::kArming);
  }
  bench.tick();
  CHECK(bench.state() == State::kHold);
}

TEST_CASE("ARM-1: if already at rest, hold begins once both axes have waited") {
  Bench bench;
  bench.make_ready();
  bench.acknowledged(SetLimits{kSession, {{-1, -1}, {1, 1}, {0, 0}}});
  bench.arm();
  bench.tick(4);
  CHECK(bench.state() == State::kArming);
  bench.tick();
  CHECK(bench.state() == State::kHold);
}

TEST_CASE("ARM-2: arm and save_config name the missing groups") {
  Bench bench;
  bench.tick(kBootTicks + 1);
  bench.open_session();
  CHECK(bench.refused(Arm{kSession}).code == NackCode::kNotConfigured);
  CHECK(bench.refused(Arm{kSession}).detail == kRobotsGroups);
  bench.acknowledged(SetSlew{kSession, some_slew()});
  bench.acknowledged(SetLimits{kSession, some_limits()});
  const Nack nack = bench.refused(SaveConfig{kSession});
  CHECK(nack.code == NackCode::kNotConfigured);
  CHECK(nack.detail == (config_groups::kWatchdog | config_groups::kCalibration));
}

TEST_CASE("ARM-3: the setpoint survives stop and fault; a reset sets it to the rest pose") {
  Bench bench;
  bench.make_armed();
  bench.target(3000, 3000);
  bench.tick(10);
  bench.acknowledged(Stop{});
  bench.tick();
  CHECK(bench.report().setpoint_cdeg[0] == 3000);
  bench.acknowledged(ClearFault{kSession});
  bench.save();
  CHECK(bench.report().setpoint_cdeg[0] == 3000);
  bench.reset();
  CHECK(bench.report().setpoint_cdeg[0] == some_limits().rest_cdeg[0]);
  CHECK(bench.report().setpoint_cdeg[1] == some_limits().rest_cdeg[1]);
}

TEST_CASE("ARM-4: after a reset only arm enables pulses") {
  Bench bench;
  bench.make_armed();
  bench.acknowledged(Stop{});
  bench.tick();
  bench.acknowledged(ClearFault{kSession});
  bench.save();
  bench.reset();
  for (unsigned tick = 0; tick < 1000; ++tick) {
    bench.tick();
    CHECK_FALSE(bench.has_pulses());
  }
  CHECK(bench.state() == State::kDisarmed);
}

TEST_CASE("disarming while arming enables no pulses on an axis that had none") {
  Bench bench;
  bench.make_ready();
  bench.arm();
  bench.tick();
  bench.acknowledged(Disarm{kSession});
  while (bench.state() == State::kDisarming) {
    CHECK(bench.pulses.half_us[1] == kNoPulse);
    bench.tick();
  }
  CHECK(bench.state() == State::kDisarmed);
}

TEST_CASE("disarm moves to rest with pulses, then stops them") {
  Bench bench;
  bring_to(bench, State::kDisarming);
  bool was_seen = false;
  while (bench.state() == State::kDisarming) {
    was_seen = true;
    CHECK(bench.has_pulses());
    bench.tick();
  }
  CHECK(was_seen);
  CHECK(bench.state() == State::kDisarmed);
  CHECK_FALSE(bench.has_pulses());
  CHECK(bench.report().setpoint_cdeg[0] == some_limits().rest_cdeg[0]);
}

TEST_CASE("PUL-2: pulses are only present in the states that allow them") {
  for (const State state : kAllStates) {
    Bench bench;
    bring_to(bench, state);
    bench.tick();
    const bool may_have = state == State::kArming || state == State::kActive ||
                          state == State::kHold || state == State::kRelaxing ||
                          state == State::kDisarming;
    CAPTURE(state);
    CHECK(bench.has_pulses() == may_have);
  }
}

TEST_CASE("WDG-1: when the target expires the setpoint stops, in hold") {
  Bench bench;
  bench.make_armed();
  bench.target(5000, 5000, 1000, 200);
  ticks_until(bench, State::kHold);
  const int16_t stood_at = bench.report().setpoint_cdeg[0];
  CHECK(stood_at > 0);
  CHECK(stood_at < 5000);
  bench.tick(5);
  CHECK(bench.report().setpoint_cdeg[0] == stood_at);
  CHECK(bench.counters().holds == 1);
}

TEST_CASE("WDG-2: nothing but set_target feeds the link watchdog") {
  Bench bench;
  bench.make_armed();
  bench.target(3000, 3000, 0, 100);
  for (unsigned tick = 0; tick < 6; ++tick) {
    bench.tick();
    bench.ask(Hello{1, kSpecHash});
    bench.ask(ClockSync{1});
    bench.ask(SetTelemetry{kSession, 0});
    bench.open_session();
    bench.refused(SetTarget{9, {0, 0}, 0, 1000});
    bench.refused(SetTarget{kSession, {0, 0}, 0, 19});
  }
  CHECK(bench.state() == State::kHold);
}

TEST_CASE("WDG-3: after hold the setpoint goes to rest at the lower of the two slew limits") {
  Bench bench;
  bench.make_armed();
  bench.target(3000, 3000, 0, 400);
  ticks_until(bench, State::kHold);
  CHECK(ticks_until(bench, State::kRelaxing) == 10);
  const int16_t before = bench.report().setpoint_cdeg[0];
  bench.tick();
  CHECK(bench.report().setpoint_cdeg[0] == before - 100);
  CHECK(bench.counters().relaxes == 1);
}

TEST_CASE("WDG-4: a fresh target ends hold and relaxing") {
  for (const State state : {State::kHold, State::kRelaxing}) {
    Bench bench;
    bring_to(bench, state);
    CHECK(bench.target(1000, 1000).state == State::kActive);
  }
}

TEST_CASE("WDG-5: reaching rest after relaxing raises the fault link_loss, without pulses") {
  Bench bench;
  bring_to(bench, State::kRelaxing);
  CHECK(bench.has_pulses());
  ticks_until(bench, State::kFault);
  CHECK(bench.fault() == Fault::kLinkLoss);
  CHECK_FALSE(bench.has_pulses());
  CHECK(bench.report().setpoint_cdeg[0] == some_limits().rest_cdeg[0]);
}

TEST_CASE("STP-1: stop ends the pulses at the next tick, in every state, without a session") {
  for (const State state : kAllStates) {
    Bench bench;
    bring_to(bench, state);
    CHECK(bench.acknowledged(Stop{}) == State::kStopped);
    bench.tick();
    CHECK_FALSE(bench.has_pulses());
    CHECK(bench.state() == State::kStopped);
  }
}

TEST_CASE("FLT-1: the first fault is kept until it is cleared") {
  Bench bench;
  bench.make_armed();
  bench.board().raise_fault(Fault::kStackLow);
  bench.board().raise_fault(Fault::kTickOverrun);
  CHECK(bench.state() == State::kFault);
  CHECK(bench.fault() == Fault::kStackLow);
  bench.tick();
  CHECK_FALSE(bench.has_pulses());
  bench.acknowledged(ClearFault{kSession});
  CHECK(bench.fault() == Fault::kNone);
}

TEST_CASE("FLT-1: a fault in stopped is recorded and does not change the state") {
  Bench bench;
  bench.make_ready();
  bench.acknowledged(Stop{});
  bench.board().raise_fault(Fault::kStackLow);
  CHECK(bench.fault() == Fault::kStackLow);
  CHECK(bench.state() == State::kStopped);
}

TEST_CASE("FLT-2: fault and stopped are left only by clear_fault, to disarmed") {
  for (const State state : {State::kFault, State::kStopped}) {
    Bench bench;
    bring_to(bench, state);
    bench.tick(200);
    CHECK(bench.refused(Arm{kSession}).code == NackCode::kBadState);
    CHECK(bench.refused(Disarm{kSession}).code == NackCode::kBadState);
    CHECK(bench.refused(SetTarget{kSession, {0, 0}, 0, 100}).code == NackCode::kBadState);
    CHECK(bench.state() == state);
    CHECK(bench.acknowledged(ClearFault{kSession}) == State::kDisarmed);
  }
}

TEST_CASE("FLT-4: a latch is cleared only after a frame without pulses") {
  Bench bench;
  bench.make_armed();
  bench.acknowledged(Stop{});
  CHECK(bench.refused(ClearFault{kSession}).code == NackCode::kBusy);
  CHECK(bench.refused(Arm{kSession}).code == NackCode::kBadState);
  bench.tick();
  CHECK_FALSE(bench.has_pulses());
  CHECK(bench.acknowledged(ClearFault{kSession}) == State::kDisarmed);
}

TEST_CASE("FLT-3: boot ends in a fault after the watchdog or a brown-out") {
  const struct {
    ResetCause cause;
    Fault fault;
  } expected[] = {{ResetCause::kWatchdog, Fault::kWatchdogReset},
                  {ResetCause::kBrownOut, Fault::kBrownOutReset},
                  {ResetCause::kExternal, Fault::kNone},
                  {ResetCause::kUnknown, Fault::kNone}};
  for (const auto& entry : expected) {
    Bench bench(entry.cause);
    bench.tick(kBootTicks);
    CHECK(bench.state() == State::kBoot);
    bench.tick();
    CHECK(bench.fault() == entry.fault);
    CHECK(bench.state() == (entry.fault == Fault::kNone ? State::kDisarmed : State::kFault));
  }
}

TEST_CASE("FLT-3: boot ends in a fault after an unknown reset that interrupted pulses") {
  Bench bench;
  bench.make_armed();
  bench.reset(ResetCause::kUnknown);
  bench.tick(kBootTicks);
  CHECK(bench.state() == State::kBoot);
  bench.tick();
  CHECK(bench.state() == State::kFault);
  CHECK(bench.fault() == Fault::kResetWhileArmed);
  bench.reset(ResetCause::kUnknown);
  bench.tick(kBootTicks + 1);
  CHECK(bench.state() == State::kDisarmed);
}

TEST_CASE("WDG-6: slew limits too low to reach rest in time are refused") {
  Bench bench;
  bench.make_ready();
  CHECK(bench.refused(SetSlew{kSession, {{9, 10}}}).code == NackCode::kOutOfRange);
  CHECK(bench.refused(SetWatchdog{kSession, {200, 9, 40}}).code == NackCode::kOutOfRange);
  CHECK(bench.acknowledged(SetSlew{kSession, {{10, 10}}}) == State::kDisarmed);
}

TEST_CASE("FLT-3: stop during boot takes precedence over the fault of the reset") {
  Bench bench(ResetCause::kWatchdog);
  bench.acknowledged(Stop{});
  bench.tick(kBootTicks + 1);
  CHECK(bench.state() == State::kStopped);
  CHECK(bench.fault() == Fault::kNone);
}

TEST_CASE("an invalid state, as after a bit flip in memory, is a fault without pulses") {
  Safety safety({ResetCause::kPowerOn, false});
  // A state that the class itself cannot reach.
  *reinterpret_cast<uint8_t*>(&safety) = 0x7F;
  REQUIRE_FALSE(is_state(static_cast<uint8_t>(safety.state())));
  safety.tick(false, some_watchdog());
  CHECK(safety.state() == State::kFault);
  CHECK(safety.fault() == Fault::kInternal);
  CHECK_FALSE(safety.allows_pulses(0));
}
