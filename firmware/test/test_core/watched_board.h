// A board that is checked for violations after every step. Independent of doctest, so that the
// fuzzer can use it too.
#pragma once

#include <board.h>

#include <cstdlib>
#include <memory>
#include <string>

#include "fake_hardware.h"

class WatchedBoard {
 public:
  explicit WatchedBoard(ccr::ResetCause cause) { reset(cause); }

  FakeHardware hardware;

  void reset(ccr::ResetCause cause) {
    hardware.sent.clear();
    const bool had_pulses = board_ != nullptr && board_->controller().has_pulses();
    board_.reset(new ccr::Board(hardware, {cause, had_pulses}));
    before_ = now();
    require(before_.state == ccr::State::kBoot, "a reset leads to boot");
  }

  void tick() {
    const ccr::Pulses pulses = board_->tick();
    board_->report();
    const ccr::StateReport after = now();
    require(after.tick == before_.tick + 1, "a tick is counted once");
    require(is_reachable(before_.state, after.state), "a transition of the table");
    for (uint8_t axis = 0; axis < ccr::kAxes; ++axis) {
      check_pulse(axis, pulses.half_us[axis], after.state);
      check_slew(axis, after);
    }
    check_frames(1);
    states_seen_ |= 1U << static_cast<unsigned>(after.state);
    before_ = after;
  }

  /// Processes bytes in which at most so many frames end.
  void feed(const Bytes& bytes) {
    size_t ends = 0;
    for (const uint8_t byte : bytes) {
      const ccr::State state = now().state;
      board_->on_byte(byte);
      require(is_reachable(state, now().state), "a transition of the table");
      ends += byte == 0 ? 1U : 0U;
    }
    check_frames(ends);
    before_.state = now().state;
  }

  void raise(ccr::Fault fault) {
    board_->raise_fault(fault);
    before_.state = now().state;
  }

  /// The first broken rule, or nothing.
  const std::string& broken() const { return broken_; }
  unsigned pulses_seen() const { return pulses_seen_; }
  /// Bits of the states reached by ticks.
  unsigned states_seen() const { return states_seen_; }
  uint16_t session() const { return session_; }
  ccr::State state() const { return now().state; }

 private:
  ccr::StateReport now() const {
    ccr::StateReport report = {};
    board_->controller().fill(report);
    return report;
  }

  void require(bool holds, const char* rule) {
    if (!holds && broken_.empty()) {
      broken_ = rule;
    }
  }

  static bool is_reachable(ccr::State from, ccr::State to) {
    bool is_listed = from == to;
    for (const ccr::Transition& transition : ccr::kTransitions) {
      is_listed |= transition.to == to && (transition.from & ccr::state_bit(from)) != 0;
    }
    // A save that fails in the tick of a transition raises another fault.
    return is_listed || to == ccr::State::kFault;
  }

  static bool has_pulses(ccr::State state) {
    return state == ccr::State::kArming || state == ccr::State::kActive ||
           state == ccr::State::kHold || state == ccr::State::kRelaxing ||
           state == ccr::State::kDisarming;
  }

  void check_pulse(uint8_t axis, uint16_t pulse, ccr::State state) {
    if (pulse == ccr::kNoPulse) {
      require(!(has_pulses(state) && axis == 0), "armed states have pulses");
      return;
    }
    ++pulses_seen_;
    const ccr::Configuration& configuration = board_->controller().configuration();
    require(has_pulses(state), "no pulses in a state without");
    require(configuration.is_complete(), "no pulses without a configuration");
    require(pulse >= ccr::kPulseFloorHalfUs && pulse <= ccr::kPulseCeilingHalfUs, "hard limits");
    require(pulse >= configuration.calibration.pulse_min_half_us[axis] &&
                pulse <= configuration.calibration.pulse_max_half_us[axis],
            "limits of the calibration");
  }

  void check_slew(uint8_t axis, const ccr::StateReport& after) {
    const ccr::Configuration& configuration = board_->controller().configuration();
    const bool was_and_is_driven =
        before_.pulse_half_us[axis] != ccr::kNoPulse && after.pulse_half_us[axis] != ccr::kNoPulse;
    const int moved = std::abs(after.setpoint_cdeg[axis] - before_.setpoint_cdeg[axis]);
    if (was_and_is_driven) {
      require(moved <= configuration.slew.slew_cdeg_tick[axis], "slew limit");
      require(after.setpoint_cdeg[axis] >= configuration.limits.angle_min_cdeg[axis] &&
                  after.setpoint_cdeg[axis] <= configuration.limits.angle_max_cdeg[axis],
              "angle limits");
    }
  }

  /// Checks that every byte sent belongs to a frame, and that there are no more than requested.
  void check_frames(size_t most) {
    ccr::FrameDecoder decoder;
    size_t frames = 0;
    for (const uint8_t byte : hardware.sent) {
      switch (decoder.feed(byte)) {
        case ccr::Received::kNothing:
          break;
        case ccr::Received::kFrame:
          ++frames;
          note(decoder);
          break;
        default:
          require(false, "only good frames are sent");
      }
    }
    require(hardware.sent.empty() || hardware.sent.back() == 0, "whole frames are sent");
    require(frames <= most, "one answer a request");
    hardware.sent.clear();
  }

  void note(const ccr::FrameDecoder& frame) {
    if (frame.id() == ccr::SessionReply::kId) {
      session_ = ccr::get_u16(frame.payload());
    }
  }

  std::unique_ptr<ccr::Board> board_;
  ccr::StateReport before_ = {};
  std::string broken_;
  unsigned pulses_seen_ = 0;
  unsigned states_seen_ = 0;
  uint16_t session_ = 0;
};
