// How targets become pulses.
#include <pulses.h>
#include <setpoint.h>

#include <cmath>
#include <cstdlib>

#include "test_bench.h"

using namespace ccr;

TEST_CASE("TGT-1: a target outside the limits is clamped and reported as clamped") {
  Bench bench;
  bench.make_armed();
  const TargetReply outside = bench.target(18000, -18000);
  CHECK(outside.target_cdeg[0] == 6000);
  CHECK(outside.target_cdeg[1] == -9000);
  CHECK((outside.flags & status_flags::kClamped) != 0);
  const TargetReply inside = bench.target(6000, -8000);
  CHECK((inside.flags & status_flags::kClamped) == 0);
  CHECK(bench.counters().targets_accepted == 2);
  CHECK(bench.counters().targets_clamped == 1);
}

TEST_CASE("TGT-1: a target whose pulse is clamped is reported and counted as clamped") {
  Bench bench;
  bench.make_armed();
  const TargetReply saturated = bench.target(6000, -8010);
  CHECK(saturated.target_cdeg[1] == -8010);
  CHECK((saturated.flags & status_flags::kClamped) != 0);
  CHECK(bench.counters().targets_clamped == 1);
}

TEST_CASE("TGT-2: the ramp is linear, its quotient rounded toward zero") {
  for (const int16_t target : {int16_t{1000}, int16_t{-1000}, int16_t{7}, int16_t{-13500}}) {
    Setpoint setpoint(300);
    setpoint.aim_at(target, 7);
    for (int tick = 1; tick <= 9; ++tick) {
      setpoint.follow_ramp(30000, 0);
      const int part = tick < 7 ? (target - 300) * tick / 7 : target - 300;
      CHECK(setpoint.cdeg() == 300 + part);
    }
  }
}

TEST_CASE("TGT-2: the largest move over the longest ramp does not overflow") {
  Setpoint setpoint(-13500);
  setpoint.aim_at(13500, 500);
  int16_t before = -13500;
  for (int tick = 1; tick <= 500; ++tick) {
    setpoint.follow_ramp(2000, 0);
    CHECK(setpoint.cdeg() - before == 54);
    before = setpoint.cdeg();
  }
  CHECK(setpoint.cdeg() == 13500);
}

TEST_CASE("TGT-2: without a ramp the setpoint heads for the target at once") {
  Setpoint setpoint(0);
  setpoint.aim_at(1500, 0);
  setpoint.follow_ramp(2000, 0);
  CHECK(setpoint.cdeg() == 1500);
}

TEST_CASE("TGT-3: no tick moves the setpoint by more than the slew limit") {
  Setpoint setpoint(-13500);
  setpoint.aim_at(13500, 3);
  for (int tick = 0; tick < 30; ++tick) {
    const int before = setpoint.cdeg();
    setpoint.follow_ramp(999, 0);
    CHECK(std::abs(setpoint.cdeg() - before) <= 999);
  }
  CHECK(setpoint.cdeg() == 13500);
}

TEST_CASE("TGT-4: the latest target replaces the previous one, starting at the current setpoint") {
  Bench bench;
  bench.make_armed();
  bench.target(5000, 1000, 400);
  bench.tick(5);
  const int16_t turned_at = bench.report().setpoint_cdeg[0];
  bench.target(0, 1000, 200);
  const StateReport report = bench.report();
  CHECK(report.target_cdeg[0] == 0);
  CHECK(report.target_age_ms == 0);
  bench.tick();
  CHECK(bench.report().setpoint_cdeg[0] == turned_at - turned_at / 10);
  CHECK(bench.report().target_age_ms == 20);
}

TEST_CASE("TGT-5: a target with a tick takes effect as if it came right before that tick") {
  Bench timed;
  Bench at_once;
  timed.make_armed();
  at_once.make_armed();
  const uint32_t tick = timed.report().tick + 4;
  const SetTargetAt request{kSession, {2000, -1000}, 60, 100, tick};
  CHECK(timed.acknowledged(request) == State::kHold);
  while (at_once.report().tick + 1 != tick) {
    timed.tick();
    at_once.tick();
    CHECK(timed.state() == State::kHold);
  }
  at_once.target(2000, -1000, 60, 100);
  for (unsigned after = 0; after < 12; ++after) {
    timed.tick();
    at_once.tick();
    const StateReport one = timed.report();
    const StateReport other = at_once.report();
    CHECK(one.state == other.state);
    CHECK(one.target_age_ms == other.target_age_ms);
    CHECK(one.setpoint_cdeg[0] == other.setpoint_cdeg[0]);
    CHECK(one.setpoint_cdeg[1] == other.setpoint_cdeg[1]);
  }
  CHECK(timed.counters().targets_accepted == 1);
}

