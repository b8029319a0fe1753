"""Single faults that are seeded into firmware and host, and the test that detects each."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path

from tests.conformance.firmware_build import ROOT


@dataclass(frozen=True)
class Mutant:
    """A change in one place of the firmware or the host."""

    name: str
    file: str
    before: str
    after: str
    noticed_by: str
    """The rule of the oracle, or rules where several may come first; or a test."""
    tree: str = "firmware"

    def build(self, folder: Path) -> Path:
        """The mutant's program; `folder` is empty."""
        self.seed(folder)
        build = folder / "scripts" / "build-firmware"
        subprocess.run([build, folder / "out"], check=True, capture_output=True)
        return folder / "out" / "firmware.elf"

    def is_noticed(self, folder: Path) -> bool:
        """Whether the test fails with it; `folder` is empty."""
        self.seed(folder)
        for part in ("tests", "protocol"):
            shutil.copytree(
                ROOT / part, folder / part, ignore=shutil.ignore_patterns("__pycache__")
            )
        shutil.copy(ROOT / "pyproject.toml", folder)
        command = [sys.executable, "-m", "pytest", "-q", "-x", "-p", "no:cacheprovider"]
        test, _, name = self.noticed_by.partition("::")
        result = subprocess.run(
            [*command, test, "-k", name],
            cwd=folder,
            env={**os.environ, "PYTHONPATH": str(folder / "host")},  # before the one installed
            capture_output=True,
            text=True,
            check=False,
        )
        failed = result.returncode == 1 and "1 failed" in result.stdout
        assert failed or result.returncode == 0, result.stdout
        return failed

    def seed(self, folder: Path) -> None:
        """The sources with the fault."""
        shutil.copytree(ROOT / self.tree, folder / self.tree)
        (folder / "scripts").mkdir()
        shutil.copy(ROOT / "scripts" / "build-firmware", folder / "scripts")
        source = folder / self.tree / self.file
        text = source.read_text(encoding="utf-8")
        assert text.count(self.before) == 1, f"{self.name}: its place is gone"
        source.write_text(text.replace(self.before, self.after), encoding="utf-8")


SETPOINT = "lib/core/setpoint.cpp"
SAFETY = "lib/core/safety.cpp"
CONTROLLER = "lib/core/controller.cpp"
DISPATCHER = "lib/core/dispatcher.cpp"

