// Checks and answers of requests, sessions, retries and telemetry.
#include "test_bench.h"

#include <algorithm>

using namespace ccr;


TEST_CASE("REQ-1: each request is answered once, in order, with its sequence number") {
  Bench bench;
  Bytes stream;
  for (uint8_t sequence = 10; sequence < 20; ++sequence) {
    const Bytes frame = sequence % 2 == 0 ? wire(sequence, GetState{}) : wire(sequence, Stop{});
    stream.insert(stream.end(), frame.begin(), frame.end());
  }
  bench.feed(stream);
  const std::vector<Frame> answers = bench.take_sent();
  REQUIRE(answers.size() == 10);
  for (uint8_t at = 0; at < 10; ++at) {
    CHECK(answers[at].sequence == 10 + at);
    CHECK(answers[at].id == (at % 2 == 0 ? uint8_t{StateReply::kId} : uint8_t{Ack::kId}));
  }
  CHECK(bench.counters().frames_accepted == 11);
}

TEST_CASE("REQ-2: the first failing check is reported") {
  Bench bench;
  const SetLimits wrong_in_all = {7, {{0, -20000}, {0, 0}, {0, 0}}};
  const SetLimits out_of_range = {kSession, {{0, 0}, {0, 20000}, {0, 0}}};
  const SetLimits inconsistent = {kSession, {{0, 1}, {1, 1}, {0, 1}}};

  CHECK(read<Nack>(bench.ask_raw(wire(0x60, 1, {1, 2}))).code == NackCode::kUnknownId);
  CHECK(read<Nack>(bench.ask_raw(wire(SetLimits::kId, 1, {1, 2}))).code == NackCode::kBadLength);
  CHECK(bench.refused(wrong_in_all).code == NackCode::kBadSession);

  bench.make_ready();
  bench.arm();
  const Nack in_arming = bench.refused(out_of_range);
  CHECK(in_arming.request == SetLimits::kId);
  CHECK(in_arming.code == NackCode::kBadState);
  CHECK(in_arming.detail == static_cast<uint8_t>(State::kArming));

  bench.acknowledged(Disarm{kSession});
  bench.tick(200);
  const Nack range = bench.refused(out_of_range);
  CHECK(range.code == NackCode::kOutOfRange);
  CHECK(range.detail == 2);
  const Nack consistency = bench.refused(inconsistent);
  CHECK(consistency.code == NackCode::kInconsistent);
  CHECK(consistency.detail == 1);
}

TEST_CASE("REQ-2: a refused request changes nothing") {
  Bench bench;
  bench.make_ready();
  bench.refused(SetSlew{kSession, {{0, 5}}});
  CHECK(read<SlewReply>(bench.ask(GetSlew{})).slew.slew_cdeg_tick[1] ==
        some_slew().slew_cdeg_tick[1]);
  CHECK(bench.counters().nacks == 1);
}

TEST_CASE("REQ-3: a repeated once-only request gets the same reply and is not executed again") {
  Bench bench;
  bench.make_ready();
  const Bytes request = wire(200, Arm{kSession});
  bench.feed(request);
  const Bytes first = bench.hardware.sent;
  bench.hardware.sent.clear();
  bench.tick(3);
  bench.feed(request);
  CHECK(bench.hardware.sent == first);
  CHECK(bench.counters().repeats_answered == 1);
}

TEST_CASE("REQ-3: the stored reply lasts exactly for the retry window") {
  for (const unsigned age : {kRetryWindowTicks + 0U, kRetryWindowTicks + 1U}) {
    Bench bench;
    bench.make_ready();
    const Bytes request = wire(200, Disarm{kSession});
    bench.feed(request);
    bench.tick(age);
    bench.feed(request);
    CHECK(bench.counters().repeats_answered == (age == kRetryWindowTicks ? 1 : 0));
  }
}

TEST_CASE("REQ-3: an expired reply does not come back however long it takes") {
  Bench bench;
  bench.make_ready();
  const Bytes request = wire(200, Disarm{kSession});
  bench.feed(request);
  bench.tick(70000);
  bench.feed(request);
  CHECK(bench.counters().repeats_answered == 0);
}

