"""What the UNO's own part of the firmware has to do when things go wrong, on the simulated board.

Hangs are made by patching the flash while the program runs: a function gets a jump to itself, and
its first instruction back when the hang is to end.
"""

from collections.abc import Iterator
from contextlib import contextmanager
from itertools import pairwise

import pytest

from ccr_host.link import messages as m
from ccr_host.link.framing import Frame, FrameDecoder, encode_frame
from ccr_host.sim.simavr.board import Edge, SimavrBoard
from ccr_host.sim.simavr.flash_image import read_flash_image
from ccr_host.sim.simavr.mcu import CLOCK_HZ, CYCLES_PER_US
from ccr_host.sim.simavr.serve import optiboot
from tests.conformance.firmware_build import firmware_elf

RETURN_FROM_INTERRUPT = b"\x18\x95"
MILLISECOND_VECTOR = 7 * 4
HANG = b"\xff\xcf"
HANG_WITHOUT_INTERRUPTS = b"\xf8\x94\xff\xcf"
JUMP_TO_THE_START = b"\x0c\x94\x00\x00"
SESSION = 0x1234
LIMITS = m.Limits((-9000, -9000), (9000, 9000), (0, 0))
SLEW = m.Slew((500, 500))
WATCHDOG = m.Watchdog(60000, 500, 20)
CALIBRATION = m.Calibration((3000, 3000), (2000, 2000), (1000, 1000), (5000, 5000))
BOOT_OVER_US = 121_000
ANSWER_US = 3_000
WATCHDOG_LATEST_US = 150_000
BOOT_LOADER_US = 1_700_000


class Uno:
    """The simulated board with the firmware, and a minimal host."""

    def __init__(self, *flags: str, baud: int = m.BAUD, **options: object) -> None:
        image = read_flash_image(firmware_elf(*flags))
        self._baud = baud
        self.board = SimavrBoard(image, **options)  # type: ignore[arg-type]
        self._sequence = 0

    def wait(self, time_us: int) -> None:
        self.board.advance_to(self.board.now_us + time_us)

    def ask(self, request: m.Request) -> m.Message:
        self._sequence = (self._sequence + 1) % 256
        self.board.take_output()
        frame = encode_frame(request.ID, self._sequence, request.pack())
        self.board.receive(frame, self._baud)
        self.wait(ANSWER_US)
        (answer,) = (f for f in FrameDecoder().feed(self.board.take_output()))
        assert isinstance(answer, Frame)
        return m.MESSAGES[answer.id].unpack(answer.payload)

    def ask_quietly(self, request: m.Request) -> None:
        """Reports may come between."""
        self._sequence = (self._sequence + 1) % 256
        self.board.receive(encode_frame(request.ID, self._sequence, request.pack()))
        self.wait(ANSWER_US)

    def hello(self) -> m.HelloReply:
        reply = self.ask(m.Hello(m.PROTOCOL_VERSION, m.SPEC_HASH))
        assert isinstance(reply, m.HelloReply)
        return reply

    def report(self) -> m.StateReport:
        reply = self.ask(m.GetState())
        assert isinstance(reply, m.StateReply)
        return reply.report

    def make_ready(self) -> None:
        self.wait(BOOT_OVER_US)
        self.ask(m.OpenSession(m.SPEC_HASH, SESSION))
        self.ask(m.SetLimits(SESSION, LIMITS))
        self.ask(m.SetSlew(SESSION, SLEW))
        self.ask(m.SetWatchdog(SESSION, WATCHDOG))
        self.ask(m.SetCalibration(SESSION, CALIBRATION))
        assert self.report().state is m.State.DISARMED

    def make_armed(self) -> None:
        self.make_ready()
        self.ask(m.Arm(SESSION))
        self.wait(100_000)
        assert self.report().state is m.State.HOLD

    @contextmanager
    def hanging_in(self, function: str, code: bytes = HANG) -> Iterator[None]:
        """The program goes astray as soon as it calls a function."""
        with self._patched(self.board.symbol(function), code):
            yield

    @contextmanager
    def losing_milliseconds(self) -> Iterator[None]:
        """The interrupt of each millisecond is served, and does nothing."""
        with self._patched(MILLISECOND_VECTOR, RETURN_FROM_INTERRUPT):
            yield

    @contextmanager
    def masking_interrupts(self) -> Iterator[None]:
        """Block all interrupts from the next millisecond to the end."""
        with self._patched(MILLISECOND_VECTOR, HANG):
            yield

    @contextmanager
    def _patched(self, at: int, code: bytes) -> Iterator[None]:
        flash = self.board.mcu.flash
        end = at + len(code)
        before = flash[at:end].tobytes()
        flash[at:end] = list(code)
        try:
            yield
        finally:
            flash[at:end] = list(before)

    def resets(self) -> int:
        return self.board.mcu.statistics().resets


