// A test bench for a board: sends requests, runs ticks, resets it, and provides valid requests.
#pragma once

#include <board.h>
#include <doctest/doctest.h>
#include <link_limits.h>

#include <memory>

#include "fake_hardware.h"

struct Frame {
  uint8_t id;
  uint8_t sequence;
  Bytes payload;
};

inline std::vector<Frame> frames_in(const Bytes& bytes) {
  ccr::FrameDecoder decoder;
  std::vector<Frame> frames;
  for (const uint8_t byte : bytes) {
    if (decoder.feed(byte) == ccr::Received::kFrame) {
      frames.push_back({decoder.id(), decoder.sequence(),
                        Bytes(decoder.payload(), decoder.payload() + decoder.payload_size())});
    }
  }
  return frames;
}

inline Bytes wire(uint8_t id, uint8_t sequence, const Bytes& payload) {
  uint8_t encoded[ccr::kMaxWireFrame];
  const uint8_t size = ccr::encode_frame(id, sequence, payload.data(),
                                         static_cast<uint8_t>(payload.size()), encoded);
  return Bytes(encoded, encoded + size);
}

template <typename Message>
Bytes wire(uint8_t sequence, const Message& message) {
  Bytes payload(Message::kSize);
  ccr::encode(message, payload.data());
  return wire(Message::kId, sequence, payload);
}

template <typename Message>
Message read(const Frame& frame) {
  Message message = {};
  REQUIRE(frame.id == Message::kId);
  REQUIRE((ccr::decode(frame.payload.data(), static_cast<uint8_t>(frame.payload.size()), message) ==
           ccr::Reading::kOk));
  return message;
}

constexpr uint16_t kSession = 0x4D2A;

/// Whether the board offers a request of the spec; it may be optional.
inline bool is_known(const ccr::RequestRule& rule) {
  return rule.id != ccr::GetLinkLimits::kId || ccr::kAnnouncesLinkLimits;
}

/// Sets the first axis and every second one after it to one value, and the others to another one.
template <typename Number>
void set_in_turn(Number (&values)[ccr::kAxes], Number first, Number second) {
  for (uint8_t axis = 0; axis < ccr::kAxes; ++axis) {
    values[axis] = axis % 2 == 0 ? first : second;
  }
}

inline ccr::Limits some_limits() {
  ccr::Limits limits;
  set_in_turn<int16_t>(limits.angle_min_cdeg, -6000, -9000);
  set_in_turn<int16_t>(limits.angle_max_cdeg, 6000, 9000);
  set_in_turn<int16_t>(limits.rest_cdeg, 0, 1000);
  return limits;
}
inline ccr::Slew some_slew() {
  ccr::Slew slew;
  set_in_turn<uint16_t>(slew.slew_cdeg_tick, 500, 400);
  return slew;
}
/// Ten ticks of hold, two for each axis.
inline ccr::Watchdog some_watchdog() { return {200, 100, 40}; }
inline ccr::Calibration some_calibration() {
  ccr::Calibration calibration;
  set_in_turn<uint16_t>(calibration.neutral_half_us, 3000, 3100);
  set_in_turn<int16_t>(calibration.per_90_deg_half_us, 2000, -1800);
  set_in_turn<uint16_t>(calibration.pulse_min_half_us, 1200, 1300);
  set_in_turn<uint16_t>(calibration.pulse_max_half_us, 4800, 4700);
  return calibration;
}

class Bench {
 public:
  explicit Bench(ccr::ResetCause cause = ccr::ResetCause::kPowerOn) { reset(cause); }

  FakeHardware hardware;
  ccr::Pulses pulses = {};

  void reset(ccr::ResetCause cause = ccr::ResetCause::kExternal) {
    hardware.sent.clear();
    board_.reset(new ccr::Board(hardware, {cause, has_pulses()}));
    pulses = {};
  }

  void tick(unsigned count = 1) {
    for (unsigned at = 0; at < count; ++at) {
      pulses = board_->tick();
      board_->report();
    }
  }

  void feed(const Bytes& bytes) {
    for (const uint8_t byte : bytes) {
      board_->on_byte(byte);
    }
  }

  std::vector<Frame> take_sent() {
    const std::vector<Frame> frames = frames_in(hardware.sent);
    hardware.sent.clear();
    return frames;
  }

  /// Sends a request and returns its only answer.
  Frame ask_raw(const Bytes& request) {
    take_sent();
    feed(request);
    const std::vector<Frame> frames = take_sent();
    REQUIRE(frames.size() == 1);
    return frames[0];
  }

  template <typename Request>
  Frame ask(const Request& request) {
    return ask_raw(wire(++sequence_, request));
  }

  template <typename Request>
  ccr::State acknowledged(const Request& request) {
    return read<ccr::Ack>(ask(request)).state;
  }

  template <typename Request>
  ccr::Nack refused(const Request& request) {
    return read<ccr::Nack>(ask(request));
  }

  ccr::StateReport report() { return read<ccr::StateReply>(ask(ccr::GetState{})).report; }
  ccr::CountersReply counters() { return read<ccr::CountersReply>(ask(ccr::GetCounters{})); }
  ccr::State state() { return report().state; }
  ccr::Fault fault() { return report().fault; }
  bool has_flag(uint8_t flag) { return (report().flags & flag) != 0; }
  uint8_t last_sequence() const { return sequence_; }
  ccr::Board& board() { return *board_; }

  void open_session(uint16_t session = kSession) {
    read<ccr::SessionReply>(ask(ccr::OpenSession{ccr::kSpecHash, session}));
  }

  void configure() {
    acknowledged(ccr::SetLimits{kSession, some_limits()});
    acknowledged(ccr::SetSlew{kSession, some_slew()});
    acknowledged(ccr::SetWatchdog{kSession, some_watchdog()});
    acknowledged(ccr::SetCalibration{kSession, some_calibration()});
  }

  /// Boots the board, opens a session and configures it.
  void make_ready() {
    tick(ccr::kBootTicks + 1);
    open_session();
    configure();
    REQUIRE((state() == ccr::State::kDisarmed));
  }

  void arm() { REQUIRE((acknowledged(ccr::Arm{kSession}) == ccr::State::kArming)); }

  /// Configures and arms the board, at rest.
  void make_armed() {
    make_ready();
    arm();
    for (unsigned guard = 0; state() != ccr::State::kHold; ++guard) {
      REQUIRE(guard < 1000);
      tick();
    }
  }

  ccr::TargetReply target(int16_t first, int16_t second, uint16_t ramp_ms = 0,
                          uint16_t validity_ms = 10000) {
    ccr::SetTarget target{kSession, {}, ramp_ms, validity_ms};
    set_in_turn(target.target_cdeg, first, second);
    return read<ccr::TargetReply>(ask(target));
  }

  void save() {
    acknowledged(ccr::SaveConfig{kSession});
    tick(ccr::kEepromSlotSize + 1U);
    REQUIRE_FALSE(has_flag(ccr::status_flags::kEepromBusy));
  }

  bool has_pulses() const { return !pulses.are_none(); }

 private:
  std::unique_ptr<ccr::Board> board_;
  uint8_t sequence_ = 0;
};

namespace ccr {
inline doctest::String toString(State value) { return doctest::toString(static_cast<int>(value)); }
inline doctest::String toString(Fault value) { return doctest::toString(static_cast<int>(value)); }
inline doctest::String toString(NackCode value) {
  return doctest::toString(static_cast<int>(value));
}
inline doctest::String toString(EepromStatus value) {
  return doctest::toString(static_cast<int>(value));
}
}  // namespace ccr