TEST_CASE("TGT-5: a tick that is not ahead is refused, and the tick counter may wrap") {
  Bench bench;
  bench.make_armed();
  const uint32_t now = bench.report().tick;
  for (const uint32_t later : {0x0U, 0xFFFFFFFFU, 0x80000000U}) {
    const uint32_t tick = now + later;
    const Nack nack = bench.refused(SetTargetAt{kSession, {}, 0, 100, tick});
    CHECK(nack.code == NackCode::kOutOfRange);
    CHECK(nack.detail == 4);
  }
  CHECK(bench.refused(SetTargetAt{kSession, {0, 18001}, 0, 100, now + 1}).detail == 1);
  CHECK(bench.refused(SetTargetAt{kSession, {}, 0, 19, now + 1}).detail == 3);
  CHECK(bench.acknowledged(SetTargetAt{kSession, {}, 0, 100, now + 0x7FFFFFFFU}) == State::kHold);
}

TEST_CASE("TGT-5: a newer target, a new session or a stop discards the waiting one") {
  for (const unsigned reason : {0U, 1U, 2U, 3U}) {
    Bench bench;
    bench.make_armed();
    const uint32_t tick = bench.report().tick + 3;
    bench.acknowledged(SetTargetAt{kSession, {2000, 2000}, 0, 1000, tick});
    uint32_t expected = 0;
    switch (reason) {
      case 0:
        bench.target(0, 1000);
        expected = 1;
        break;
      case 1:
        bench.acknowledged(SetTargetAt{kSession, {0, 1000}, 0, 1000, tick + 500});
        break;
      case 2:
        bench.open_session();
        break;
      default:
        bench.acknowledged(Stop{});
        bench.tick();
        bench.acknowledged(ClearFault{kSession});
        bench.arm();
    }
    bench.tick(6);
    CHECK(bench.counters().targets_accepted == expected);
    CHECK(bench.report().setpoint_cdeg[0] == 0);
  }
}

TEST_CASE("the age of a target saturates at 65535") {
  Bench bench;
  CHECK(bench.report().target_age_ms == 65535);
  bench.make_armed();
  bench.target(0, 0);
  bench.tick(3276);
  CHECK(bench.report().target_age_ms == 65520);
  bench.tick();
  CHECK(bench.report().target_age_ms == 65535);
  bench.tick(100);
  CHECK(bench.report().target_age_ms == 65535);
}

TEST_CASE("PUL-1: pulses are rounded halves away from zero and clamped") {
  const int16_t slopes[] = {-4000, -1801, -100, 100, 999, 2000, 4000};
  for (const int16_t slope : slopes) {
    const Calibration calibration = {{3000, 1000}, {slope, slope}, {1000, 1000}, {5000, 1001}};
    for (int angle = -13500; angle <= 13500; ++angle) {
      const double exact = std::round(angle * static_cast<double>(slope) / 9000.0);
      const double expected = std::fmin(std::fmax(3000.0 + exact, 1000.0), 5000.0);
      const uint16_t pulse = pulse_half_us(calibration, 0, static_cast<int16_t>(angle));
      if (pulse != expected) {
        CAPTURE(angle);
        CHECK(pulse == expected);
      }
      if (!is_allowed_pulse(calibration, 1, pulse_half_us(calibration, 1, 5000))) {
        FAIL("outside the calibration");
      }
    }
  }
}

TEST_CASE("PUL-1, TGT-1: a pulse counts as clamped exactly if the unclamped one is out of range") {
  const uint16_t limits[][3] = {
      {3000, 1000, 5000}, {1000, 1000, 1001}, {5000, 4000, 5000}, {3100, 2900, 3101}};
  for (const uint16_t(&of)[3] : limits) {
    for (const int slope : {-4000, -1801, -100, 100, 999, 2000, 4000}) {
      const Calibration calibration = {
          {of[0], of[0]}, {static_cast<int16_t>(slope), 100}, {of[1], of[1]}, {of[2], of[2]}};
      unsigned different = 0;
      for (int angle = -13500; angle <= 13500; ++angle) {
        const double wanted = of[0] + std::round(angle * static_cast<double>(slope) / 9000.0);
        const bool is_beyond = wanted < of[1] || wanted > of[2];
        different += is_saturated(calibration, 0, static_cast<int16_t>(angle)) != is_beyond;
      }
      CHECK(different == 0);
    }
  }
}

TEST_CASE("PUL-1: floor and ceiling apply whatever the calibration") {
  const Calibration absurd = {{3000, 3000}, {4000, 4000}, {0, 0}, {65535, 65535}};
  CHECK(pulse_half_us(absurd, 0, 13500) == kPulseCeilingHalfUs);
  CHECK(pulse_half_us(absurd, 0, -13500) == kPulseFloorHalfUs);
}