@pytest.mark.parametrize("optimisation", ["-O2", "-O3"])
def test_it_boots_however_the_compiler_writes_the_loop_that_paints_the_stack(
    optimisation: str,
) -> None:
    uno = Uno(optimisation)
    uno.wait(BOOT_OVER_US)
    assert uno.hello().reset_cause is m.ResetCause.POWER_ON


def test_interrupts_are_on_within_the_first_millisecond_so_that_none_is_missed() -> None:
    uno = Uno(profiling=True)
    uno.wait(5000)
    assert uno.board.mcu.statistics().longest_masked_cycles < 400 * CYCLES_PER_US


def test_pulses_are_exact_and_begin_with_their_frame() -> None:
    uno = Uno()
    edges: list[Edge] = []
    uno.board.observe_edges(edges.append)
    uno.make_armed()
    uno.ask(m.SetTarget(SESSION, (1234, -777), 0, 10_000))
    uno.wait(400_000)
    rises = [edge.cycle for edge in edges if edge.level and edge.pin == 0]
    falls = [edge.cycle for edge in edges if not edge.level and edge.pin == 0]
    frame_cycles = m.TICK_US * CYCLES_PER_US
    assert len(rises) > 20
    assert {later - earlier for earlier, later in pairwise(rises)} == {frame_cycles}
    assert (falls[-1] - rises[-1]) * 2 == uno.report().pulse_half_us[0] * CYCLES_PER_US
    assert rises[0] % frame_cycles < 10 * CYCLES_PER_US  # Since the reset (TIM-2).


@pytest.mark.parametrize("boot_loader_clears_flags", [False, True])
def test_a_hang_is_ended_by_the_watchdog_and_reported_as_its_fault(
    boot_loader_clears_flags: bool,
) -> None:
    uno = Uno(boot_loader=optiboot() if boot_loader_clears_flags else None)
    if boot_loader_clears_flags:
        uno.wait(BOOT_LOADER_US)
    uno.make_ready()
    resets_before = uno.resets()
    with uno.hanging_in("eeprom_write_byte"):
        uno.board.receive(encode_frame(m.SaveConfig.ID, 1, m.SaveConfig(SESSION).pack()))
        hung_for_us = 0
        while uno.resets() == resets_before:
            uno.wait(1000)
            hung_for_us += 1000
            assert hung_for_us < WATCHDOG_LATEST_US + m.TICK_US
    uno.wait(BOOT_OVER_US + 20_000)
    assert uno.hello().reset_cause is m.ResetCause.WATCHDOG
    report = uno.report()
    assert report.state is m.State.FAULT
    assert report.fault is m.Fault.WATCHDOG_RESET


def test_without_ticks_the_watchdog_bites() -> None:
    uno = Uno()
    uno.make_armed()
    resets_before = uno.resets()
    with uno.losing_milliseconds():
        uno.wait(WATCHDOG_LATEST_US)
    assert uno.resets() == resets_before + 1


