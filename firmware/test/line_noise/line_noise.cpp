// Sends set_target over a line that flips bits, and drops and doubles bytes, and reports the results:
// line_noise FRAMES SEED PROBABILITY, the probability of each kind of damage per byte.
#include <board.h>

#include <cinttypes>
#include <cstdio>
#include <cstdlib>
#include <random>

#include "../test_core/fake_hardware.h"

namespace {

constexpr uint16_t kSession = 0x4D2A;

using Random = std::mt19937_64;

struct Damage {
  Bytes bytes;
  bool any = false;
  bool delimiter = false;
};

/// Damages bytes one by one; the distance to the next damage is drawn, not each byte.
class NoisyLine {
 public:
  NoisyLine(double probability, uint64_t seed) : random_(seed), gap_(3 * probability) {
    bytes_to_damage_ = gap_(random_);
  }

  Damage send(const Bytes& frame) {
    Damage damage;
    damage.bytes.reserve(frame.size() + 4);
    for (size_t at = 0; at < frame.size(); ++at) {
      if (bytes_to_damage_ > 0) {
        --bytes_to_damage_;
        damage.bytes.push_back(frame[at]);
        continue;
      }
      bytes_to_damage_ = gap_(random_);
      damage.any = true;
      damage.delimiter |= at + 1 == frame.size();
      spoil(frame[at], damage.bytes);
    }
    return damage;
  }

  Random& random() { return random_; }

 private:
  void spoil(uint8_t byte, Bytes& line) {
    switch (random_() % 3) {
      case 0:
        line.push_back(static_cast<uint8_t>(byte ^ 1U << random_() % 8));
        break;
      case 1:
        break;
      default:
        line.push_back(byte);
        line.push_back(byte);
        break;
    }
  }

  Random random_;
  std::geometric_distribution<uint64_t> gap_;
  uint64_t bytes_to_damage_ = 0;
};

template <typename Request>
Bytes framed(uint8_t sequence, const Request& request) {
  uint8_t payload[Request::kSize];
  uint8_t wire[ccr::kMaxWireFrame];
  ccr::encode(request, payload);
  const uint8_t size = ccr::encode_frame(Request::kId, sequence, payload, Request::kSize, wire);
  return Bytes(wire, wire + size);
}

void feed(ccr::Board& board, const Bytes& bytes) {
  for (const uint8_t byte : bytes) {
    board.on_byte(byte);
  }
}

void make_armed(ccr::Board& board) {
  for (unsigned tick = 0; tick <= ccr::kBootTicks; ++tick) {
    board.tick();
  }
  feed(board, framed(1, ccr::OpenSession{ccr::kSpecHash, kSession}));
  feed(board, framed(2, ccr::SetLimits{kSession, {{-13500, -13500}, {13500, 13500}, {0, 0}}}));
  feed(board, framed(3, ccr::SetSlew{kSession, {{500, 500}}}));
  feed(board, framed(4, ccr::SetWatchdog{kSession, {60000, 500, 20}}));
  feed(board, framed(5, ccr::SetCalibration{
                            kSession, {{3000, 3000}, {1000, 1000}, {1000, 1000}, {5000, 5000}}}));
  feed(board, framed(6, ccr::Arm{kSession}));
  while (board.controller().state() != ccr::State::kHold) {
    board.tick();
  }
}

struct Result {
  uint64_t damaged = 0;
  uint64_t clean_lost = 0;
  uint64_t clean_lost_unexplained = 0;
  uint64_t bad_frames_past_crc = 0;
  uint64_t bad_commands_accepted = 0;
};

bool is_same(const ccr::FrameDecoder& frame, const Bytes& sent) {
  ccr::FrameDecoder original;
  for (const uint8_t byte : sent) {
    original.feed(byte);
  }
  return frame.id() == original.id() && frame.sequence() == original.sequence() &&
         frame.payload_size() == original.payload_size() &&
         std::equal(frame.payload(), frame.payload() + frame.payload_size(), original.payload());
}

class Trial {
 public:
  Trial(double probability, uint64_t seed)
      : line_(probability, seed), board_(hardware_, {ccr::ResetCause::kPowerOn, false}) {
    make_armed(board_);
  }

  void run(uint64_t frames) {
    for (uint64_t frame = 0; frame < frames; ++frame) {
      send_target(static_cast<uint8_t>(frame));
    }
  }

  const Result& result() const { return result_; }

 private:
  struct Sent {
    uint8_t sequence;
    ccr::SetTarget target;
    Bytes frame;
  };

  void send_target(uint8_t sequence) {
    const int16_t first = static_cast<int16_t>(line_.random()() % 27001 - 13500);
    const int16_t second = static_cast<int16_t>(line_.random()() % 27001 - 13500);
    const ccr::SetTarget target = {kSession, {first, second}, 0, 10000};
    // A frame whose zero was lost may be ended by a zero that damage makes of the next one's start:
    // late, but what was sent.
    before_ = sent_;
    sent_ = {sequence, target, framed(sequence, target)};
    const Damage damage = line_.send(sent_.frame);
    const bool was_understood = receive(damage.bytes);
    result_.damaged += damage.any;
    if (!damage.any && !was_understood) {
      ++result_.clean_lost;
      result_.clean_lost_unexplained += !was_delimiter_damaged_;
    }
    was_delimiter_damaged_ = damage.delimiter;
  }

  bool receive(const Bytes& bytes) {
    bool was_understood = false;
    for (const uint8_t byte : bytes) {
      const uint32_t accepted = board_.controller().counts().targets_accepted;
      board_.on_byte(byte);
      if (witness_.feed(byte) == ccr::Received::kFrame) {
        const bool was_sent = is_same(witness_, sent_.frame) || is_same(witness_, before_.frame);
        result_.bad_frames_past_crc += !was_sent;
      }
      if (board_.controller().counts().targets_accepted != accepted) {
        was_understood |= is_in_use(sent_);
        result_.bad_commands_accepted += !is_in_use(sent_) && !is_in_use(before_);
      }
      result_.bad_commands_accepted += board_.controller().state() == ccr::State::kStopped;
    }
    hardware_.sent.clear();
    return was_understood;
  }

  bool is_in_use(const Sent& sent) const {
    ccr::StateReport report = {};
    board_.controller().fill(report);
    return report.target_sequence == sent.sequence &&
           report.target_cdeg[0] == sent.target.target_cdeg[0] &&
           report.target_cdeg[1] == sent.target.target_cdeg[1];
  }

  NoisyLine line_;
  FakeHardware hardware_;
  ccr::Board board_;
  ccr::FrameDecoder witness_;
  Result result_;
  Sent sent_ = {};
  Sent before_ = {};
  bool was_delimiter_damaged_ = false;
};

}  // namespace

int main(int argc, char** argv) {
  if (argc != 4) {
    std::fprintf(stderr, "usage: line_noise FRAMES SEED PROBABILITY\n");
    return 2;
  }
  const uint64_t frames = std::strtoull(argv[1], nullptr, 10);
  Trial trial(std::strtod(argv[3], nullptr), std::strtoull(argv[2], nullptr, 10));
  trial.run(frames);
  const Result& result = trial.result();
  std::printf("frames %" PRIu64 "\ndamaged %" PRIu64 "\nclean_lost %" PRIu64
              "\nclean_lost_unexplained %" PRIu64 "\nbad_frames_past_crc %" PRIu64
              "\nbad_commands_accepted %" PRIu64 "\n",
              frames, result.damaged, result.clean_lost, result.clean_lost_unexplained,
              result.bad_frames_past_crc, result.bad_commands_accepted);
  return 0;
}