TEST_CASE("PUL-1: the calibration's own limits apply within floor and ceiling") {
  const Calibration narrow = {{3000, 3000}, {4000, -4000}, {2900, 2800}, {3100, 3200}};
  CHECK(pulse_half_us(narrow, 0, -13500) == 2900);
  CHECK(pulse_half_us(narrow, 0, 13500) == 3100);
  CHECK(pulse_half_us(narrow, 1, 13500) == 2800);
  CHECK(pulse_half_us(narrow, 1, -13500) == 3200);
}

TEST_CASE("the setpoint is moving until it has reached its goal") {
  Bench bench;
  bench.make_armed();
  bench.target(1000, 1000);
  const bool expected[] = {true, false, false};
  for (const bool is_moving : expected) {
    bench.tick();
    CHECK(bench.has_flag(status_flags::kMoving) == is_moving);
  }
  bench.target(0, 1000, 0, 20);
  bench.tick();
  CHECK(bench.has_flag(status_flags::kMoving));
  bench.tick();
  CHECK(bench.state() == State::kHold);
  CHECK_FALSE(bench.has_flag(status_flags::kMoving));
  bench.acknowledged(Disarm{kSession});
  bench.tick();
  CHECK(bench.has_flag(status_flags::kMoving));
}

TEST_CASE("ACC-1, ACC-2: with an acceleration limit it stops at its goal without overshoot") {
  const uint16_t accelerations[] = {1, 2, 7, 60, 500, 2000};
  const uint16_t slews[] = {10, 333, 2000};
  const int16_t goals[] = {1, -1, 59, -1234, 13500, -13500};
  for (const uint16_t acceleration : accelerations) {
    for (const uint16_t slew : slews) {
      for (const int16_t goal : goals) {
        Setpoint setpoint(0);
        int before = 0;
        int step = 0;
        unsigned ticks = 0;
        while (setpoint.cdeg() != goal || setpoint.is_moving()) {
          setpoint.step_towards(goal, slew, acceleration);
          const int made = setpoint.cdeg() - before;
          CHECK(std::abs(made - step) <= acceleration);
          CHECK(std::abs(made) <= slew);
          CHECK(std::abs(setpoint.cdeg()) <= std::abs(goal));
          CHECK(made * goal >= 0);
          step = made;
          before = setpoint.cdeg();
          REQUIRE(++ticks < 3000);
        }
      }
    }
  }
}

TEST_CASE("ACC-1, ACC-3: the setpoint brakes to a standstill, and is at rest only then") {
  Setpoint setpoint(0);
  for (int tick = 0; tick < 20; ++tick) {
    setpoint.step_towards(9000, 500, 9);
  }
  for (int step = 180 - 9; step >= 0; step -= 9) {
    CHECK(setpoint.is_moving());
    const int before = setpoint.cdeg();
    setpoint.brake(9);
    CHECK(setpoint.cdeg() - before == step);
  }
  CHECK_FALSE(setpoint.is_moving());
  setpoint.step_towards(9000, 500, 9);
  setpoint.brake(0);
  CHECK_FALSE(setpoint.is_moving());
}

TEST_CASE("ACC-2: for any goals the setpoint stays within their range and reaches the last") {
  unsigned random = 1;
  const auto draw = [&random](int below) {
    random = random * 1103515245U + 12345U;
    return static_cast<int>((random >> 8) % static_cast<unsigned>(below));
  };
  for (int run = 0; run < 300; ++run) {
    Setpoint setpoint(0);
    const uint16_t acceleration = static_cast<uint16_t>(1 + draw(300));
    const uint16_t slew = static_cast<uint16_t>(10 + draw(1000));
    int least = 0;
    int greatest = 0;
    int step = 0;
    for (int tick = 0; tick < 1500; ++tick) {
      static int16_t goal;
      if (tick == 0 || (tick < 700 && draw(20) == 0)) {
        goal = static_cast<int16_t>(draw(18001) - 9000);
        least = goal < least ? goal : least;
        greatest = goal > greatest ? goal : greatest;
      }
      const int before = setpoint.cdeg();
      setpoint.step_towards(goal, slew, acceleration);
      CHECK(setpoint.cdeg() >= least);
      CHECK(setpoint.cdeg() <= greatest);
      CHECK(std::abs(setpoint.cdeg() - before - step) <= acceleration);
      step = setpoint.cdeg() - before;
      if (tick == 1499 && 18000 / slew + slew / acceleration + 200 < 800) {
        CHECK(setpoint.cdeg() == goal);
        CHECK_FALSE(setpoint.is_moving());
      }
    }
  }
}
