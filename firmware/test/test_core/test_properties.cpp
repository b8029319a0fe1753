// Properties that hold for random requests, with fixed seeds.
#include <random>

#include "test_bench.h"
#include "watched_board.h"

using namespace ccr;

namespace {

using Random = std::mt19937;

int between(Random& random, int least, int most) {
  return std::uniform_int_distribution<int>(least, most)(random);
}

template <typename Number>
Number any(Random& random, int least, int most) {
  return static_cast<Number>(between(random, least, most));
}

Limits random_limits(Random& random) {
  Limits limits = {};
  for (int axis = 0; axis < kAxes; ++axis) {
    limits.angle_min_cdeg[axis] = any<int16_t>(random, -13500, 0);
    limits.angle_max_cdeg[axis] = any<int16_t>(random, -100, 13600);
    limits.rest_cdeg[axis] = any<int16_t>(random, -100, 100);
  }
  return limits;
}

Calibration random_calibration(Random& random) {
  Calibration calibration = {};
  for (int axis = 0; axis < kAxes; ++axis) {
    calibration.neutral_half_us[axis] = any<uint16_t>(random, 2400, 3600);
    calibration.per_90_deg_half_us[axis] = any<int16_t>(random, -4010, 4000);
    calibration.pulse_min_half_us[axis] = any<uint16_t>(random, 990, 2500);
    calibration.pulse_max_half_us[axis] = any<uint16_t>(random, 3500, 5010);
  }
  return calibration;
}

Slew random_slew(Random& random) {
  Slew slew = {};
  for (int axis = 0; axis < kAxes; ++axis) {
    slew.slew_cdeg_tick[axis] = any<uint16_t>(random, axis % 2, 2001);
  }
  return slew;
}

SetTarget random_target(Random& random, uint16_t session) {
  SetTarget target = {session, {}, any<uint16_t>(random, 0, 2000), any<uint16_t>(random, 19, 600)};
  for (int axis = 0; axis < kAxes; ++axis) {
    target.target_cdeg[axis] = any<int16_t>(random, -18000, 18000);
  }
  return target;
}

Bytes random_request(Random& random) {
  const uint8_t sequence = any<uint8_t>(random, 0, 255);
  const uint16_t session = between(random, 0, 50) == 0 ? uint16_t{1} : kSession;
  switch (between(random, 0, 19)) {
    case 0:
      return wire(sequence, OpenSession{kSpecHash, session});
    case 1:
      return wire(sequence, SetLimits{session, random_limits(random)});
    case 2:
      return wire(sequence, SetSlew{session, random_slew(random)});
    case 3:
      return wire(sequence, SetWatchdog{session, {any<uint16_t>(random, 19, 500),
                                                  any<uint16_t>(random, 9, 500),
                                                  any<uint16_t>(random, 19, 200)}});
    case 4:
      return wire(sequence, SetCalibration{session, random_calibration(random)});
    case 5:
      return wire(sequence, SaveConfig{session});
    case 6:
    case 7:
    case 8:
      return wire(sequence, Arm{session});
    case 9:
      return wire(sequence, Disarm{session});
    case 10:
      return wire(sequence, Stop{});
    case 11:
    case 12:
      return wire(sequence, ClearFault{session});
    case 13:
      return wire(sequence, SetTelemetry{session, any<uint8_t>(random, 0, 3)});
    case 14:
      return wire(any<uint8_t>(random, 0, 255), sequence, Bytes(any<uint8_t>(random, 0, kMaxPayload)));
    default:
      return wire(sequence, random_target(random, session));
  }
}

void configure(WatchedBoard& board) {
  uint8_t sequence = 0;
  board.feed(wire(++sequence, OpenSession{kSpecHash, kSession}));
  board.feed(wire(++sequence, SetLimits{kSession, some_limits()}));
  board.feed(wire(++sequence, SetSlew{kSession, some_slew()}));
  board.feed(wire(++sequence, SetWatchdog{kSession, some_watchdog()}));
  board.feed(wire(++sequence, SetCalibration{kSession, some_calibration()}));
}

}  // namespace

TEST_CASE("PUL-2, TGT-3 and the table of transitions hold for random requests and ticks") {
  unsigned pulses_seen = 0;
  unsigned states_seen = 0;
  for (unsigned seed = 1; seed <= 30; ++seed) {
    Random random(seed);
    WatchedBoard board(seed % 4 == 0 ? ResetCause::kWatchdog : ResetCause::kPowerOn);
    for (unsigned tick = 0; tick <= kBootTicks; ++tick) {
      board.tick();
    }
    configure(board);
    for (unsigned step = 0; step < 3000; ++step) {
      if (between(random, 0, 3) > 0) {
        board.tick();
      } else {
        board.feed(random_request(random));
      }
      REQUIRE(board.broken() == "");
    }
    pulses_seen += board.pulses_seen();
    states_seen |= board.states_seen();
  }
  MESSAGE("pulses seen: ", pulses_seen);
  CHECK(pulses_seen > (kAxes == 1 ? 10000 : 20000));
  for (unsigned state = 0; is_state(static_cast<uint8_t>(state)); ++state) {
    CAPTURE(state);
    CHECK((states_seen >> state & 1U) != 0);
  }
}
