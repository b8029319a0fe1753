"""Behaviour of the board in a control tick and on a request, without bytes and microseconds."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field, replace

from ccr_host.link.framing import Frame
from ccr_host.link.messages import (
    BLINK_STEP_TICKS,
    LED_STEP_TICKS,
    SAG_TICKS,
    TICK_US,
    ConfigGroups,
    CountersReply,
    EepromStatus,
    Event,
    Fault,
    FaultRecord,
    Limits,
    ResetCause,
    SetTarget,
    SetTargetAt,
    State,
    StateReport,
    StatusFlags,
)
from ccr_host.sim.board.eeprom import (
    ConfigGroup,
    ConfigStore,
    Configuration,
    EepromImage,
    FaultLog,
    SaveEnd,
)
from ccr_host.sim.board.safety import SafetyMachine
from ccr_host.sim.board.setpoint import Axes, Setpoint, clamped, is_saturated, pulse_half_us

_LINK_ERRORS = ("bad_crc", "bad_encoding", "bad_size", "overruns")
_U16 = 1 << 16
_U8 = 1 << 8


class TelemetryStream:
    """Periodic reports, one every `period_ticks`; none if that is 0."""

    def __init__(self, period_ticks: int = 0) -> None:
        self._period_ticks = period_ticks
        self._ticks_left = period_ticks
        self._next_sequence = 0

    def tick(self) -> int | None:
        """Sequence number of the report due at this tick; None if none is due."""
        if not self._period_ticks:
            return None
        self._ticks_left -= 1
        if self._ticks_left:
            return None
        self._ticks_left = self._period_ticks
        sequence = self._next_sequence
        self._next_sequence = (sequence + 1) % _U8
        return sequence


@dataclass(frozen=True, slots=True)
class Acknowledged:
    """The last `once` request that was acknowledged, and its answer."""

    request: Frame
    answer: bytes
    tick: int
    is_void: bool = False
    """A stop came after it: it is neither executed nor acknowledged again."""


@dataclass(frozen=True, slots=True)
class WaitingTarget:
    """A target that has yet to take effect."""

    request: SetTargetAt
    sequence: int


@dataclass(slots=True)
class Session:
    """One session; a new one has no acknowledged request, no waiting target and no telemetry."""

    number: int | None = None
    """None before the first session after a reset."""
    telemetry: TelemetryStream = field(default_factory=TelemetryStream)
    acknowledged: Acknowledged | None = None
    waiting_target: WaitingTarget | None = None


class Counters:
    """Counters named as in `counters_reply`; they wrap only when read."""

    def __init__(self) -> None:
        self._counts: Counter[str] = Counter()

    def count(self, name: str, number: int = 1) -> None:
        self._counts[name] += number

    @property
    def link_errors(self) -> int:
        """Sum of the receive errors, wrapping at 16 bits."""
        return sum(self._counts[name] for name in _LINK_ERRORS) % _U16

    def to_reply(self) -> CountersReply:
        """All counters, wrapped to their width on the wire."""
        return CountersReply(
            **{
                field.name: self._counts[field.name] % (field.maximum + 1)
                for field in CountersReply.FIELDS
            }
        )


_MS_PER_TICK = TICK_US // 1000
_NEVER_MS = 65535
_STACK_NOT_MEASURED = 65535
_U32 = 1 << 32

_ADC_REFERENCE_MV = 5000
_ADC_STEPS = 256
_ADC_FULL = 255
_LED_STEPS = 8
_LED_ON_IN_STEPS = {
    State.BOOT: range(8),
    State.DISARMED: (0,),
    State.ARMING: (0, 2, 4, 6),
    State.ACTIVE: range(8),
    State.HOLD: range(7),
    State.RELAXING: (0, 1, 4, 5),
    State.DISARMING: (0, 1, 4, 5),
    State.FAULT: (0, 2, 4),
    State.STOPPED: (0, 2),
}

_EVENT_COUNTERS = {Event.TARGET_EXPIRED: "holds", Event.HOLD_EXPIRED: "relaxes"}


def ticks_of_ms(duration_ms: int) -> int:
    """Duration in ticks, rounded up (TIM-3)."""
    return -(-duration_ms // _MS_PER_TICK)


@dataclass
class Inputs:
    """Levels at the board's inputs; may change at any time."""

    emergency_stop_open: bool = False
    supply_pin_mv: int = 3000
    """Output of the servo supply's divider."""