AT_THE_PINS = [
    Mutant(
        "setpoint steps are not limited",
        SETPOINT,
        "clamped(way, static_cast<int16_t>(-slew), slew)",
        "(slew > 0 ? way : int16_t{0})",
        "slew limit|slow way to rest",
    ),
    Mutant(
        "the return to rest is not slowed down",
        CONTROLLER,
        "slew < relax_slew ? slew : relax_slew",
        "slew < relax_slew ? slew : slew",
        "slow way to rest",
    ),
    Mutant(
        "targets are not clamped",
        CONTROLLER,
        "const int16_t accepted = clamped(target.target_cdeg[axis], limits.angle_min_cdeg[axis],\n"
        "                                     limits.angle_max_cdeg[axis]);",
        "const int16_t accepted = target.target_cdeg[axis];\n    (void)limits;",
        "angle limits",
    ),
    Mutant(
        "the minimum calibrated pulse is ignored",
        "lib/core/pulses.cpp",
        "return least > kPulseFloorHalfUs ? least : kPulseFloorHalfUs;",
        "return least > kPulseFloorHalfUs ? kPulseFloorHalfUs : least;",
        "calibrated pulses",
    ),
    Mutant(
        "stop has no effect",
        SAFETY,
        "void Safety::stop() { apply(Event::kStopRequested); }",
        "void Safety::stop() {}",
        "no pulses after a stop|a stop is latched",
    ),
    Mutant(
        "disarming never ends",
        SAFETY,
        "    case State::kDisarming:\n      if (is_at_rest) {",
        "    case State::kDisarming:\n      if (is_at_rest && is_due && enabled_axes_ > kAxes) {",
        "disarming ends",
    ),
    Mutant(
        "hold never ends",
        SAFETY,
        "        apply(Event::kHoldExpired);",
        "        countdown_.start(ticks_of_ms(watchdog.relax_after_ms));",
        "a silent host ends the pulses",
    ),
    Mutant(
        "a target never expires",
        SAFETY,
        "        apply(Event::kTargetExpired);",
        "",
        "hold stands still|a silent host ends the pulses",
    ),
    Mutant(
        "both servos are enabled at once",
        SAFETY,
        "  enabled_axes_ = 1;",
        "  enabled_axes_ = kAxes;",
        "one servo after the other",
    ),
    Mutant(
        "pulses without arming",
        SAFETY,
        "return has_pulses() && axis < enabled_axes_;",
        "return (has_pulses() || state_ == State::kDisarmed) && axis < enabled_axes_;",
        "the supply is on|disarming ends|no pulses before arming|no pulses after a stop",
    ),
    Mutant(
        "a stop can be cleared while pulses last",
        DISPATCHER,
        "const NackCode code = controller_.has_pulses() ",
        "const NackCode code = controller_.has_pulses() && kAxes == 0 ",
        "cleared after a frame without pulses",
    ),
    Mutant(
        "the session is not checked",
        "lib/core/dispatcher.cpp",
        "(!session_.is_open() || get_u16(frame.payload()) != session_.number)",
        "!session_.is_open()",
        "only the open session",
    ),
    Mutant(
        "ranges are not checked",
        "lib/core/dispatcher.cpp",
        "  if (field != kNone) {",
        "  if (field != kNone && frame.id() == Hello::kId) {",
        "values in range",
    ),
    Mutant(
        "pins are connected too early",
        "src/frame_timer.cpp",
        "(kTickAtMs + 1 + pulse_timers::kFirstStartUs / 1000) % kMsPerFrame;",
        "1;",
        "arming gives pulses",
    ),
    Mutant(
        "axes are swapped in the report",
        CONTROLLER,
        "report.pulse_half_us[axis] = pulses_.half_us[axis];",
        "report.pulse_half_us[axis] = pulses_.half_us[1 - axis];",
        "the report tells the pins",
    ),
    Mutant(
        "the servo supply is never switched off",
        CONTROLLER,
        "hardware_.set_servo_supply(safety_.has_pulses());",
        "if (safety_.has_pulses()) {\n    hardware_.set_servo_supply(true);\n  }",
        "the supply is on with the pulses",
    ),
    Mutant(
        "a repeated request is executed twice",
        "lib/core/retry_memory.cpp",
        "  if (!is_set_ || request.id() != id_",
        "  if (!is_set_ || is_set_ || request.id() != id_",
        "not executed again",
    ),
]

GLUE = "tests/firmware/uno/test_glue.py::"
CONFORMANCE = "tests/conformance::"

