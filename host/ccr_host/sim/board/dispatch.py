"""Processing of a request: the checks in their order, execution, and the answer."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import singledispatchmethod
from typing import Any

from ccr_host.link import messages as m
from ccr_host.link.framing import Frame, encode_frame
from ccr_host.sim.board.core import (
    Acknowledged,
    BoardCore,
    Session,
    TelemetryStream,
    WaitingTarget,
)

CAPABILITIES = m.Capabilities.EEPROM | m.Capabilities.HARDWARE_PULSES | m.Capabilities.TIMED_TARGETS

_TICK_FIELD = 4
"""Index of the field `tick` of `set_target_at`."""
_GetGroup = (
    m.GetLimits | m.GetSlew | m.GetWatchdog | m.GetCalibration | m.GetEquipment | m.GetAcceleration
)
_SetGroup = (
    m.SetLimits | m.SetSlew | m.SetWatchdog | m.SetCalibration | m.SetEquipment | m.SetAcceleration
)
_NeedsConfiguration = m.Arm | m.SaveConfig


class Refusal(Exception):  # noqa: N818 - an answer, not an error
    """The reason for which a request is answered with `nack`."""

    def __init__(self, code: m.NackCode, detail: int = 0) -> None:
        super().__init__(code.name)
        self.code = code
        self.detail = detail


class Dispatcher:
    """Answers requests on behalf of a board.

    The board claims to be built from the spec with ``spec_hash``; without ``link_limits`` it has
    those of the spec.
    """

    def __init__(
        self,
        core: BoardCore,
        board_time_us: Callable[[], int],
        spec_hash: int,
        link_limits: m.LinkLimitsReply | None,
    ) -> None:
        self._core = core
        self._board_time_us = board_time_us
        self._spec_hash = spec_hash
        self._link_limits = link_limits
        announced = m.Capabilities.LINK_LIMITS if link_limits else 0
        self._capabilities = CAPABILITIES | announced
        self._sequence = 0

    def answer(self, frame: Frame) -> bytes:
        """Encoded answer to `frame`."""
        remembered = self._remembered(frame)
        if remembered is not None and not remembered.is_void:
            self._core.counters.count("repeats_answered")
            return remembered.answer
        self._sequence = frame.sequence
        try:
            if remembered is not None:
                raise Refusal(m.NackCode.BAD_STATE, self._core.state)
            request = self._parse(frame)
            self._check(request)
            reply = self._execute(request) or m.Ack(request.ID, self._core.state)
        except Refusal as refusal:
            self._core.counters.count("nacks")
            return _encode(m.Nack(frame.id, refusal.code, refusal.detail), frame.sequence)
        answer = _encode(reply, frame.sequence)
        if request.RETRY == "once":
            self._core.session.acknowledged = Acknowledged(frame, answer, self._core.next_tick)
        return answer

    def _remembered(self, frame: Frame) -> Acknowledged | None:
        last = self._core.session.acknowledged
        if last is None or last.request != frame:
            return None
        age_ticks = self._core.next_tick - last.tick
        return last if age_ticks <= m.RETRY_WINDOW_TICKS else None

    def _parse(self, frame: Frame) -> m.Request:
        kind = m.REQUESTS.get(frame.id)
        if kind is None or kind.CAPABILITY & ~self._capabilities:
            raise Refusal(m.NackCode.UNKNOWN_ID)
        if len(frame.payload) != kind.size(self._core.axes):
            raise Refusal(m.NackCode.BAD_LENGTH)
        return kind.unpack(frame.payload, self._core.axes)

    def _check(self, request: m.Request) -> None:
        core = self._core
        if request.NEEDS_SESSION and getattr(request, "session") != core.session.number:  # noqa: B009 - not all have one
            raise Refusal(m.NackCode.BAD_SESSION)
        if core.state not in request.ALLOWED_STATES:
            raise Refusal(m.NackCode.BAD_STATE, core.state)
        out_of_range = request.first_out_of_range()
        if out_of_range is not None:
            raise Refusal(m.NackCode.OUT_OF_RANGE, out_of_range)
        axis = request.inconsistent_axis()
        if axis is not None:
            raise Refusal(m.NackCode.INCONSISTENT, axis)
        if isinstance(request, m.SetTargetAt) and not core.is_ahead(request.tick):
            raise Refusal(m.NackCode.OUT_OF_RANGE, _TICK_FIELD)
        if isinstance(request, m.OpenSession) and request.spec_hash != self._spec_hash:
            raise Refusal(m.NackCode.SPEC_MISMATCH)
        if isinstance(request, _NeedsConfiguration) and core.configuration.missing:
            raise Refusal(m.NackCode.NOT_CONFIGURED, core.configuration.missing)
        if core.store.busy and isinstance(request, _NeedsConfiguration | _SetGroup):
            raise Refusal(m.NackCode.BUSY)
        if isinstance(request, m.ClearFault) and any(core.pulses_half_us):
            raise Refusal(m.NackCode.BUSY)
        if isinstance(request, m.ClearFault) and core.emergency_stop_open:
            raise Refusal(m.NackCode.EMERGENCY_STOP_OPEN)

    @singledispatchmethod
    def _execute(self, request: m.Request) -> m.Message | None:
        """Carry out a request; None if it is to be acknowledged."""
        raise NotImplementedError(request.NAME)

    @_execute.register
    def _(self, request: m.Hello) -> m.Message:
        return m.HelloReply(
            protocol_version=m.PROTOCOL_VERSION,
            spec_hash=self._spec_hash,
            firmware_version=m.FIRMWARE_VERSION,
            boot_id=self._core.boot_id,
            reset_cause=self._core.reset_cause,
            eeprom_status=self._core.eeprom_status,
            capabilities=self._capabilities,
            axes=self._core.axes,
            max_payload=m.MAX_PAYLOAD.of(self._core.axes),
            tick_us=m.TICK_US,
        )

    @_execute.register
    def _(self, request: m.OpenSession) -> m.Message:
        self._core.session = Session(request.session)
        return m.SessionReply(request.session, self._core.boot_id, self._core.state)

    @_execute.register
    def _(self, request: m.ClockSync) -> m.Message:
        return m.ClockReply(request.host_time_us, self._board_time_us())

    @_execute.register
    def _(self, request: m.GetState) -> m.Message:
        return m.StateReply(self._core.report())

    @_execute.register
    def _(self, request: m.GetCounters) -> m.Message:
        return self._core.counters.to_reply()

    @_execute.register
    def _(self, request: m.SetTelemetry) -> None:
        self._core.session.telemetry = TelemetryStream(request.period_ticks)

    @_execute.register
    def _(self, request: m.Blink) -> None:
        self._core.blink(request.duration_s)

    @_execute.register
    def _(self, request: m.GetFaultRecord) -> m.Message:
        return m.FaultRecordReply(self._core.fault_log.at(request.place))

    @_execute.register
    def _(self, request: m.GetLinkLimits) -> m.Message:
        assert self._link_limits is not None, "the request is refused without them"
        return self._link_limits

    @_execute.register
    def _(self, request: m.Arm) -> None:
        self._core.arm()

    @_execute.register
    def _(self, request: m.Disarm) -> None:
        self._core.safety.disarm()

    @_execute.register
    def _(self, request: m.Stop) -> None:
        self._core.safety.stop()
        last = self._core.session.acknowledged
        if last is not None:
            self._core.session.acknowledged = replace(last, is_void=True)

    @_execute.register
    def _(self, request: m.ClearFault) -> None:
        self._core.clear_fault()

    @_execute.register
    def _(self, request: m.SetTarget) -> m.Message:
        accepted = self._core.accept_target(
            request.target_cdeg, request.ramp_ms, request.validity_ms, self._sequence
        )
        return m.TargetReply(self._core.state, self._core.flags(), accepted)

    @_execute.register
    def _(self, request: m.SetTargetAt) -> None:
        self._core.session.waiting_target = WaitingTarget(request, self._sequence)

    @_execute.register
    def _(self, request: _GetGroup) -> m.Message:
        kind: Any = m.MESSAGES[request.REPLY_ID]
        reply: m.Message = kind(getattr(self._core.configuration, _group_of(kind)))
        return reply

    @_execute.register
    def _(self, request: _SetGroup) -> None:
        self._core.set_group(getattr(request, _group_of(type(request))))

    @_execute.register
    def _(self, request: m.SaveConfig) -> None:
        self._core.store.begin_save(self._core.configuration)


def _encode(reply: m.Message, sequence: int) -> bytes:
    return encode_frame(reply.ID, sequence, reply.pack())


def _group_of(kind: type[m.Message]) -> str:
    """Name of the configuration group that a message carries."""
    assert kind.NESTED is not None
    return kind.NESTED[0]
