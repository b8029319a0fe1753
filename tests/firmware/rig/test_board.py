"""Resets, EEPROM, statistics and determinism of the simulated board."""

import ctypes

import numpy as np
import pytest

from ccr_host.core.errors import ConfigError, DeviceError
from ccr_host.link.messages import ResetCause
from ccr_host.sim.board.eeprom import EepromFile, EepromImage

FLAGS = {
    ResetCause.POWER_ON: 1,
    ResetCause.EXTERNAL: 2,
    ResetCause.BROWN_OUT: 4,
    ResetCause.WATCHDOG: 8,
}


@pytest.mark.parametrize("cause", FLAGS)
def test_reset_cause_is_what_the_program_finds(board, cause):
    uno = board("resets")
    uno.advance_to(1000)
    uno.take_output()
    uno.reset(cause)
    uno.advance_to(2000)
    assert uno.take_output()[0] == FLAGS[cause]


def test_sram_survives_all_resets_but_a_power_up(board):
    uno = board("resets")
    counts = []
    for cause in (ResetCause.EXTERNAL, ResetCause.WATCHDOG, ResetCause.POWER_ON):
        uno.advance_to(uno.now_us + 1000)
        counts.append(uno.take_output()[1])
        uno.reset(cause)
    uno.advance_to(uno.now_us + 1000)
    counts.append(uno.take_output()[1])
    first = counts[0]
    assert counts == [first, first + 1, first + 2, first]


@pytest.mark.parametrize("command", [b"w", b"s"], ids=["busy", "asleep with interrupts off"])
def test_watchdog_bites_after_its_time(board, exchange, command):
    uno = board("resets")
    uno.advance_to(1000)
    uno.take_output()
    assert exchange(uno, command, wait_us=15_000) == b""
    assert exchange(uno, b"", wait_us=3000)[0] == FLAGS[ResetCause.WATCHDOG]


def test_time_of_a_running_watchdog_can_be_changed(board, exchange):
    uno = board("resets")
    uno.advance_to(1000)
    uno.take_output()
    assert exchange(uno, b"l", wait_us=120_000) == b""
    assert exchange(uno, b"", wait_us=15_000)[0] == FLAGS[ResetCause.WATCHDOG]


def test_write_beyond_the_sram_stops_the_board_with_one_clear_line(board, exchange):
    uno = board("resets")
    uno.advance_to(1000)
    with pytest.raises(DeviceError, match=r"^simavr: the firmware crashed: .*0f00.*"):
        exchange(uno, b"c")


def test_jump_out_of_the_flash_stops_the_board(board, exchange):
    uno = board("resets")
    uno.advance_to(1000)
    with pytest.raises(DeviceError, match=r"^simavr: the firmware crashed: "):
        exchange(uno, b"j")


def test_memories_cover_every_address_that_a_program_can_use(board):
    """simavr carries out what it reports: it has overwritten a byte of the host's heap."""
    uno = board("resets")
    size_of = ctypes.CDLL(None).malloc_usable_size
    size_of.argtypes, size_of.restype = (ctypes.c_void_p,), ctypes.c_size_t
    for memory in (uno.mcu.memory, uno.mcu.flash):
        assert size_of(memory.ctypes.data) >= 1 << 16


def test_eeprom_write_takes_its_time(board, exchange):
    uno = board("eeprom")
    uno.advance_to(1000)
    (counts_of_64_us,) = exchange(uno, b"w\x05\x77")
    assert counts_of_64_us * 64 == pytest.approx(3400, abs=64)
    assert exchange(uno, b"r\x05") == b"\x77"


def test_missing_address_bits_of_the_eeprom_are_ignored(board, exchange):
    uno = board("eeprom")
    uno.advance_to(1000)
    exchange(uno, b"W\x05\x77")
    assert exchange(uno, b"r\x05") == b"\x77"
    assert uno.mcu.eeprom[5] == 0x77