INSIDE = [
    Mutant(
        "the watchdog is fed without a tick",
        "src/watchdog.cpp",
        "if (!has_ticked_ || !has_received_) {",
        "if (!has_received_) {",
        GLUE + "test_without_ticks_the_watchdog_bites",
    ),
    Mutant(
        "the watchdog is fed without the receiver",
        "src/watchdog.cpp",
        "if (!has_ticked_ || !has_received_) {",
        "if (!has_ticked_) {",
        GLUE + "test_without_the_receiver_the_watchdog_bites",
    ),
    Mutant(
        "bytes are processed before ticks",
        "src/main.cpp",
        "    if (avr::frame_timer::is_tick_due()) {",
        "    if (avr::frame_timer::is_tick_due() && !avr::uart::has_received()) {",
        GLUE + "test_ticks_come_before_the_bytes_of_a_line_faster_than_the_processor",
    ),
    Mutant(
        "overruns of the UART are not counted",
        "src/uart.cpp",
        "if ((status & _BV(DOR0)) != 0) {",
        "if ((status & _BV(DOR0)) == 0xFF) {",
        GLUE + "test_a_byte_that_the_uart_has_lost_is_counted",
    ),
    Mutant(
        "overruns of the ring are not counted",
        "src/uart.cpp",
        "if (!received.push(byte)) {",
        "if (!received.push(byte) && status == 0xFF) {",
        GLUE + "test_ticks_come_before_the_bytes_of_a_line_faster_than_the_processor",
    ),
    Mutant(
        "interrupts are on before sleep",
        "src/main.cpp",
        "  cli();\n  if (!avr::frame_timer",
        "  if (!avr::frame_timer",
        GLUE + "test_no_interrupt_is_slept_through",
    ),
    Mutant(
        "pulses are prepared with interrupts on",
        "src/frame_timer.cpp",
        "  ATOMIC_BLOCK(ATOMIC_RESTORESTATE) { prepared = next; }",
        "  prepared = next;",
        GLUE + "test_both_pulses_of_a_frame_are_of_one_tick_however_late_it_is",
    ),
    Mutant(
        "the clock is read with interrupts on",
        "src/frame_timer.cpp",
        "  bool has_new_frame_begun;\n  ATOMIC_BLOCK(ATOMIC_RESTORESTATE) {",
        "  bool has_new_frame_begun;\n  {",
        GLUE + "test_the_clock_does_not_jump_at_the_start_of_a_frame",
    ),
    Mutant(
        "a tick is finished with interrupts on",
        "src/frame_timer.cpp",
        "  ATOMIC_BLOCK(ATOMIC_RESTORESTATE) { ticks_due = static_cast<uint8_t>(ticks_due - 1); }",
        "  ticks_due = static_cast<uint8_t>(ticks_due - 1);",
        GLUE + "test_no_tick_is_lost_however_late_one_is_done",
    ),
    Mutant(
        "the phase of the frame is not checked",
        "src/frame_timer.cpp",
        "while (!is_in_ms(counts)) {",
        "while (!is_in_ms(counts) && kMsPerFrame == 0) {",
        GLUE + "test_a_lost_millisecond_is_a_fault_and_cuts_no_pulse",
    ),
    Mutant(
        "pins are connected too late",
        "src/frame_timer.cpp",
        "kFrameCounts - 50 * kCountsPerUs;",
        "kFrameCounts;",
        GLUE + "test_a_late_millisecond_connects_no_pin_in_the_middle_of_a_pulse",
    ),
    Mutant(
        "pulses before a reset are not remembered",
        "src/reset_cause.cpp",
        "pulses.are_none() ? 0 : kPulsesMark;",
        "pulses.are_none() ? 0 : kPulsesMark - 1;",
        CONFORMANCE + "test_reset_of_unknown_cause_ends_boot_in_fault_where_it_has_cut_pulses",
    ),
    Mutant(
        "the emergency stop is not read in ticks",
        CONTROLLER,
        "  watch_emergency_stop();\n  watch_supply",
        "  watch_supply",
        CONFORMANCE + "test_opening_the_emergency_stop_ends_the_pulses_within_22_ms",
    ),
    Mutant(
        "the emergency-stop input is inverted",
        "boards/uno/board_pins.h",
        "return (PIND & _BV(PIND7)) != 0;",
        "return (PIND & _BV(PIND7)) == 0;",
        CONFORMANCE + "test_opening_the_emergency_stop_ends_the_pulses_within_22_ms",
    ),
    Mutant(
        "an open emergency stop can be cleared",
        "lib/core/dispatcher.cpp",
        ": controller_.is_emergency_stop_open() ? NackCode::kEmergencyStopOpen",
        ": controller_.is_emergency_stop_open() ? kGranted",
        CONFORMANCE + "test_latch_is_not_cleared_while_the_emergency_stop_is_open",
    ),
    Mutant(
        "a low supply is not a fault",
        CONTROLLER,
        "if (++ticks_of_sag_ >= kSagTicks) {",
        "if (++ticks_of_sag_ >= kSagTicks && !is_wired) {",
        CONFORMANCE + "test_supply_that_stays_too_low_is_a_fault_and_a_short_dip_is_not",
    ),
    Mutant(
        "a short dip of the supply is a fault",
        CONTROLLER,
        "    ticks_of_sag_ = 0;\n    return;",
        "    return;",
        CONFORMANCE + "test_supply_that_stays_too_low_is_a_fault_and_a_short_dip_is_not",
    ),
    Mutant(
        "a board that has lost its configuration has no emergency stop",
        "lib/core/config_store.cpp",
        "    configuration.missing_groups |= config_groups::kEquipment;",
        "",
        CONFORMANCE + "test_board_that_may_have_lost_its_emergency_stop_is_not_armed",
    ),
    Mutant(
        "there is no acceleration limit",
        SETPOINT,
        "  if (acceleration_cdeg == 0) {",
        "  if (acceleration_cdeg < 30000) {",
        CONFORMANCE + "test_setpoint_stops_at_its_target_without_passing_it",
    ),
    Mutant(
        "the setpoint brakes too late",
        SETPOINT,
        "  uint16_t sum = 0;",
        "  uint16_t sum = acceleration;",
        CONFORMANCE + "test_setpoint_stops_at_its_target_without_passing_it",
    ),
    Mutant(
        "hold stops without deceleration",
        CONTROLLER,
        "setpoint.brake(safety_.has_pulses() ? acceleration : uint16_t{0});",
        "setpoint.brake(safety_.has_pulses() ? uint16_t{0} : acceleration);",
        CONFORMANCE + "test_hold_brakes_and_then_stands_still",
    ),
    Mutant(
        "the servo supply is on whenever there is a configuration",
        CONTROLLER,
        "hardware_.set_servo_supply(safety_.has_pulses());",
        "hardware_.set_servo_supply(configuration_.is_complete());",
        CONFORMANCE + "test_servo_supply_is_on_from_arming_until_the_pulses_end",
    ),
    Mutant(
        "the servo supply stays on through a fault",
        CONTROLLER,
        "hardware_.set_servo_supply(safety_.has_pulses());",
        "hardware_.set_servo_supply(safety_.has_pulses() || safety_.state() == State::kFault);",
        CONFORMANCE + "test_servo_supply_stays_off_through_boot_into_fault",
    ),
    Mutant(
        "no room is reserved for the answer to stop",
        "lib/core/dispatcher.cpp",
        "send<Ack, 0>(",
        "send<Ack>(",
        "tests/firmware/native_core/test_core.py::test_every_case_passes_and_none_is_left_out",
    ),
    Mutant(
        "a request before a stop is repeated after it",
        "lib/core/dispatcher.cpp",
        "  session_.retries.make_void();\n",
        "",
        CONFORMANCE + "test_requests_before_a_stop_are_neither_repeated_nor_acknowledged_again",
    ),
    Mutant(
        "all boots are counted in one cell",
        "lib/core/config_store.cpp",
        "boot_counter_address(counted % kEepromBootCounters)",
        "boot_counter_address(0)",
        CONFORMANCE + "test_no_cell_of_the_eeprom_is_written_at_every_reset",
    ),
]

