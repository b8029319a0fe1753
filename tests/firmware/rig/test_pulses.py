"""Servo pulses measured at the pins, to the cycle."""

from itertools import pairwise

from ccr_host.link.messages import ResetCause

FRAME_CYCLES = 320_000
FRAME_US = 20_000


def collect(uno):
    edges, pulses = [], []
    uno.observe_edges(edges.append)
    uno.observe_pulses(pulses.append)
    return edges, pulses


def start(board, exchange, commands=b"ab"):
    uno = board("servo")
    edges, pulses = collect(uno)
    uno.advance_to(1000)
    exchange(uno, commands)
    return uno, edges, pulses


def test_compare_values_after_the_first_are_taken(board, exchange):
    uno, _, pulses = start(board, exchange)
    seen = []
    for counts in (3000, 2000, 4000, 3001):
        exchange(uno, b"A" + (counts - 1).to_bytes(2, "little"))
        uno.advance_to(uno.now_us + 2 * FRAME_US)
        seen.append(uno.pulses_half_us[0])
    assert seen == [3000, 2000, 4000, 3001]
    assert {p.width_cycles % 8 for p in pulses} == {0}


def test_compare_value_is_latched_at_the_start_of_the_next_frame_only(board, exchange):
    uno, _, pulses = start(board, exchange)
    uno.advance_to(FRAME_US + 500)  # in the middle of a pulse of 1500 us
    uno.receive(b"A" + (4000 - 1).to_bytes(2, "little"))
    uno.advance_to(3 * FRAME_US)
    assert [p.half_us for p in pulses if p.pin == 0] == [3000, 4000]


def test_frames_have_no_jitter_while_the_link_is_saturated(board, exchange):
    uno, edges, _ = start(board, exchange)
    uno.receive(b"p" * 10_000)
    uno.advance_to(400_000)
    rises = [e.cycle for e in edges if e.level and e.pin == 0]
    assert {b - a for a, b in pairwise(rises)} == {FRAME_CYCLES}


def test_port_writes_make_no_edges(board, exchange):
    uno, edges, _ = start(board, exchange, commands=b"")
    exchange(uno, b"pppp")
    assert edges == []


def test_output_shows_only_when_connected_and_driven(board, exchange):
    uno, edges, _ = start(board, exchange, commands=b"")
    uno.advance_to(3 * FRAME_US)
    assert edges == []  # not connected
    exchange(uno, b"aib")
    uno.advance_to(6 * FRAME_US)
    assert edges == []  # not driven
    exchange(uno, b"o")
    uno.advance_to(8 * FRAME_US)
    assert {e.pin for e in edges} == {0, 1}


def test_connecting_between_two_pulses_starts_with_a_complete_one(board, exchange):
    uno, edges, pulses = start(board, exchange, commands=b"")
    uno.advance_to(18_000)
    exchange(uno, b"ab")
    uno.advance_to(2 * FRAME_US)
    assert [p.half_us for p in pulses] == [2000, 3000]
    assert edges[0].cycle // 16 >= FRAME_US


def test_missing_pulses_are_reported_once(board, exchange):
    uno, _, pulses = start(board, exchange, commands=b"a")
    uno.advance_to(3 * FRAME_US - 2000)
    exchange(uno, b"x", wait_us=10_000)
    assert uno.pulses_half_us[0] == 3000
    for _ in range(10):
        uno.advance_to(uno.now_us + 10_000)
    assert [p.half_us for p in pulses] == [3000, 3000, 0]
    assert uno.pulses_half_us == (0, 0)


def test_reset_cuts_the_pulse_at_once(board, exchange):
    uno, edges, _ = start(board, exchange, commands=b"a")
    uno.advance_to(FRAME_US + 500)
    assert edges[-1].level
    uno.reset(ResetCause.EXTERNAL)
    uno.advance_to(FRAME_US + 501)
    assert not edges[-1].level
    assert edges[-1].cycle // 16 == FRAME_US + 500


def test_compare_value_at_the_top_is_constantly_high(board, exchange):
    uno, edges, _ = start(board, exchange, commands=b"a")
    exchange(uno, b"A" + (39_999).to_bytes(2, "little"))
    uno.advance_to(5 * FRAME_US)
    assert [e.level for e in edges] == [True]