def test_eeprom_is_kept_in_the_emulators_file(board, exchange, tmp_path):
    kept = EepromFile(tmp_path / "eeprom.bin")
    uno = board("eeprom", eeprom=kept)
    uno.advance_to(1000)
    exchange(uno, b"w\x05\x77")
    kept.close()
    content = (tmp_path / "eeprom.bin").read_bytes()
    assert (len(content), content[5], content[6]) == (1024, 0x77, 0xFF)
    again = board("eeprom", eeprom=EepromImage(content))
    again.advance_to(1000)
    assert exchange(again, b"r\x05") == b"\x77"


def test_worn_out_eeprom_keeps_its_old_value(board, exchange):
    uno = board("eeprom")
    uno.mcu.wear_out_eeprom(5)
    uno.advance_to(1000)
    exchange(uno, b"w\x05\x77")
    assert exchange(uno, b"r\x05") == b"\xff"
    assert uno.mcu.eeprom[5] == 0xFF


def test_timer_flags_are_cleared_one_by_one_and_kept_until_enabled(board):
    uno = board("flags")
    uno.advance_to(2000)
    both, one, interrupts = uno.take_output()
    assert (both & 6, one & 6, interrupts) == (6, 4, 1)


def test_sleep_is_distinguished_from_work(board):
    uno = board("echo")
    uno.advance_to(1000)
    uno.mcu.forget_statistics()
    uno.advance_to(101_000)
    assert uno.mcu.statistics().slept_cycles > 0.999 * 100_000 * 16


def test_profile_measures_longest_masked_time_and_stack_depth(board, exchange):
    uno = board("masked", profiling=True)
    uno.advance_to(1000)
    depths = []
    for units in (3, 9, 2):
        uno.mcu.forget_statistics()
        assert exchange(uno, bytes([units])) == bytes([units])
        statistics = uno.mcu.statistics()
        assert statistics.longest_masked_cycles == pytest.approx(units * 1600, abs=60)
        depths.append(0x8FF - statistics.least_stack_pointer)
    assert depths[1] - depths[0] >= 6 * 16
    assert depths[2] < depths[0]


def test_profiling_changes_no_cycle(board):
    seen = []
    for profiling in (False, True):
        uno = board("echo", profiling=profiling)
        uno.advance_to(1000)
        uno.receive(bytes(range(100)))
        uno.advance_to(10_000)
        seen.append((uno.take_departures(), uno.mcu.statistics().slept_cycles))
    assert seen[0] == seen[1]


def test_variables_are_read_and_preset_by_name(board, exchange):
    uno = board("masked")
    uno.advance_to(1000)
    address = uno.symbol("wakings")
    assert int.from_bytes(uno.mcu.memory[address : address + 4].tobytes(), "little") == 7
    uno.mcu.memory[address : address + 4] = 0xFF
    exchange(uno, b"\0")
    assert uno.mcu.memory[address : address + 4].tobytes() == bytes(4)
    with pytest.raises(ConfigError, match="no symbol nonsense"):
        uno.symbol("nonsense")


def random_life(board, seed, slices):
    """Random bytes and resets at the same times, in other slices of time."""
    uno = board("servo")
    edges = []
    uno.observe_edges(edges.append)
    rng = np.random.default_rng(seed)
    departures = []
    for _ in range(60):
        if rng.random() < 0.05:
            uno.reset(ResetCause.EXTERNAL)
        uno.receive(bytes(rng.choice(list(b"abxiopAB\x10\x20"), size=rng.integers(0, 30))))
        end_us = uno.now_us + int(rng.integers(1, 20_000))
        for cut in slices.integers(uno.now_us, end_us, size=slices.integers(0, 20)):
            uno.advance_to(max(int(cut), uno.now_us))
        uno.advance_to(end_us)
        departures += uno.take_departures()
    return edges, departures, bytes(uno.mcu.statistics()), uno.mcu.memory[:0x900].tobytes()


@pytest.mark.parametrize("seed", range(5))
def test_cutting_time_into_other_slices_changes_nothing(board, seed):
    first = random_life(board, seed, np.random.default_rng(100))
    second = random_life(board, seed, np.random.default_rng(200))
    assert first == second