def test_without_the_receiver_the_watchdog_bites() -> None:
    uno = Uno()
    uno.make_armed()
    resets_before = uno.resets()
    (ticks_due,) = (at for name, at in uno.board._symbols.items() if "ticks_dueE" in name)
    for _ in range(WATCHDOG_LATEST_US // 1000):
        uno.board.mcu.memory[ticks_due] = 0xFF
        uno.wait(1000)
        if uno.resets() > resets_before:
            return
    raise AssertionError("fed although it has served ticks alone")


def test_ticks_come_before_the_bytes_of_a_line_faster_than_the_processor() -> None:
    baud = 500_000
    uno = Uno(f"-DCCR_BAUD={baud}UL", baud=baud)
    uno.make_armed()
    before, resets_before = uno.report(), uno.resets()
    target = m.SetTarget(SESSION, (9000, -9000), 300, 10_000)
    data = encode_frame(target.ID, 1, target.pack()) * 2000
    uno.board.receive(data, baud)
    flood_us = len(data) * 10 * 1_000_000 // baud
    uno.wait(flood_us + m.TICK_US)
    uno.board.receive(bytes([m.FRAME_DELIMITER]), baud)  # of the last frame some bytes are lost
    after = uno.report()
    assert uno.resets() == resets_before
    assert after.fault is m.Fault.NONE
    assert abs((after.tick - before.tick) * m.TICK_US - flood_us - m.TICK_US) <= 2 * m.TICK_US
    counters = uno.ask(m.GetCounters())
    assert isinstance(counters, m.CountersReply)
    assert counters.overruns > 100


def test_a_byte_that_the_uart_has_lost_is_counted() -> None:
    uno = Uno()
    uno.make_ready()
    uno.wait(m.TICK_US - uno.board.now_us % m.TICK_US + 3_500)
    with uno.masking_interrupts():
        uno.wait(600)
        uno.board.receive(bytes(8))
        uno.wait(700)
    uno.wait(2000)
    assert uno.board.mcu.statistics().overruns > 0
    assert uno.report().link_errors > 0
    assert uno.report().fault is m.Fault.NONE


def test_no_interrupt_is_slept_through() -> None:
    """The byte that ends a request comes in each cycle around the return from an interrupt."""
    uno = Uno()
    uno.make_ready()
    request = encode_frame(m.ClockSync.ID, 1, m.ClockSync(0).pack())
    bit_cycles = CLOCK_HZ // m.BAUD
    request_cycles = len(request) * 10 * bit_cycles
    for offset in range(0, 450):
        uno.wait(m.TICK_US - uno.board.now_us % m.TICK_US + 1_500)
        ms_cycle = (uno.board.now_us // 1000 + 2) * 1000 * CYCLES_PER_US
        uno.board.mcu.send(ms_cycle + offset - request_cycles, request, bit_cycles)
        uno.wait(3_000)
        answer = uno.board.take_departures()
        assert answer[0].start_cycle - ms_cycle - offset < 400 * CYCLES_PER_US, offset


def test_both_pulses_of_a_frame_are_of_one_tick_however_late_it_is() -> None:
    uno = Uno()
    edges: list[Edge] = []
    uno.make_armed()
    uno.board.observe_edges(edges.append)
    for number, early_cycles in enumerate(range(0, 6400, 4)):
        if number % 400 == 0:
            angle = -9000 if number % 800 else 9000
            uno.ask(m.SetTarget(SESSION, (angle, -angle), 10_000, 10_000))
        frame_us = _next_frame_us(uno)
        uno.board.advance_to(frame_us + 17_500)
        with uno.hanging_in(_kept_function(uno)):
            uno.board.mcu.run_until((frame_us + 19_000) * CYCLES_PER_US - early_cycles)
    uno.wait(2 * m.TICK_US)
    first, second = (
        [fall.cycle - rise.cycle for rise, fall in zip(*_rises_and_falls(edges, pin), strict=True)]
        for pin in (0, 1)
    )
    middle = 3000 * CYCLES_PER_US // 2
    assert len(first) > 1500
    assert [width - middle for width in first] == [middle - width for width in second]


def test_no_tick_is_lost_however_late_one_is_done() -> None:
    uno = Uno()
    uno.make_ready()
    uno.ask(m.SetTelemetry(SESSION, 1))
    making_the_report = "_ZNK3ccr10Dispatcher12state_reportEv"
    for early_cycles in range(0, 6000, 3):
        frame_us = _next_frame_us(uno)
        uno.board.advance_to(frame_us + 17_500)
        with uno.hanging_in(making_the_report):
            end_cycle = (frame_us + m.TICK_US + m.TICK_PHASE_US) * CYCLES_PER_US - early_cycles
            uno.board.mcu.run_until(end_cycle)
        uno.board.advance_to(frame_us + 2 * m.TICK_US)
    uno.ask_quietly(m.SetTelemetry(SESSION, 0))
    report = uno.report()
    assert report.tick == (uno.board.now_us - m.TICK_PHASE_US) // m.TICK_US + 1


def test_the_clock_does_not_jump_at_the_start_of_a_frame() -> None:
    uno = Uno()
    uno.make_ready()
    request = encode_frame(m.ClockSync.ID, 1, m.ClockSync(0).pack())
    bit_cycles = CLOCK_HZ // m.BAUD
    request_cycles = len(request) * 10 * bit_cycles
    for offset in range(-2400, 0, 2):
        frame_us = _next_frame_us(uno) + m.TICK_US
        uno.board.advance_to(frame_us - 2_000)
        uno.board.take_output()
        end_cycle = frame_us * CYCLES_PER_US + offset
        uno.board.mcu.send(end_cycle - request_cycles, request, bit_cycles)
        uno.wait(4_000)
        (frame,) = (f for f in FrameDecoder().feed(uno.board.take_output()))
        assert isinstance(frame, Frame)
        told_us = m.ClockReply.unpack(frame.payload).board_time_us
        assert 0 <= told_us - end_cycle // CYCLES_PER_US < 250, offset


def test_behind_a_boot_loader_that_hides_it_an_external_reset_is_not_a_fault() -> None:
    uno = Uno(boot_loader=optiboot())
    uno.wait(BOOT_LOADER_US)
    assert uno.hello().reset_cause is m.ResetCause.POWER_ON
    uno.board.reset(m.ResetCause.EXTERNAL)
    uno.wait(BOOT_LOADER_US)
    assert uno.hello().reset_cause is m.ResetCause.UNKNOWN
    assert uno.report().state is m.State.DISARMED


@pytest.mark.parametrize("cause", [m.ResetCause.BROWN_OUT, m.ResetCause.EXTERNAL])
def test_behind_a_boot_loader_that_hides_it_a_reset_while_armed_is_a_fault(
    cause: m.ResetCause,
) -> None:
    uno = Uno(boot_loader=optiboot())
    uno.wait(BOOT_LOADER_US)
    uno.make_armed()
    uno.board.reset(cause)
    uno.wait(BOOT_LOADER_US)
    assert uno.hello().reset_cause is m.ResetCause.UNKNOWN
    report = uno.report()
    assert (report.state, report.fault) == (m.State.FAULT, m.Fault.RESET_WHILE_ARMED)
    uno.board.reset(cause)
    uno.wait(BOOT_LOADER_US)
    assert uno.report().state is m.State.DISARMED


@pytest.mark.parametrize("code", [HANG_WITHOUT_INTERRUPTS, JUMP_TO_THE_START])
@pytest.mark.parametrize("has_boot_loader", [False, True])
def test_a_program_that_goes_astray_while_armed_comes_back_in_fault(
    code: bytes, has_boot_loader: bool
) -> None:
    uno = Uno(boot_loader=optiboot() if has_boot_loader else None)
    if has_boot_loader:
        uno.wait(BOOT_LOADER_US)
    uno.make_armed()
    with uno.hanging_in(_kept_function(uno), code):
        uno.wait(WATCHDOG_LATEST_US)
    uno.wait(BOOT_OVER_US + 20_000)
    report = uno.report()
    is_told = code == HANG_WITHOUT_INTERRUPTS and not has_boot_loader
    fault = m.Fault.WATCHDOG_RESET if is_told else m.Fault.RESET_WHILE_ARMED
    assert (report.state, report.fault) == (m.State.FAULT, fault)


def test_after_a_loss_of_power_that_memory_outlasts_the_flag_of_power_on_is_believed() -> None:
    uno = Uno()
    uno.make_armed()
    uno.board.mcu.reset(m.ResetCause.POWER_ON)
    uno.wait(BOOT_OVER_US)
    assert uno.hello().reset_cause is m.ResetCause.POWER_ON
    assert uno.report().state is m.State.DISARMED


@pytest.mark.parametrize("code", [HANG, HANG_WITHOUT_INTERRUPTS, JUMP_TO_THE_START])
def test_a_program_that_goes_astray_takes_the_servo_supply_away(code: bytes) -> None:
    uno = Uno()
    uno.make_armed()
    assert uno.board.servo_supply_on
    with uno.hanging_in(_kept_function(uno), code):
        uno.wait(WATCHDOG_LATEST_US)
    assert not uno.board.servo_supply_on


def test_a_brown_out_is_reported_even_if_the_reset_pin_was_pulled_too() -> None:
    uno = Uno()
    uno.make_armed()
    uno.board.reset(m.ResetCause.BROWN_OUT)
    uno.board.reset(m.ResetCause.EXTERNAL)
    uno.wait(BOOT_OVER_US)
    assert uno.report().fault is m.Fault.BROWN_OUT_RESET


def test_pulses_are_exact_behind_a_boot_loader_that_leaves_timers_running() -> None:
    uno = Uno(boot_loader=optiboot())
    uno.wait(BOOT_LOADER_US)
    uno.make_armed()
    assert uno.board.pulses_half_us == (3000, 3000)
    assert uno.report().pulse_half_us == (3000, 3000)


@pytest.mark.parametrize("ends_us_into_frame", [100, 700, 1400, 1600, 18_500])
def test_a_late_tick_is_a_fault_and_cuts_no_pulse(ends_us_into_frame: int) -> None:
    uno = Uno()
    edges: list[Edge] = []
    uno.board.observe_edges(edges.append)
    uno.make_armed()
    ticks_before = uno.report().tick
    with uno.hanging_in(_kept_function(uno)):
        frame = uno.board.now_us // m.TICK_US
        uno.board.advance_to((frame + 3) * m.TICK_US + ends_us_into_frame)
    uno.wait(2 * m.TICK_US)

    report = uno.report()
    assert report.fault is m.Fault.TICK_OVERRUN
    assert report.tick >= ticks_before + 4  # The late ticks are made up for.
    uno.wait(3 * m.TICK_US)
    widths = [
        fall.cycle - rise.cycle for rise, fall in zip(*_rises_and_falls(edges, pin=0), strict=True)
    ]
    assert set(widths) == {3000 * CYCLES_PER_US // 2}
    assert uno.board.pulses_half_us == (0, 0)


@pytest.mark.parametrize("lost_ms", range(m.TICK_US // 1000))
def test_a_lost_millisecond_is_a_fault_and_cuts_no_pulse(lost_ms: int) -> None:
    uno = Uno()
    edges = _edges_of_widest_pulses(uno)
    frame_us = _next_frame_us(uno)
    uno.board.advance_to(frame_us + (lost_ms - 1) * 1000 + 500)
    with uno.losing_milliseconds():
        uno.wait(1000)
    uno.wait(3 * m.TICK_US)
    _assert_whole_pulses_and_then_none(uno, edges)


@pytest.mark.parametrize("masked_us", [1100, 1900, 2100, 4500, 19_500, 20_500, 21_500, 40_500])
@pytest.mark.parametrize("first_ms", [1, 3, 16, 17, 18, 19])
def test_interrupts_off_for_longer_than_a_millisecond_are_a_fault_and_cut_no_pulse(
    first_ms: int, masked_us: int
) -> None:
    uno = Uno()
    edges = _edges_of_widest_pulses(uno)
    uno.board.advance_to(_next_frame_us(uno) + first_ms * 1000 - 500)
    with uno.masking_interrupts():
        uno.wait(500 + masked_us)
    uno.wait(3 * m.TICK_US)
    _assert_whole_pulses_and_then_none(uno, edges)


@pytest.mark.parametrize("masked_us", [200, 900, 940, 960, 980, *range(990, 1000)])
def test_a_late_millisecond_connects_no_pin_in_the_middle_of_a_pulse(masked_us: int) -> None:
    uno = Uno()
    edges = _edges_of_widest_pulses(uno)
    uno.board.advance_to(_next_frame_us(uno) + 17_500)
    uno.board.receive(encode_frame(m.Stop.ID, 1, b""))
    uno.wait(1_000)
    with uno.masking_interrupts():
        uno.wait(500 + masked_us)
    uno.wait(3 * m.TICK_US)
    assert _widths_us(edges) == {2500}
    assert uno.board.pulses_half_us == (0, 0)


def _edges_of_widest_pulses(uno: Uno) -> list[Edge]:
    edges: list[Edge] = []
    uno.make_armed()
    uno.ask(m.SetTarget(SESSION, (9000, 9000), 0, 10_000))
    uno.wait(1_000_000)
    uno.board.observe_edges(edges.append)
    return edges


def _next_frame_us(uno: Uno) -> int:
    return (uno.board.now_us // m.TICK_US + 1) * m.TICK_US


def _widths_us(edges: list[Edge]) -> set[float]:
    return {
        (fall.cycle - rise.cycle) / CYCLES_PER_US
        for pin in (0, 1)
        for rise, fall in zip(*_rises_and_falls(edges, pin), strict=True)
    }


def _assert_whole_pulses_and_then_none(uno: Uno, edges: list[Edge]) -> None:
    assert _widths_us(edges) == {2500}
    assert uno.board.pulses_half_us == (0, 0)
    report = uno.report()
    assert (report.state, report.fault) == (m.State.FAULT, m.Fault.INTERNAL)
    uno.ask(m.ClearFault(SESSION))
    uno.ask(m.Arm(SESSION))
    uno.wait(5 * m.TICK_US)
    assert uno.report().state is m.State.ARMING
    assert 0 not in uno.board.pulses_half_us


def test_used_up_stack_is_a_fault_and_reported() -> None:
    uno = Uno()
    uno.make_ready()
    free_before = uno.report().free_stack_bytes
    assert 512 <= free_before < 1800
    uno.board.mcu.memory[uno.board.symbol("_end") + 40] = 0
    uno.wait(2_000_000)  # A sweep over the stack takes a second.
    report = uno.report()
    assert report.free_stack_bytes == 40
    assert report.fault is m.Fault.STACK_LOW


def _kept_function(uno: Uno) -> str:
    """A function that each tick calls and that the compiler has not dissolved in its callers."""
    return next(
        name for name in ("__divmodsi4", "__mulsi3", "__mulhisi3") if name in uno.board._symbols
    )


def _rises_and_falls(edges: list[Edge], pin: int) -> tuple[list[Edge], list[Edge]]:
    mine = [edge for edge in edges if edge.pin == pin]
    return [edge for edge in mine if edge.level], [edge for edge in mine if not edge.level]


def test_a_board_built_for_one_outstanding_request_announces_it() -> None:
    uno = Uno("-DCCR_OUTSTANDING_REQUESTS=1")
    uno.wait(BOOT_OVER_US)
    assert uno.hello().capabilities & m.Capabilities.LINK_LIMITS
    limits = uno.ask(m.GetLinkLimits())
    assert limits == m.LinkLimitsReply(1, m.OUTSTANDING_BYTES.of(2))
