"""The simulated serial port: true timing and a true receive buffer."""

import numpy as np
import pytest

from ccr_host.link.messages import ResetCause

BYTE_CYCLES = 640  # 10 bits at 250000 baud
DOR = 1 << 3
FE = 1 << 4


def test_saturated_echo_loses_nothing_and_keeps_ten_bits_a_byte(board):
    uno = board("echo")
    uno.advance_to(1000)
    data = np.random.default_rng(1).bytes(5000)
    uno.receive(data)
    uno.advance_to(1000 + 40 * len(data) + 1000)
    departures = uno.take_departures()
    assert bytes(d.value for d in departures) == data
    assert {d.end_cycle - d.start_cycle for d in departures} == {BYTE_CYCLES}
    ends = [d.end_cycle for d in departures]
    assert ends[-1] - ends[0] == pytest.approx((len(data) - 1) * BYTE_CYCLES, abs=100)


def test_answer_starts_within_microseconds_of_the_last_stop_bit(board):
    uno = board("echo")
    uno.advance_to(1000)
    uno.receive(b"?")
    uno.advance_to(2000)
    (departure,) = uno.take_departures()
    arrival = uno.mcu.statistics().last_arrival_cycle
    assert arrival == 1000 * 16 + BYTE_CYCLES
    assert 0 < departure.start_cycle - arrival < 200


def test_receiver_holds_two_bytes_and_one_in_the_shift_register(board, exchange):
    uno = board("late_reader")
    uno.advance_to(1000)
    assert exchange(uno, b"abc") == b"\0a\0b\0c"
    assert uno.mcu.statistics().overruns == 0


def test_fourth_unread_byte_is_lost_and_the_overrun_reported(board, exchange):
    uno = board("late_reader")
    uno.advance_to(1000)
    assert exchange(uno, b"abcdef") == bytes([DOR, ord("a"), 0, ord("b"), 0, ord("f")])
    assert uno.mcu.statistics().overruns == 3


def test_receiver_recovers_after_an_overrun(board, exchange):
    uno = board("late_reader")
    uno.advance_to(1000)
    exchange(uno, b"abcdef")
    assert exchange(uno, b"xyz") == b"\0x\0y\0z"


def test_other_baud_arrives_as_frame_errors_and_is_heard_as_noise(board, exchange):
    uno = board("late_reader")
    uno.advance_to(1000)
    uno.receive(b"a", baud=115200)
    uno.advance_to(6000)
    status, data = (value ^ 0xFF for value in uno.take_output())
    assert status == FE
    assert data != ord("a")


def test_without_a_given_baud_the_host_follows_the_board(board):
    uno = board("late_reader")
    uno.advance_to(1000)
    uno.receive(b"a", baud=None)
    uno.advance_to(6000)
    assert uno.take_output() == b"\0a"


def test_bytes_before_the_receiver_is_enabled_are_lost(board):
    uno = board("echo")
    data = bytes(range(20))
    uno.receive(data)
    uno.advance_to(5000)
    heard = uno.take_output()
    assert data.endswith(heard)
    assert 0 < len(heard) < len(data)


def test_board_does_not_listen_in_reset_but_the_line_keeps_transmitting(board):
    uno = board("echo")
    uno.advance_to(1000)
    data = bytes(range(200))
    uno.receive(data)
    uno.advance_to(1000 + 4010)
    uno.take_output()
    uno.reset(ResetCause.EXTERNAL)
    uno.advance_to(20_000)
    heard = uno.take_output()
    assert data.endswith(heard)
    assert 90 < len(heard) < 100  # the hundred that are left, less those of the start-up
