// libFuzzer target: the input is a script of events on a board, which must break no rule.
#include <cstdio>

#include "../test_core/watched_board.h"

namespace {

/// Splits the input; past its end there are zeros.
class Script {
 public:
  Script(const uint8_t* data, size_t size) : data_(data), left_(size) {}

  bool is_over() const { return left_ == 0; }

  uint8_t byte() {
    if (is_over()) {
      return 0;
    }
    --left_;
    return *data_++;
  }

  Bytes bytes(size_t count) {
    Bytes taken(count);
    for (uint8_t& byte_taken : taken) {
      byte_taken = byte();
    }
    return taken;
  }

 private:
  const uint8_t* data_;
  size_t left_;
};

Bytes framed(uint8_t id, uint8_t sequence, const Bytes& payload) {
  uint8_t wire[ccr::kMaxWireFrame];
  const uint8_t size = ccr::encode_frame(id, sequence, payload.data(),
                                         static_cast<uint8_t>(payload.size()), wire);
  return Bytes(wire, wire + size);
}

ccr::ResetCause cause_of(uint8_t byte) { return static_cast<ccr::ResetCause>(byte % 5); }

/// A frame with a good CRC and the right length, and at the fuzzer's choice the open session.
Bytes request(Script& script, uint16_t session) {
  constexpr size_t kRules = sizeof(ccr::kRequestRules) / sizeof(ccr::kRequestRules[0]);
  const uint8_t selector = script.byte();
  const ccr::RequestRule& rule = ccr::kRequestRules[selector % kRules];
  Bytes payload = script.bytes(rule.size);
  const bool wants_session = selector < 0xE0;
  if (wants_session && rule.needs_session) {
    ccr::put_u16(payload.data(), session);
  }
  if (wants_session && rule.id == ccr::OpenSession::kId) {
    ccr::put_u32(payload.data(), ccr::kSpecHash);
  }
  return framed(rule.id, script.byte(), payload);
}

/// A configuration with which the board can be armed, so that the fuzzer need not find one.
void configure(WatchedBoard& board) {
  const uint16_t session = board.session();
  ccr::SetCalibration calibration = {session, {}};
  ccr::SetLimits limits = {session, {}};
  ccr::SetSlew slew = {session, {}};
  for (uint8_t axis = 0; axis < ccr::kAxes; ++axis) {
    const bool is_odd = axis % 2 == 0;
    calibration.calibration.neutral_half_us[axis] = 3000;
    calibration.calibration.per_90_deg_half_us[axis] = is_odd ? 2000 : -2000;
    calibration.calibration.pulse_min_half_us[axis] = is_odd ? 1100 : 1200;
    calibration.calibration.pulse_max_half_us[axis] = is_odd ? 4900 : 4800;
    limits.limits.angle_min_cdeg[axis] = is_odd ? -9000 : -6000;
    limits.limits.angle_max_cdeg[axis] = is_odd ? 9000 : 6000;
    limits.limits.rest_cdeg[axis] = is_odd ? 0 : 500;
    slew.slew.slew_cdeg_tick[axis] = is_odd ? 700 : 300;
  }
  Bytes payload(ccr::SetCalibration::kSize);
  ccr::encode(calibration, payload.data());
  board.feed(framed(ccr::SetCalibration::kId, 1, payload));
  payload.assign(ccr::SetLimits::kSize, 0);
  ccr::encode(limits, payload.data());
  board.feed(framed(ccr::SetLimits::kId, 2, payload));
  payload.assign(ccr::SetSlew::kSize, 0);
  ccr::encode(slew, payload.data());
  board.feed(framed(ccr::SetSlew::kId, 3, payload));
  payload.assign(ccr::SetWatchdog::kSize, 0);
  ccr::encode(ccr::SetWatchdog{session, {60, 400, 40}}, payload.data());
  board.feed(framed(ccr::SetWatchdog::kId, 4, payload));
}

void run_step(Script& script, WatchedBoard& board) {
  const uint8_t step = script.byte();
  switch (step >> 5) {
    case 0:
    case 1:
      for (uint8_t tick = 0; tick <= (step & 0x1F); ++tick) {
        board.tick();
      }
      break;
    case 2:
      board.feed(script.bytes(step & 0x1F));
      break;
    case 3:
      board.feed(framed(script.byte(), script.byte(), script.bytes(step & 0x1F)));
      break;
    case 4:
    case 5:
      board.feed(request(script, board.session()));
      break;
    case 6:
      configure(board);
      break;
    default:
      if ((step & 0x10) != 0) {
        const uint16_t address = ccr::get_u16(script.bytes(2).data());
        board.hardware.eeprom[address % ccr::kEepromSize] = script.byte();
      } else if ((step & 0x08) != 0) {
        board.hardware.is_eeprom_busy = (step & 1) != 0;
        board.hardware.room = (step & 2) != 0 ? 255 : 0;
      } else if ((step & 0x04) != 0) {
        board.raise(static_cast<ccr::Fault>(1 + (step & 0x03)));
      } else {
        board.reset(cause_of(script.byte()));
      }
      break;
  }
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const uint8_t* data, size_t size) {
  Script script(data, size);
  WatchedBoard board(cause_of(script.byte()));
  while (!script.is_over()) {
    run_step(script, board);
    if (!board.broken().empty()) {
      std::fprintf(stderr, "broken: %s\n", board.broken().c_str());
      std::abort();
    }
  }
  return 0;
}
