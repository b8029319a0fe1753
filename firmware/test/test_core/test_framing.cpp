// How the board processes bytes, valid and invalid ones.
#include "test_bench.h"

using namespace ccr;

namespace {

Bytes spoilt(Bytes frame) {
  frame[frame.size() - 2] ^= 0x55;
  return frame;
}

}  // namespace

TEST_CASE("FRM-1: an invalid frame is counted by kind, not answered, and changes nothing") {
  Bench bench;
  bench.make_ready();
  const StateReport before = bench.report();
  bench.take_sent();

  bench.feed(spoilt(wire(1, Arm{kSession})));
  bench.feed({0x09, 0x01, 0x02, 0});
  bench.feed({0x03, 0x01, 0x02, 0});
  CHECK(bench.take_sent().empty());

  const CountersReply counters = bench.counters();
  CHECK(counters.bad_crc == 1);
  CHECK(counters.bad_encoding == 1);
  CHECK(counters.bad_size == 1);
  const StateReport after = bench.report();
  CHECK(after.state == before.state);
  CHECK(after.link_errors == before.link_errors + 3);
}

TEST_CASE("FRM-2: after arbitrary bytes and a zero the next frame is decoded") {
  Bench bench;
  for (const Bytes& noise : {Bytes{0x01}, Bytes{0xFF, 0xFF}, Bytes(300, 0x07), Bytes{5, 4, 3}}) {
    bench.feed(noise);
    bench.feed({0});
    CHECK(bench.ask(GetState{}).id == StateReply::kId);
  }
}

TEST_CASE("FRM-3: zeros between frames are ignored and not counted") {
  Bench bench;
  bench.feed(Bytes(50, 0));
  const CountersReply counters = bench.counters();
  CHECK(counters.bad_size + counters.bad_encoding + counters.bad_crc == 0);
}

TEST_CASE("FRM-4: an oversized frame is counted once, as bad_size") {
  Bench bench;
  bench.feed(Bytes(1000, 0x01));
  bench.feed({0});
  CHECK(bench.counters().bad_size == 1);
}

TEST_CASE("bytes lost before reaching the core are counted as overruns and link errors") {
  Bench bench;
  bench.board().count_overruns(300);
  CHECK(bench.counters().overruns == 300);
  CHECK(bench.report().link_errors == 300);
}

TEST_CASE("a reply that does not fit the buffer is dropped whole and counted") {
  Bench bench;
  bench.hardware.room = 0;
  bench.feed(wire(1, GetState{}));
  CHECK(bench.hardware.sent.empty());
  bench.hardware.room = 255;
  CHECK(bench.counters().replies_dropped == 1);
}

TEST_CASE("REQ-5: only the reply to stop uses the space reserved for it") {
  constexpr uint8_t kAckSize = wire_size(Ack::kSize);
  Bench bench;
  bench.hardware.room = wire_size(ClockReply::kSize) + kAckSize - 1;
  bench.feed(wire(1, ClockSync{}));
  CHECK(bench.hardware.sent.empty());
  bench.hardware.room += 1;
  bench.feed(wire(2, ClockSync{}));
  CHECK(bench.take_sent().size() == 1);
  bench.hardware.room = kAckSize;
  bench.feed(wire(3, Stop{}));
  CHECK(bench.take_sent().size() == 1);
}

TEST_CASE("REQ-5: a request is executed even if its reply does not fit") {
  Bench bench;
  bench.make_armed();
  bench.hardware.room = 0;
  bench.feed(wire(1, Stop{}));
  bench.hardware.room = 255;
  CHECK(bench.state() == State::kStopped);
}