TEST_CASE("REQ-3: another sequence number or payload, or a refusal, is not a repetition") {
  Bench bench;
  bench.make_ready();
  bench.feed(wire(200, SetSlew{kSession, {{50, 50}}}));
  bench.feed(wire(201, SetSlew{kSession, {{50, 50}}}));
  bench.feed(wire(201, SetSlew{kSession, {{50, 60}}}));
  bench.feed(wire(202, SetSlew{kSession, {{0, 6}}}));
  bench.feed(wire(202, SetSlew{kSession, {{0, 6}}}));
  CHECK(bench.counters().repeats_answered == 0);
  bench.feed(wire(201, SetSlew{kSession, {{50, 60}}}));
  CHECK(bench.counters().repeats_answered == 1);
}

TEST_CASE("REQ-3: open_session clears the stored reply") {
  Bench bench;
  bench.make_ready();
  const Bytes request = wire(200, Disarm{kSession});
  bench.feed(request);
  bench.open_session();
  bench.feed(request);
  CHECK(bench.counters().repeats_answered == 0);
}

TEST_CASE("REQ-4: ids that are not requests, including replies, get unknown_id") {
  Bench bench;
  for (unsigned id = 0; id <= 255; ++id) {
    if (find_request(static_cast<uint8_t>(id)) == nullptr) {
      const Nack nack = read<Nack>(bench.ask_raw(wire(static_cast<uint8_t>(id), 1, {})));
      CHECK(nack.code == NackCode::kUnknownId);
      CHECK(nack.request == id);
    }
  }
}

TEST_CASE("every request in the spec is dispatched") {
  Bench bench;
  for (const RequestRule& rule : kRequestRules) {
    if (!is_known(rule)) {
      continue;
    }
    const Frame answer = bench.ask_raw(wire(rule.id, 1, Bytes(rule.size)));
    if (answer.id == Nack::kId) {
      CHECK(read<Nack>(answer).code != NackCode::kUnknownId);
      CHECK(read<Nack>(answer).code != NackCode::kBadLength);
    } else {
      CHECK(answer.id == rule.reply_id);
    }
    const Frame too_long = bench.ask_raw(wire(rule.id, 1, Bytes(rule.size + 1U)));
    CHECK(read<Nack>(too_long).code == NackCode::kBadLength);
  }
}

TEST_CASE("a request is only admitted in the states that the spec lists") {
  for (const RequestRule& rule : kRequestRules) {
    Bench bench;  // In boot.
    Bytes payload(rule.size);
    const Frame answer = bench.ask_raw(wire(rule.id, 1, payload));
    const bool is_refused = answer.id == Nack::kId;
    CHECK((is_refused || is_allowed(rule, State::kBoot)));
    CHECK((!is_refused || !is_known(rule) || rule.needs_session ||
           !is_allowed(rule, State::kBoot)));
  }
}

TEST_CASE("an optional request that the board does not announce gets unknown_id") {
  Bench bench;
  CHECK_FALSE(kAnnouncesLinkLimits);
  CHECK((read<HelloReply>(bench.ask(Hello{})).capabilities & capabilities::kLinkLimits) == 0);
  CHECK(bench.refused(GetLinkLimits{}).code == NackCode::kUnknownId);
}

TEST_CASE("hello identifies the board") {
  Bench bench(ResetCause::kBrownOut);
  const HelloReply reply = read<HelloReply>(bench.ask(Hello{9, 1}));
  CHECK(reply.protocol_version == kProtocolVersion);
  CHECK(reply.spec_hash == kSpecHash);
  CHECK(reply.firmware_version[1] == kFirmwareVersion[1]);
  CHECK(reply.boot_id == 1);
  CHECK((reply.reset_cause == ResetCause::kBrownOut));
  CHECK(reply.eeprom_status == EepromStatus::kBlank);
  CHECK(reply.capabilities == (bench.hardware.capabilities() | capabilities::kTimedTargets));
  CHECK(reply.axes == 2);
  CHECK(reply.max_payload == kMaxPayload);
  CHECK(reply.tick_us == kTickUs);
}

TEST_CASE("clock_sync returns the host's time and the board's") {
  Bench bench;
  bench.hardware.now_us = 0xFFFFFFFFUL;
  const ClockReply reply = read<ClockReply>(bench.ask(ClockSync{0x12345678UL}));
  CHECK(reply.host_time_us == 0x12345678UL);
  CHECK(reply.board_time_us == 0xFFFFFFFFUL);
}

