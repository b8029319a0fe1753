"""What must never be seen on the servo pins, judged from the talk with the board alone.

The oracle believes what the host has sent and what the board has acknowledged, not what the board
says of its state: that, too, is held against the pins. Each rule has a name, so that a mutant can
be told to break it.
"""

from __future__ import annotations

from dataclasses import dataclass, field

from ccr_host.link import messages as m
from ccr_host.link.framing import Frame

Pins = tuple[int, ...]
"""Pulses of each axis in a frame, in 0.5 us; 0 is no pulse."""
_NEVER = 1 << 60
_LATE_FRAMES = 3
"""Time from the tick that ends the pulses to the first frame without them, including rounding."""


class ViolationError(AssertionError):
    """A rule was broken."""

    def __init__(self, rule: str, detail: object) -> None:
        super().__init__(f"{rule}: {detail}")
        self.rule = rule


def require(holds: bool, rule: str, detail: object = "") -> None:
    """Raises ViolationError if a rule does not hold."""
    if not holds:
        raise ViolationError(rule, detail)


def ticks(duration_ms: int) -> int:
    """Ticks that a duration takes (TIM-3)."""
    return -(-duration_ms * 1000 // m.TICK_US)


@dataclass
class PinOracle:
    """State from one reset to the next; frame 0 starts with the reset."""

    axes: int
    limits: m.Limits | None = None
    slew: m.Slew | None = None
    watchdog: m.Watchdog | None = None
    calibration: m.Calibration | None = None
    session: int | None = None
    pins: Pins = field(init=False)
    armed_frame: int = _NEVER
    """Frame of the last `arm`; never while stopped."""
    stopped: bool = False
    fed_frame: int = _NEVER
    validity: int = 0
    """Ticks; 0 before the first target since `arm`."""
    slow_frame: int = _NEVER
    """`disarm` was asked for in it."""
    dead_frame: int = 0
    """Frame from which there must be no pulses."""
    remembered: tuple[Frame, Frame, int] | None = None
    """The last `once` request that was acknowledged, its answer, and when."""

    def __post_init__(self) -> None:
        self.pins = (0,) * self.axes

    # What is said

    def take(self, frame_number: int, sent: Frame, answer: Frame) -> None:
        """A request, sent in a frame, and its answer."""
        require(answer.sequence == sent.sequence, "answered in order", (sent, answer))
        if self.remembered is not None and sent == self.remembered[0]:
            _, first_answer, then = self.remembered
            if frame_number - then <= m.RETRY_WINDOW_TICKS:
                require(answer == first_answer, "not executed again", sent)
                return
        reply = m.MESSAGES[answer.id].unpack(answer.payload)
        if isinstance(reply, m.Nack):
            return
        request = m.REQUESTS[sent.id].unpack(sent.payload)
        self._judge_admission(request)
        if request.RETRY == "once":
            self.remembered = (sent, answer, frame_number)
        self._note(frame_number, request, reply)

    def _judge_admission(self, request: m.Request) -> None:
        require(request.first_out_of_range() is None, "values in range", request)
        if request.NEEDS_SESSION:
            session = getattr(request, "session", None)
            require(session == self.session, "only the open session", request)
        if isinstance(request, m.Arm | m.SetTarget):
            require(not self.stopped, "a stop is latched", request)
        if isinstance(request, m.ClearFault):
            require(not any(self.pins), "cleared after a frame without pulses", self.pins)

    def _note(self, now: int, request: m.Request, reply: m.Message) -> None:
        match request:
            case m.OpenSession():
                self.session, self.remembered = request.session, None
            case m.SetLimits():
                self.limits = request.limits
            case m.SetSlew():
                self.slew = request.slew
            case m.SetWatchdog():
                self.watchdog = request.watchdog
            case m.SetCalibration():
                self.calibration = request.calibration
            case m.GetState():
                assert isinstance(reply, m.StateReply)
                told = reply.report.pulse_half_us
                require(told == self.pins, "the report tells the pins", (told, self.pins))
            case m.Stop():
                self.stopped, self.armed_frame, self.dead_frame = True, _NEVER, now + 1
                self.remembered = None
            case m.ClearFault():
                self.stopped, self.armed_frame = False, _NEVER
            case m.Arm():
                self.armed_frame, self.validity, self.slow_frame = now, 0, _NEVER
                self._feed(now, self.axes * self._axis_ticks() + self._way_ticks())
            case m.SetTarget():
                self.validity = ticks(request.validity_ms)
                self._feed(now, self.validity)
            case m.Disarm() if self.armed_frame != _NEVER:
                self.slow_frame = now
                self.dead_frame = min(self.dead_frame, now + self._way_ticks() + _LATE_FRAMES)

    def _feed(self, now: int, lasting: int) -> None:
        assert self.watchdog is not None
        self.fed_frame = now
        hold = ticks(self.watchdog.relax_after_ms)
        self.dead_frame = now + lasting + hold + self._way_ticks() + _LATE_FRAMES

    def _axis_ticks(self) -> int:
        assert self.watchdog is not None
        return ticks(self.watchdog.arm_axis_ms)

    def _way_ticks(self) -> int:
        assert self.limits is not None
        spans = zip(self.limits.angle_min_cdeg, self.limits.angle_max_cdeg, strict=True)
        return max(
            -(-(most - least) // self._relax_slew(axis)) for axis, (least, most) in enumerate(spans)
        )

    def _relax_slew(self, axis: int) -> int:
        assert self.watchdog is not None
        assert self.slew is not None
        return min(self.watchdog.relax_slew_cdeg_tick, self.slew.slew_cdeg_tick[axis])

    # What is seen

    def look(self, frame: int, pins: Pins) -> None:
        """Pulses in a frame, after all that was said in the frames before."""
        is_armed_now = self.armed_frame == frame - 1 != self.slow_frame
        require(not is_armed_now or pins[0] > 0, "arming gives pulses", frame)
        for axis, pulse in enumerate(pins):
            if pulse:
                self._judge_presence(frame, axis)
                self._judge_width(axis, pulse)
                if self.pins[axis]:
                    self._judge_step(frame, axis, pulse)
        self.pins = pins

    def _judge_presence(self, frame: int, axis: int) -> None:
        require(not self.stopped, "no pulses after a stop", frame)
        require(self.armed_frame < frame, "no pulses before arming", frame)
        rule = "disarming ends" if self.slow_frame < frame else "a silent host ends the pulses"
        require(frame < self.dead_frame, rule, (frame, self.dead_frame))
        first_frame = self.armed_frame + 1 + axis * self._axis_ticks()
        require(frame >= first_frame, "one servo after the other", frame)

    def _judge_width(self, axis: int, pulse: int) -> None:
        calibration, limits = self.calibration, self.limits
        assert calibration is not None
        assert limits is not None
        least = max(calibration.pulse_min_half_us[axis], m.PULSE_FLOOR_HALF_US)
        most = min(calibration.pulse_max_half_us[axis], m.PULSE_CEILING_HALF_US)
        require(least <= pulse <= most, "calibrated pulses", (axis, pulse))
        ends = sorted(
            calibration.neutral_half_us[axis] + angle * calibration.per_90_deg_half_us[axis] / 9000
            for angle in (limits.angle_min_cdeg[axis], limits.angle_max_cdeg[axis])
        )
        inside = max(ends[0], least) - 1 <= max(pulse, least)
        inside = inside and min(pulse, most) <= min(ends[1], most) + 1
        require(inside or most <= ends[0] or ends[1] <= least, "angle limits", (axis, pulse, ends))

    def _judge_step(self, frame: int, axis: int, pulse: int) -> None:
        assert self.calibration is not None
        assert self.slew is not None
        assert self.watchdog is not None
        step = abs(pulse - self.pins[axis])
        per_cdeg = abs(self.calibration.per_90_deg_half_us[axis]) / 9000
        slew = self.slew.slew_cdeg_tick[axis]
        require(step <= slew * per_cdeg + 1, "slew limit", (axis, self.pins[axis], pulse))
        expired = self.fed_frame + self.validity
        relaxes = expired + ticks(self.watchdog.relax_after_ms)
        if self.slow_frame < frame or not self.validity or frame > relaxes:
            slow = self._relax_slew(axis) * per_cdeg + 1
            require(step <= slow, "slow way to rest", (axis, self.pins[axis], pulse))
        elif frame > expired:
            require(step == 0, "hold stands still", (axis, self.pins[axis], pulse))