CLIENT = "tests/unit/link/test_client.py::"
LOOP = "tests/unit/run/test_loop.py::"

IN_THE_HOST = [
    Mutant(
        "a run without markers ends after the hold alone",
        "ccr_host/run/marker_watch.py",
        "if lost_us > self._coast_us + self._hold_us:",
        "if lost_us > self._hold_us:",
        LOOP + "test_without_markers_the_controller_coasts_then_the_pose_is_held_then_the_run_ends",
        "host",
    ),
    Mutant(
        "a run ends although the board has only held",
        "ccr_host/link/client.py",
        "_LOST_STATES: Final = _LATCHED_STATES | {State.RELAXING}",
        "_LOST_STATES: Final = _LATCHED_STATES | {State.RELAXING, State.HOLD}",
        CLIENT + "test_a_host_that_was_away_goes_on_only_if_the_board_has_not_begun_to_relax",
        "host",
    ),
    Mutant(
        "targets are valid for at least 2 s",
        "ccr_host/run/loop.py",
        "_VALIDITY_LIMITS_MS = (200, 10_000)",
        "_VALIDITY_LIMITS_MS = (2000, 10_000)",
        LOOP + "test_a_target_outlives_its_step_by_little_so_that_a_dead_host_is_noticed",
        "host",
    ),
    Mutant(
        "a board may be silent for 10 s",
        "ccr_host/link/board.py",
        "TELEMETRY_TIMEOUT_US = 1_000_000",
        "TELEMETRY_TIMEOUT_US = 10_000_000",
        CLIENT + "test_a_silent_board_is_looked_for_after_a_second_whatever_is_sent_to_it",
        "host",
    ),
    Mutant(
        "targets without an answer are ignored",
        "ccr_host/link/exchange.py",
        "self._given_up += sequence in self._open_since_us",
        "self._given_up += 0",
        CLIENT + "test_lost_target_is_counted_and_not_sent_again",
        "host",
    ),
    Mutant(
        "the link is polled every 20 ms",
        "ccr_host/link/exchange.py",
        "POLL_STEP_US = 200",
        "POLL_STEP_US = 20_000",
        CLIENT + "test_a_request_takes_no_longer_than_its_answer",
        "host",
    ),
    Mutant(
        "round trips whose end was not observed are counted",
        "ccr_host/link/exchange.py",
        "_COARSE_POLL_US = 2000",
        "_COARSE_POLL_US = 2_000_000",
        CLIENT + "test_a_round_trip_that_nobody_watched_is_not_counted",
        "host",
    ),
]