TEST_CASE("SES-1: requests that need a session are refused without one and with another one") {
  Bench bench;
  bench.tick(kBootTicks + 1);
  CHECK(bench.refused(Disarm{kSession}).code == NackCode::kBadSession);
  CHECK(bench.refused(Disarm{0}).code == NackCode::kBadSession);
  bench.open_session();
  CHECK(bench.acknowledged(Disarm{kSession}) == State::kDisarmed);
  bench.open_session(5);
  CHECK(bench.refused(Disarm{kSession}).code == NackCode::kBadSession);
}

TEST_CASE("SES-2: another spec hash opens no session and keeps the open one") {
  Bench bench;
  bench.tick(kBootTicks + 1);
  bench.open_session();
  CHECK(bench.refused(OpenSession{kSpecHash ^ 1U, 5}).code == NackCode::kSpecMismatch);
  CHECK(bench.acknowledged(Disarm{kSession}) == State::kDisarmed);
}

TEST_CASE("SES-3: a reset closes the session, ends telemetry and increments the boot counter") {
  Bench bench;
  bench.make_ready();
  bench.acknowledged(SetTelemetry{kSession, 1});
  bench.reset();
  bench.tick(kBootTicks + 1);
  CHECK(bench.take_sent().empty());
  CHECK_FALSE(bench.has_flag(status_flags::kSessionOpen));
  CHECK(read<HelloReply>(bench.ask(Hello{1, kSpecHash})).boot_id == 2);
}

TEST_CASE("SES-3: the boot counter carries from byte to byte and wraps") {
  const uint16_t before_and_after[][2] = {{0xFFFF, 1}, {0xFF, 0x100}, {0xFFFE, 0}};
  for (const auto& step : before_and_after) {
    Bench bench;
    bench.hardware.eeprom = erased_eeprom();
    put_u16(&bench.hardware.eeprom[kEepromBootCounter], step[0]);
    bench.reset();
    CHECK(read<HelloReply>(bench.ask(Hello{1, kSpecHash})).boot_id == step[1]);
  }
}

TEST_CASE("SES-3: boot counts do not repeat, and no cell is written at every reset") {
  Bench bench;
  unsigned boot_id = 1;
  for (unsigned reset = 0; reset < 70000; ++reset) {
    bench.hardware.eeprom_writes = 0;
    bench.reset();
    boot_id = (boot_id + 1) % 0xFFFF;
    REQUIRE(bench.board().controller().boot_id() == boot_id);
    REQUIRE(bench.hardware.eeprom_writes >= 1);
    REQUIRE(bench.hardware.eeprom_writes <= 2);
  }
  const auto most = *std::max_element(bench.hardware.cell_writes.begin(),
                                      bench.hardware.cell_writes.end());
  CHECK(most <= 70000 / kEepromBootCounters + 2);
}

TEST_CASE("TEL-1: a report at every n-th tick after the request, numbered from 0") {
  Bench bench;
  bench.make_ready();
  bench.acknowledged(SetTelemetry{kSession, 3});
  for (unsigned tick = 1; tick <= 3 * 300; ++tick) {
    bench.tick();
    const std::vector<Frame> sent = bench.take_sent();
    REQUIRE(sent.size() == (tick % 3 == 0 ? 1 : 0));
    if (!sent.empty()) {
      CHECK(sent[0].sequence == static_cast<uint8_t>(tick / 3 - 1));
      CHECK(read<Telemetry>(sent[0]).report.state == State::kDisarmed);
    }
  }
  bench.acknowledged(SetTelemetry{kSession, 0});
  bench.tick(5);
  CHECK(bench.take_sent().empty());
}

TEST_CASE("TEL-1: open_session ends the stream") {
  Bench bench;
  bench.make_ready();
  bench.acknowledged(SetTelemetry{kSession, 1});
  bench.open_session();
  bench.tick(5);
  CHECK(bench.take_sent().empty());
}

TEST_CASE("TEL-1: a restarted stream is numbered from 0 again") {
  Bench bench;
  bench.make_ready();
  for (unsigned round = 0; round < 2; ++round) {
    bench.acknowledged(SetTelemetry{kSession, 1});
    bench.tick(2);
    const std::vector<Frame> sent = bench.take_sent();
    REQUIRE(sent.size() == 2);
    CHECK(sent[0].sequence == 0);
    CHECK(sent[1].sequence == 1);
  }
}
