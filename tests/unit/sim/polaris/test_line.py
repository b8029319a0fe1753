"""The wire to the emulated camera: time, rates, breaks."""

import numpy as np
import pytest

from ccr_host.description.simulation import Tracker
from ccr_host.sim.polaris.line import PROCESSING_US, RESET_US, make_polaris
from ccr_host.sim.polaris.sensor import PolarisFaults


@pytest.fixture
def line():
    return make_polaris(Tracker(), np.random.SeedSequence(1))


def answer(line, command: bytes, start_us: int, wait_us: int = 200_000) -> bytes:
    line.advance_to(start_us)
    line.read()
    line.write(command)
    line.advance_to(start_us + wait_us)
    return line.read()


def test_bytes_take_their_time_at_the_rate(line):
    line.write(b"INIT:E3A5\r")
    reply_begins_us = 10_417 + PROCESSING_US  # 10 bytes at 9600 baud
    line.advance_to(reply_begins_us + 1_000)
    assert line.read() == b""
    line.advance_to(reply_begins_us + 3_200)
    assert line.read() == b"OKA"
    line.advance_to(reply_begins_us + 9_400)
    assert line.read() == b"YA896\r"


def test_command_in_pieces_and_several_at_once(line):
    line.write(b"INIT:E3")
    line.advance_to(50_000)
    assert answer(line, b"A5\rINIT:E3A5\r", 50_000) == b"OKAYA896\rOKAYA896\r"


def test_comm_is_answered_at_the_old_rate_and_then_the_new_one_holds(line):
    line.set_baud(9600)
    assert answer(line, b"COMM 50000\r", 0) == b"OKAYA896\r"
    garbled = answer(line, b"INIT:E3A5\r", 200_000)
    assert b"OKAY" not in garbled
    line.set_baud(115_200)
    assert b"ERROR" in answer(line, b"INIT:E3A5\r", 400_000)  # what was garbled comes before it
    assert answer(line, b"INIT:E3A5\r", 600_000) == b"OKAYA896\r"


def test_break_resets_at_any_rate(line):
    answer(line, b"COMM 50000\r", 0)
    line.set_baud(9600)
    line.set_break(True)
    line.advance_to(500_000)
    line.set_break(False)
    line.advance_to(500_000 + RESET_US - 1000)
    assert line.read() == b""
    line.advance_to(500_000 + RESET_US + 20_000)
    assert line.read() == b"RESETBE6F\r"


def test_reset_command_has_no_crc_and_answers_after_a_while(line):
    assert answer(line, b"RESET \r", 0, RESET_US + 50_000) == b"RESETBE6F\r"


def test_silent_camera_hears_nothing():
    faults = PolarisFaults(silent_us=((0, 100_000),))
    line = make_polaris(Tracker(), np.random.SeedSequence(1), faults=faults)
    assert answer(line, b"INIT:E3A5\r", 0, 100_000) == b""
    assert answer(line, b"INIT:E3A5\r", 100_000) == b"OKAYA896\r"


def test_damaged_replies_differ_in_one_byte():
    line = make_polaris(Tracker(), np.random.SeedSequence(1), faults=PolarisFaults(bad_crc=1.0))
    got = answer(line, b"INIT:E3A5\r", 0)
    assert sum(a != b for a, b in zip(got, b"OKAYA896\r", strict=True)) == 1


def test_line_that_is_not_paced_has_no_rate_to_agree_on():
    line = make_polaris(Tracker(), np.random.SeedSequence(1), paced=False)
    line.set_baud(12_345)
    assert answer(line, b"INIT:E3A5\r", 0, PROCESSING_US) == b"OKAYA896\r"
