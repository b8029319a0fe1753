// What depends on the number of axes. Also compiled for 1, 6 and 12 of them.
#include <pulses.h>

#include <cstdlib>

#include "test_bench.h"

using namespace ccr;

namespace {

constexpr uint8_t kLast = kAxes - 1;

unsigned pins_with_pulses(const Pulses& pulses) {
  unsigned count = 0;
  for (const uint16_t pulse : pulses.half_us) {
    count += pulse != kNoPulse;
  }
  return count;
}

/// Another angle for each axis.
SetTarget staircase() {
  SetTarget target = {};
  target.session = kSession;
  target.validity_ms = 10000;
  for (uint8_t axis = 0; axis < kAxes; ++axis) {
    target.target_cdeg[axis] = static_cast<int16_t>(90 * (axis + 1));
  }
  return target;
}

}  // namespace

TEST_CASE("hello tells the number of axes, and the longest payload that goes with it") {
  Bench bench;
  const HelloReply reply = read<HelloReply>(bench.ask(Hello{}));
  CHECK(reply.axes == kAxes);
  CHECK(reply.max_payload == (kAxes > 2 ? 98 : 48));
}

TEST_CASE("REQ-2: the length of each request with axes is exact, and its last axis is checked") {
  Bench bench;
  bench.make_ready();
  for (const RequestRule& rule : kRequestRules) {
    for (const int beyond : {-2, -1, 1, 2}) {
      const int size = rule.size + beyond;
      if (is_known(rule) && size >= 0 && size <= kMaxPayload) {
        const Bytes payload(static_cast<size_t>(size));
        CHECK(read<Nack>(bench.ask_raw(wire(rule.id, 1, payload))).code == NackCode::kBadLength);
      }
    }
  }
  SetSlew slew{kSession, some_slew()};
  slew.slew.slew_cdeg_tick[kLast] = 9;
  CHECK(bench.refused(slew).code == NackCode::kOutOfRange);
  SetLimits limits{kSession, some_limits()};
  limits.limits.angle_min_cdeg[kLast] = limits.limits.angle_max_cdeg[kLast];
  const Nack nack = bench.refused(limits);
  CHECK(nack.code == NackCode::kInconsistent);
  CHECK(nack.detail == kLast);
}

TEST_CASE("ARM-1: the axes get their pulses one after another, at the stated pace") {
  Bench bench;
  bench.make_ready();
  bench.arm();
  const unsigned pace = some_watchdog().arm_axis_ms / kMsPerTick;
  for (unsigned tick = 0; tick < kAxes * pace; ++tick) {
    bench.tick();
    CHECK(pins_with_pulses(bench.pulses) == tick / pace + 1);
  }
}

TEST_CASE("TGT-3, PUL-1: each axis follows its own target, at its own slew") {
  Bench bench;
  bench.make_armed();
  const int16_t before = bench.report().setpoint_cdeg[kLast];
  const SetTarget target = staircase();
  const TargetReply reply = read<TargetReply>(bench.ask(target));
  bench.tick();
  const int moved = bench.report().setpoint_cdeg[kLast] - before;
  CHECK(std::abs(moved) <= some_slew().slew_cdeg_tick[kLast]);
  bench.tick(10);
  const StateReport report = bench.report();
  for (uint8_t axis = 0; axis < kAxes; ++axis) {
    CHECK(reply.target_cdeg[axis] == target.target_cdeg[axis]);
    CHECK(report.setpoint_cdeg[axis] == target.target_cdeg[axis]);
    CHECK(report.pulse_half_us[axis] ==
          pulse_half_us(some_calibration(), axis, target.target_cdeg[axis]));
  }
}

TEST_CASE("TGT-1: only the axis whose target is beyond its limit is clamped") {
  Bench bench;
  bench.make_armed();
  SetTarget target = staircase();
  target.target_cdeg[kLast] = 18000;
  const TargetReply reply = read<TargetReply>(bench.ask(target));
  for (uint8_t axis = 0; axis < kLast; ++axis) {
    CHECK(reply.target_cdeg[axis] == target.target_cdeg[axis]);
  }
  CHECK(reply.target_cdeg[kLast] == some_limits().angle_max_cdeg[kLast]);
  CHECK((reply.flags & status_flags::kClamped) != 0);
}

TEST_CASE("STP-1: stop ends the pulses of all axes in the next frame") {
  Bench bench;
  bench.make_armed();
  CHECK(pins_with_pulses(bench.pulses) == kAxes);
  bench.acknowledged(Stop{});
  bench.tick();
  CHECK(bench.pulses.are_none());
}

TEST_CASE("CFG-2: the saved configuration of all axes is in use after a reset") {
  Bench bench;
  bench.make_ready();
  bench.save();
  bench.reset();
  CHECK(read<HelloReply>(bench.ask(Hello{})).eeprom_status == EepromStatus::kLoaded);
  const Calibration calibration = read<CalibrationReply>(bench.ask(GetCalibration{})).calibration;
  const Limits limits = read<LimitsReply>(bench.ask(GetLimits{})).limits;
  for (uint8_t axis = 0; axis < kAxes; ++axis) {
    CHECK(calibration.neutral_half_us[axis] == some_calibration().neutral_half_us[axis]);
    CHECK(limits.rest_cdeg[axis] == some_limits().rest_cdeg[axis]);
  }
}

TEST_CASE("WDG-3: a silent host ends with all axes at rest, without pulses") {
  Bench bench;
  bench.make_armed();
  bench.ask(staircase());
  for (unsigned tick = 0; tick < 1000 && bench.state() != State::kFault; ++tick) {
    bench.tick();
  }
  const StateReport report = bench.report();
  CHECK(report.fault == Fault::kLinkLoss);
  CHECK(bench.pulses.are_none());
  for (uint8_t axis = 0; axis < kAxes; ++axis) {
    CHECK(report.setpoint_cdeg[axis] == some_limits().rest_cdeg[axis]);
  }
}