class BoardCore:
    """The board from one reset to the next.

    ``had_pulses`` is whether there were pulses when the reset came; ``tick_offset`` is added to the
    tick counter, to test wrapping.
    """

    def __init__(
        self,
        eeprom: EepromImage,
        reset_cause: ResetCause,
        had_pulses: bool,
        tick_offset: int,
        inputs: Inputs,
        axes: int,
    ) -> None:
        self.axes = axes
        self.reset_cause = reset_cause
        self.store = ConfigStore(eeprom, axes)
        self.fault_log = FaultLog(eeprom)
        self.boot_id = self.store.count_boot()
        self.eeprom_status = self.store.status
        self.configuration = self.store.configuration or Configuration.empty(axes)
        if self.eeprom_status is EepromStatus.BOTH_BAD:
            missing = self.configuration.missing | ConfigGroups.EQUIPMENT
            self.configuration = replace(self.configuration, missing=missing)
        self.unsaved = False
        self.safety = SafetyMachine(reset_cause, had_pulses, axes)
        self.session = Session()
        self.counters = Counters()
        self.next_tick = 0
        self.pulses_half_us: Axes = (0,) * axes
        self._tick_offset = tick_offset
        self._inputs = inputs
        self._setpoint = Setpoint(self.configuration.limits.rest_cdeg)
        self._reported_setpoint_cdeg = self._setpoint.cdeg
        self._moving = False
        self.servo_supply_on = False
        self.led_on = False
        self._supply_dv = 0
        self._state_before = State.BOOT
        self._logged_fault = Fault.NONE
        self._ticks_of_sag = 0
        self._blinking_until_tick = 0
        self._target_cdeg: Axes = (0,) * axes
        self._target_clamped = False
        self._target_sequence = 0
        self._target_tick: int | None = None

    @property
    def state(self) -> State:
        return self.safety.state

    @property
    def emergency_stop_open(self) -> bool:
        """Whether a fitted emergency stop is open."""
        return self.configuration.equipment.emergency_stop == 1 and self._inputs.emergency_stop_open

    @property
    def tick_number(self) -> int:
        """Number of the last tick, as in reports."""
        return (self._tick_offset + self.next_tick) % _U32

    def is_ahead(self, tick: int) -> bool:
        """Whether a tick, numbered as in reports, is still to come."""
        return 0 < (tick - self.tick_number) % _U32 < _U32 // 2

    def tick(self) -> None:
        """Run one control tick in the order of TIM-4; the caller sends reports."""
        self._take_waiting_target()
        tick = self.next_tick
        self.next_tick += 1
        config = self.configuration
        event = self.safety.tick(
            tick,
            at_rest=self._setpoint.cdeg == config.limits.rest_cdeg and not self._setpoint.is_moving,
            relax_after_ticks=ticks_of_ms(config.watchdog.relax_after_ms),
        )
        if event in _EVENT_COUNTERS:
            self.counters.count(_EVENT_COUNTERS[event])
        if self.state is not State.BOOT and self.emergency_stop_open:
            self.safety.raise_fault(Fault.EMERGENCY_STOP)
        self._watch_supply()
        self._move_setpoint(tick)
        self.pulses_half_us = self._compute_pulses(tick)
        self._advance_save()
        self._log_fault()
        self.servo_supply_on = self.safety.pulsing
        self.led_on = self._led(tick)

    def clear_fault(self) -> None:
        self.safety.clear()
        self._logged_fault = Fault.NONE

    def blink(self, duration_s: int) -> None:
        """Blink the LED for `duration_s` from the next tick on."""
        self._blinking_until_tick = self.next_tick + ticks_of_ms(duration_s * 1000)

    def arm(self) -> None:
        """Enable the axes one by one, from the next tick on."""
        self.safety.arm(self.next_tick, ticks_of_ms(self.configuration.watchdog.arm_axis_ms))

    def accept_target(
        self, target_cdeg: Axes, ramp_ms: int, validity_ms: int, sequence: int
    ) -> Axes:
        """Start to follow a target; return the target as clamped, 0.01 deg."""
        self.session.waiting_target = None
        limits = self.configuration.limits
        accepted = clamped(target_cdeg, limits.angle_min_cdeg, limits.angle_max_cdeg)
        calibration = self.configuration.calibration
        self._target_clamped = accepted != target_cdeg or any(
            is_saturated(calibration, axis, angle) for axis, angle in enumerate(accepted)
        )
        self._target_cdeg = accepted
        self._target_sequence = sequence
        self._target_tick = self.next_tick
        self._setpoint.aim_at(accepted, ticks_of_ms(ramp_ms))
        self.safety.accept_target(self.next_tick + ticks_of_ms(validity_ms))
        self.counters.count("targets_accepted")
        if self._target_clamped:
            self.counters.count("targets_clamped")
        return accepted

    def set_group(self, group: ConfigGroup) -> None:
        self.configuration = self.configuration.with_group(group)
        self.unsaved = True
        if isinstance(group, Limits):
            self._setpoint.clamp(group.angle_min_cdeg, group.angle_max_cdeg)

    def flags(self) -> StatusFlags:
        """Status flags; pulses and motion are those of the last tick, the rest is current."""
        flags = (
            (StatusFlags.AXIS_1_PULSES.value if self.pulses_half_us[0] else 0)
            | (StatusFlags.AXIS_2_PULSES.value if any(self.pulses_half_us[1:2]) else 0)
            | (StatusFlags.MOVING.value if self._moving else 0)
            | (StatusFlags.CLAMPED.value if self._target_clamped else 0)
            | (StatusFlags.EEPROM_BUSY.value if self.store.busy else 0)
            | (0 if self.configuration.missing else StatusFlags.CONFIGURED.value)
            | (0 if self.session.number is None else StatusFlags.SESSION_OPEN.value)
            | (StatusFlags.UNSAVED.value if self.unsaved else 0)
        )
        return StatusFlags(flags)

    def report(self) -> StateReport:
        """State report of the current tick."""
        return StateReport(
            tick=self.tick_number,
            state=self.safety.state,
            fault=self.safety.fault,
            flags=self.flags(),
            target_sequence=self._target_sequence,
            target_age_ms=self._target_age_ms(),
            target_cdeg=self._target_cdeg,
            setpoint_cdeg=self._reported_setpoint_cdeg,
            pulse_half_us=self.pulses_half_us,
            link_errors=self.counters.link_errors,
            free_stack_bytes=_STACK_NOT_MEASURED,
            supply_dv=self._supply_dv,
        )

    def _take_waiting_target(self) -> None:
        waiting = self.session.waiting_target
        if waiting is None:
            return
        target = waiting.request
        if self.state not in SetTarget.ALLOWED_STATES:
            self.session.waiting_target = None
        elif (target.tick - self.tick_number) % _U32 == 1:
            self.accept_target(
                target.target_cdeg, target.ramp_ms, target.validity_ms, waiting.sequence
            )

    def _watch_supply(self) -> None:
        equipment = self.configuration.equipment
        reading = min(self._inputs.supply_pin_mv * _ADC_STEPS // _ADC_REFERENCE_MV, _ADC_FULL)
        self._supply_dv = (2 * equipment.supply_full_dv * reading + _ADC_FULL) // (2 * _ADC_FULL)
        too_low = equipment.supply_full_dv > 0 and self._supply_dv < equipment.supply_min_dv
        self._ticks_of_sag = self._ticks_of_sag + 1 if too_low and self.safety.pulsing else 0
        if self._ticks_of_sag >= SAG_TICKS:
            self.safety.raise_fault(Fault.SUPPLY_LOW)

    def _move_setpoint(self, tick: int) -> None:
        config = self.configuration
        goal = self._setpoint.cdeg
        acceleration = config.acceleration.acceleration_cdeg_tick2
        if self.safety.state is State.ACTIVE:
            goal = self._target_cdeg
            self._setpoint.step_along_ramp(config.slew.slew_cdeg_tick, acceleration)
        elif self.safety.rest_wanted(tick):
            goal = config.limits.rest_cdeg
            relax = config.watchdog.relax_slew_cdeg_tick
            slew = tuple(min(relax, most) for most in config.slew.slew_cdeg_tick)
            self._setpoint.step_towards(goal, slew, acceleration)
        elif self.safety.pulsing:
            self._setpoint.brake(acceleration)
        else:
            self._setpoint.stand()
        self._moving = self._setpoint.cdeg != goal
        self._reported_setpoint_cdeg = self._setpoint.cdeg

    def _compute_pulses(self, tick: int) -> Axes:
        enabled = self.safety.axes_with_pulses(tick)
        calibration = self.configuration.calibration
        return tuple(
            pulse_half_us(calibration, axis, angle) if enabled[axis] else 0
            for axis, angle in enumerate(self._setpoint.cdeg)
        )

    def _log_fault(self) -> None:
        fault = self.safety.fault
        if fault is not self._logged_fault and not self.fault_log.is_writing:
            self._logged_fault = fault
            now = self.tick_number
            record = FaultRecord(0, fault, self._state_before, self.boot_id, now, check=0)
            self.fault_log.begin(record)
        if not self.store.busy:
            self.fault_log.advance()
        self._state_before = self.state

    def _led(self, tick: int) -> bool:
        shown_tick = self.tick_number
        if tick < self._blinking_until_tick:
            return shown_tick // BLINK_STEP_TICKS % 2 == 0
        return shown_tick // LED_STEP_TICKS % _LED_STEPS in _LED_ON_IN_STEPS[self.state]

    def _advance_save(self) -> None:
        match self.store.advance_save():
            case SaveEnd.FINISHED:
                self.unsaved = False
                self.counters.count("saves")
            case SaveEnd.FAILED:
                self.safety.raise_fault(Fault.EEPROM_FAILED)

    def _target_age_ms(self) -> int:
        if self._target_tick is None:
            return _NEVER_MS
        return min((self.next_tick - self._target_tick) * _MS_PER_TICK, _NEVER_MS)
