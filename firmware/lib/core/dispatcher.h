// Processing of a request: the checks in their order (REQ-2), execution, and the answer.
#ifndef CCR_DISPATCHER_H
#define CCR_DISPATCHER_H

#include <stdint.h>

#include "ccr_messages.h"
#include "controller.h"
#include "frame.h"
#include "hardware.h"
#include "link_counters.h"
#include "session.h"

namespace ccr {

class Dispatcher {
 public:
  Dispatcher(Controller& controller, Hardware& hardware, ResetCause cause)
      : controller_(controller), hardware_(hardware), cause_(cause) {}

  /// Counts what was received, and answers it if it is a request.
  void receive(Received received, const FrameDecoder& frame);
  /// Sends telemetry if due, and advances what is counted in ticks.
  void end_tick();
  void count_overruns(uint16_t bytes) {
    counters_.overruns = static_cast<uint16_t>(counters_.overruns + bytes);
  }

 private:
  struct Refusal {
    NackCode code;
    uint8_t detail;
  };
  static constexpr NackCode kGranted = static_cast<NackCode>(0);
  static_assert(!is_nack_code(static_cast<uint8_t>(kGranted)), "not the code of a refusal");

  void dispatch(const FrameDecoder& frame);
  template <typename Request>
  void handle(const FrameDecoder& frame);
  template <typename Request>
  Refusal check(const FrameDecoder& frame, Request& request) const;

  /// Handles `set_target`, and `set_target_at`, which has its fields and a tick.
  void handle_target(const FrameDecoder& frame);
  Refusal check_target(const FrameDecoder& frame, SetTarget& request) const;

  /// Checks length, session and state.
  Refusal check_admission(const FrameDecoder& frame, uint8_t size, bool needs_session,
                          uint16_t allowed_states) const;

  /// Checks that are specific to a request; most have none.
  template <typename Request>
  Refusal check_particular(const Request&) const {
    return Refusal{kGranted, 0};
  }
  Refusal check_particular(const OpenSession& request) const;
  Refusal check_particular(const ClearFault&) const;
  Refusal check_particular(const GetFaultRecord&) const {
    return Refusal{hardware_.is_eeprom_ready() ? kGranted : NackCode::kBusy, 0};
  }
  Refusal check_particular(const Arm&) const { return check_configured(); }
  Refusal check_particular(const SaveConfig&) const { return check_configured(); }
  Refusal check_particular(const SetLimits&) const { return check_not_saving(); }
  Refusal check_particular(const SetSlew&) const { return check_not_saving(); }
  Refusal check_particular(const SetWatchdog&) const { return check_not_saving(); }
  Refusal check_particular(const SetCalibration&) const { return check_not_saving(); }
  Refusal check_particular(const SetEquipment&) const { return check_not_saving(); }
  Refusal check_particular(const SetAcceleration&) const { return check_not_saving(); }
  Refusal check_configured() const;
  Refusal check_not_saving() const;

  void execute(const FrameDecoder& frame, const Hello&);
  void execute(const FrameDecoder& frame, const OpenSession& request);
  void execute(const FrameDecoder& frame, const ClockSync& request);
  void execute(const FrameDecoder& frame, const GetState&);
  void execute(const FrameDecoder& frame, const GetCounters&);
  void execute(const FrameDecoder& frame, const SetTelemetry& request);
  void execute(const FrameDecoder& frame, const Blink& request);
  void execute(const FrameDecoder& frame, const GetFaultRecord& request);
  void execute(const FrameDecoder& frame, const GetLinkLimits&);
  void execute(const FrameDecoder& frame, const Arm&);
  void execute(const FrameDecoder& frame, const Disarm&);
  void execute(const FrameDecoder& frame, const Stop&);
  void execute(const FrameDecoder& frame, const ClearFault&);
  void execute(const FrameDecoder& frame, const SetTarget& request);
  void execute(const FrameDecoder& frame, const GetLimits&);
  void execute(const FrameDecoder& frame, const SetLimits& request);
  void execute(const FrameDecoder& frame, const GetSlew&);
  void execute(const FrameDecoder& frame, const SetSlew& request);
  void execute(const FrameDecoder& frame, const GetWatchdog&);
  void execute(const FrameDecoder& frame, const SetWatchdog& request);
  void execute(const FrameDecoder& frame, const GetCalibration&);
  void execute(const FrameDecoder& frame, const SetCalibration& request);
  void execute(const FrameDecoder& frame, const GetEquipment&);
  void execute(const FrameDecoder& frame, const SetEquipment& request);
  void execute(const FrameDecoder& frame, const GetAcceleration&);
  void execute(const FrameDecoder& frame, const SetAcceleration& request);
  void execute(const FrameDecoder& frame, const SaveConfig&);

  void refuse(const FrameDecoder& frame, Refusal refusal);
  /// Also remembers the request, so that it is not executed again.
  void acknowledge(const FrameDecoder& frame);
  void acknowledge_only(const FrameDecoder& frame);
  /// Builds a frame from the reply, or from the only struct in it, and sends it if there is room
  /// for it and, except for the answer to `stop`, for such an answer as well. On a saturated line most
  /// answers find no room, and then take no time.
  template <typename Reply, uint8_t kLeft = wire_size(Ack::kSize), typename Make>
  void send(uint8_t sequence, Make make);
  bool finds_room(uint8_t size);
  void send_frame(uint8_t id, uint8_t sequence, uint8_t payload_size, uint8_t* wire);
  uint8_t flags() const;
  StateReport state_report() const;

  Controller& controller_;
  Hardware& hardware_;
  ResetCause cause_;
  Session session_;
  LinkCounters counters_ = {};
};

}  // namespace ccr

#endif
