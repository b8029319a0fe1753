#include "dispatcher.h"

#include "axes.h"
#include "link_limits.h"
#include "little_endian.h"

namespace ccr {

constexpr uint8_t longer(uint8_t size, uint8_t other) { return size > other ? size : other; }
static_assert(kLinkLimits.outstanding_requests *
                          wire_size(longer(CountersReply::kSize, CalibrationReply::kSize)) +
                      2 * wire_size(Telemetry::kSize) + wire_size(Ack::kSize) <=
                  kSendBytes,
              "room for the longest answers to all outstanding requests, and two reports");

namespace {

/// Index of the field `tick` of `set_target_at`.
constexpr uint8_t kTickField = 4;

uint32_t tick_of_target(const FrameDecoder& frame) {
  return get_u32(frame.payload() + SetTarget::kSize);
}

}  // namespace

void Dispatcher::receive(Received received, const FrameDecoder& frame) {
  counters_.count(received);
  if (received != Received::kFrame) {
    return;
  }
  if (session_.retries.holds(frame)) {
    if (session_.retries.is_void()) {
      return refuse(frame, Refusal{NackCode::kBadState, static_cast<uint8_t>(controller_.state())});
    }
    ++counters_.repeats_answered;
    send<Ack>(frame.sequence(), [this] { return session_.retries.answer(); });
    return;
  }
  dispatch(frame);
}

void Dispatcher::end_tick() {
  session_.retries.count();
  if (session_.telemetry.is_due()) {
    send<Telemetry>(session_.telemetry.take_sequence(),
                    [this] { return state_report(); });
  }
}

void Dispatcher::dispatch(const FrameDecoder& frame) {
  switch (frame.id()) {
    case Hello::kId:
      return handle<Hello>(frame);
    case OpenSession::kId:
      return handle<OpenSession>(frame);
    case ClockSync::kId:
      return handle<ClockSync>(frame);
    case GetState::kId:
      return handle<GetState>(frame);
    case GetCounters::kId:
      return handle<GetCounters>(frame);
    case SetTelemetry::kId:
      return handle<SetTelemetry>(frame);
    case Blink::kId:
      return handle<Blink>(frame);
    case GetFaultRecord::kId:
      return handle<GetFaultRecord>(frame);
    case GetLinkLimits::kId:
      return kAnnouncesLinkLimits ? handle<GetLinkLimits>(frame)
                                  : refuse(frame, Refusal{NackCode::kUnknownId, 0});
    case Arm::kId:
      return handle<Arm>(frame);
    case Disarm::kId:
      return handle<Disarm>(frame);
    case Stop::kId:
      return handle<Stop>(frame);
    case ClearFault::kId:
      return handle<ClearFault>(frame);
    case SetTarget::kId:
    case SetTargetAt::kId:
      return handle_target(frame);
    case GetLimits::kId:
      return handle<GetLimits>(frame);
    case SetLimits::kId:
      return handle<SetLimits>(frame);
    case GetSlew::kId:
      return handle<GetSlew>(frame);
    case SetSlew::kId:
      return handle<SetSlew>(frame);
    case GetWatchdog::kId:
      return handle<GetWatchdog>(frame);
    case SetWatchdog::kId:
      return handle<SetWatchdog>(frame);
    case GetCalibration::kId:
      return handle<GetCalibration>(frame);
    case SetCalibration::kId:
      return handle<SetCalibration>(frame);
    case GetEquipment::kId:
      return handle<GetEquipment>(frame);
    case SetEquipment::kId:
      return handle<SetEquipment>(frame);
    case GetAcceleration::kId:
      return handle<GetAcceleration>(frame);
    case SetAcceleration::kId:
      return handle<SetAcceleration>(frame);
    case SaveConfig::kId:
      return handle<SaveConfig>(frame);
    default:
      return refuse(frame, Refusal{NackCode::kUnknownId, 0});
  }
}

template <typename Request>
void Dispatcher::handle(const FrameDecoder& frame) {
  Request request = {};
  const Refusal refusal = check(frame, request);
  if (refusal.code == kGranted) {
    execute(frame, request);
  } else {
    refuse(frame, refusal);
  }
}

template <typename Request>
Dispatcher::Refusal Dispatcher::check(const FrameDecoder& frame, Request& request) const {
  // Looked up at compile time: on an AVR a table that is read at run time is placed in RAM.
  constexpr RequestRule rule = *find_request(Request::kId);
  const Refusal refusal =
      check_admission(frame, rule.size, rule.needs_session, rule.allowed_states);
  if (refusal.code != kGranted) {
    return refusal;
  }
  if (decode(frame.payload(), frame.payload_size(), request) != Reading::kOk) {
    return Refusal{NackCode::kBadLength, 0};
  }
  const int8_t field = first_out_of_range(request);
  if (field != kNone) {
    return Refusal{NackCode::kOutOfRange, static_cast<uint8_t>(field)};
  }
  const int8_t axis = inconsistent_axis(request);
  if (axis != kNone) {
    return Refusal{NackCode::kInconsistent, static_cast<uint8_t>(axis)};
  }
  return check_particular(request);
}

// One text for both requests, which takes less flash than the general one for each.
void Dispatcher::handle_target(const FrameDecoder& frame) {
  SetTarget request;
  const Refusal refusal = check_target(frame, request);
  if (refusal.code != kGranted) {
    refuse(frame, refusal);
  } else if (frame.id() == SetTarget::kId) {
    execute(frame, request);
  } else {
    controller_.await_tick(tick_of_target(frame), request, frame.sequence());
    acknowledge_only(frame);
  }
}

Dispatcher::Refusal Dispatcher::check_target(const FrameDecoder& frame, SetTarget& request) const {
  constexpr RequestRule rule = *find_request(SetTarget::kId);
  constexpr RequestRule timed_rule = *find_request(SetTargetAt::kId);
  static_assert(rule.needs_session && timed_rule.needs_session &&
                    rule.allowed_states == timed_rule.allowed_states &&
                    timed_rule.size == rule.size + sizeof(uint32_t),
                "set_target_at is set_target with a tick");
  const bool is_timed = frame.id() == SetTargetAt::kId;
  const uint8_t size = is_timed ? timed_rule.size : rule.size;
  const Refusal refusal = check_admission(frame, size, true, rule.allowed_states);
  if (refusal.code != kGranted) {
    return refusal;
  }
  decode(frame.payload(), rule.size, request);
  const int8_t field = first_out_of_range(request);
  if (field != kNone) {
    return Refusal{NackCode::kOutOfRange, static_cast<uint8_t>(field)};
  }
  const bool is_late = is_timed && !controller_.is_ahead(tick_of_target(frame));
  return is_late ? Refusal{NackCode::kOutOfRange, kTickField} : Refusal{kGranted, 0};
}

Dispatcher::Refusal Dispatcher::check_admission(const FrameDecoder& frame, uint8_t size,
                                                bool needs_session,
                                                uint16_t allowed_states) const {
  if (frame.payload_size() != size) {
    return Refusal{NackCode::kBadLength, 0};
  }
  // Requests that need a session start with its number.
  if (needs_session && (!session_.is_open() || get_u16(frame.payload()) != session_.number)) {
    return Refusal{NackCode::kBadSession, 0};
  }
  if ((allowed_states & state_bit(controller_.state())) == 0) {
    return Refusal{NackCode::kBadState, static_cast<uint8_t>(controller_.state())};
  }
  return Refusal{kGranted, 0};
}

Dispatcher::Refusal Dispatcher::check_particular(const OpenSession& request) const {
  return Refusal{request.spec_hash == kSpecHash ? kGranted : NackCode::kSpecMismatch, 0};
}

Dispatcher::Refusal Dispatcher::check_particular(const ClearFault&) const {
  const NackCode code = controller_.has_pulses()               ? NackCode::kBusy
                        : controller_.is_emergency_stop_open() ? NackCode::kEmergencyStopOpen
                                                               : kGranted;
  return Refusal{code, 0};
}

Dispatcher::Refusal Dispatcher::check_configured() const {
  const uint8_t missing = controller_.configuration().missing_groups;
  return missing != 0 ? Refusal{NackCode::kNotConfigured, missing} : check_not_saving();
}

Dispatcher::Refusal Dispatcher::check_not_saving() const {
  return Refusal{controller_.is_saving() ? NackCode::kBusy : kGranted, 0};
}

void Dispatcher::execute(const FrameDecoder& frame, const Hello&) {
  send<HelloReply>(frame.sequence(), [this] {
    HelloReply reply;
    reply.protocol_version = kProtocolVersion;
    reply.spec_hash = kSpecHash;
    for (uint8_t part = 0; part < sizeof(kFirmwareVersion); ++part) {
      reply.firmware_version[part] = kFirmwareVersion[part];
    }
    reply.boot_id = controller_.boot_id();
    reply.reset_cause = cause_;
    reply.eeprom_status = controller_.eeprom_status();
    reply.capabilities = static_cast<uint16_t>(
        hardware_.capabilities() | capabilities::kTimedTargets |
        (kAnnouncesLinkLimits ? capabilities::kLinkLimits : 0));
    reply.axes = kAxes;
    reply.max_payload = kMaxPayload;
    reply.tick_us = kTickUs;
    return reply;
  });
}

void Dispatcher::execute(const FrameDecoder& frame, const OpenSession& request) {
  session_.open(request.session);
  controller_.discard_waiting_target();
  send<SessionReply>(frame.sequence(), [&] {
    return SessionReply{request.session, controller_.boot_id(), controller_.state()};
  });
}

void Dispatcher::execute(const FrameDecoder& frame, const ClockSync& request) {
  send<ClockReply>(frame.sequence(),
                   [&] { return ClockReply{request.host_time_us, hardware_.time_us()}; });
}

void Dispatcher::execute(const FrameDecoder& frame, const GetState&) {
  send<StateReply>(frame.sequence(), [this] { return state_report(); });
}

void Dispatcher::execute(const FrameDecoder& frame, const GetCounters&) {
  send<CountersReply>(frame.sequence(), [this] {
    const Controller::Counts& counts = controller_.counts();
    CountersReply reply;
    reply.frames_accepted = counters_.frames_accepted;
    reply.bad_crc = counters_.bad_crc;
    reply.bad_encoding = counters_.bad_encoding;
    reply.bad_size = counters_.bad_size;
    reply.overruns = counters_.overruns;
    reply.replies_dropped = counters_.replies_dropped;
    reply.nacks = counters_.nacks;
    reply.repeats_answered = counters_.repeats_answered;
    reply.targets_accepted = counts.targets_accepted;
    reply.targets_clamped = counts.targets_clamped;
    reply.holds = counts.holds;
    reply.relaxes = counts.relaxes;
    reply.saves = counts.saves;
    return reply;
  });
}

void Dispatcher::execute(const FrameDecoder& frame, const SetTelemetry& request) {
  session_.telemetry.start(request.period_ticks);
  acknowledge(frame);
}

void Dispatcher::execute(const FrameDecoder& frame, const Blink& request) {
  controller_.blink(request.duration_s);
  acknowledge_only(frame);
}

void Dispatcher::execute(const FrameDecoder& frame, const GetFaultRecord& request) {
  send<FaultRecordReply>(frame.sequence(),
       [&] { return controller_.fault_record(request.place); });
}

void Dispatcher::execute(const FrameDecoder& frame, const GetLinkLimits&) {
  send<LinkLimitsReply>(frame.sequence(), [] { return kLinkLimits; });
}

void Dispatcher::execute(const FrameDecoder& frame, const Arm&) {
  controller_.arm();
  acknowledge(frame);
}

void Dispatcher::execute(const FrameDecoder& frame, const Disarm&) {
  controller_.disarm();
  acknowledge(frame);
}

void Dispatcher::execute(const FrameDecoder& frame, const Stop&) {
  controller_.stop();
  session_.retries.make_void();
  send<Ack, 0>(frame.sequence(), [this] { return Ack{Stop::kId, controller_.state()}; });
}

void Dispatcher::execute(const FrameDecoder& frame, const ClearFault&) {
  controller_.clear_fault();
  acknowledge(frame);
}

void Dispatcher::execute(const FrameDecoder& frame, const SetTarget& request) {
  controller_.accept_target(request, frame.sequence());
  send<TargetReply>(frame.sequence(), [this] {
    TargetReply reply;
    reply.state = controller_.state();
    reply.flags = flags();
    for (uint8_t axis = 0; axis < kAxes; ++axis) {
      reply.target_cdeg[axis] = controller_.target_cdeg(axis);
    }
    return reply;
  });
}

void Dispatcher::execute(const FrameDecoder& frame, const GetLimits&) {
  send<LimitsReply>(frame.sequence(),
       [this]() -> const Limits& { return controller_.configuration().limits; });
}

void Dispatcher::execute(const FrameDecoder& frame, const SetLimits& request) {
  controller_.set(request.limits);
  acknowledge(frame);
}

void Dispatcher::execute(const FrameDecoder& frame, const GetSlew&) {
  send<SlewReply>(frame.sequence(),
       [this]() -> const Slew& { return controller_.configuration().slew; });
}

void Dispatcher::execute(const FrameDecoder& frame, const SetSlew& request) {
  controller_.set(request.slew);
  acknowledge(frame);
}

void Dispatcher::execute(const FrameDecoder& frame, const GetWatchdog&) {
  send<WatchdogReply>(frame.sequence(),
       [this]() -> const Watchdog& { return controller_.configuration().watchdog; });
}

void Dispatcher::execute(const FrameDecoder& frame, const SetWatchdog& request) {
  controller_.set(request.watchdog);
  acknowledge(frame);
}

void Dispatcher::execute(const FrameDecoder& frame, const GetCalibration&) {
  send<CalibrationReply>(frame.sequence(),
       [this]() -> const Calibration& { return controller_.configuration().calibration; });
}

void Dispatcher::execute(const FrameDecoder& frame, const SetCalibration& request) {
  controller_.set(request.calibration);
  acknowledge(frame);
}

void Dispatcher::execute(const FrameDecoder& frame, const GetEquipment&) {
  send<EquipmentReply>(frame.sequence(),
       [this]() -> const Equipment& { return controller_.configuration().equipment; });
}

void Dispatcher::execute(const FrameDecoder& frame, const SetEquipment& request) {
  controller_.set(request.equipment);
  acknowledge(frame);
}

void Dispatcher::execute(const FrameDecoder& frame, const GetAcceleration&) {
  send<AccelerationReply>(frame.sequence(), [this]() -> const Acceleration& {
    return controller_.configuration().acceleration;
  });
}

void Dispatcher::execute(const FrameDecoder& frame, const SetAcceleration& request) {
  controller_.set(request.acceleration);
  acknowledge(frame);
}

void Dispatcher::execute(const FrameDecoder& frame, const SaveConfig&) {
  controller_.begin_save();
  acknowledge(frame);
}

void Dispatcher::refuse(const FrameDecoder& frame, Refusal refusal) {
  ++counters_.nacks;
  send<Nack>(frame.sequence(), [&] { return Nack{frame.id(), refusal.code, refusal.detail}; });
}

void Dispatcher::acknowledge(const FrameDecoder& frame) {
  session_.retries.remember(frame, controller_.state());
  send<Ack>(frame.sequence(), [this] { return session_.retries.answer(); });
}

void Dispatcher::acknowledge_only(const FrameDecoder& frame) {
  send<Ack>(frame.sequence(), [&] { return Ack{frame.id(), controller_.state()}; });
}

template <typename Reply, uint8_t kLeft, typename Make>
void Dispatcher::send(uint8_t sequence, Make make) {
  if (!finds_room(wire_size(Reply::kSize) + kLeft)) {
    return;
  }
  uint8_t wire[wire_size(Reply::kSize)];
  encode(make(), wire + kPayloadAt);
  send_frame(Reply::kId, sequence, Reply::kSize, wire);
}

bool Dispatcher::finds_room(uint8_t size) {
  const bool has_room = hardware_.has_room(size);
  if (!has_room) {
    ++counters_.replies_dropped;
  }
  return has_room;
}

void Dispatcher::send_frame(uint8_t id, uint8_t sequence, uint8_t payload_size, uint8_t* wire) {
  hardware_.send(wire, close_frame(id, sequence, payload_size, wire));
}

uint8_t Dispatcher::flags() const {
  const uint8_t session_flag = session_.is_open() ? status_flags::kSessionOpen : uint8_t{0};
  return static_cast<uint8_t>(controller_.flags() | session_flag);
}

StateReport Dispatcher::state_report() const {
  StateReport report;
  controller_.fill(report);
  report.flags = flags();
  report.link_errors = counters_.link_errors();
  report.free_stack_bytes = hardware_.least_free_stack();
  return report;
}

}  // namespace ccr
