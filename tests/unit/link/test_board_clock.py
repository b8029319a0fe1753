"""Offset and drift of the board's clock, against clocks whose truth is known."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ccr_host.link.board import BoardClock

SECOND_US = 1_000_000
DAY_US = 24 * 3600 * SECOND_US
SYNC_US = 10 * SECOND_US


@dataclass
class Crystal:
    """A board whose clock goes wrong by a share."""

    drift: float
    offset_us: float = 3_000_000.0

    def board_us(self, host_us: float) -> int:
        return int(host_us * (1.0 + self.drift) + self.offset_us)

    def true_offset_us(self, host_us: float) -> float:
        return host_us * self.drift + self.offset_us


def exchange(
    clock: BoardClock, crystal: Crystal, sent_us: int, there_us: int, back_us: int
) -> None:
    board_us = crystal.board_us(sent_us + there_us)
    clock.add(sent_us, sent_us + there_us + back_us, board_us % 2**32)


def error_us(clock: BoardClock, crystal: Crystal, host_us: int) -> float:
    """Wraps before the first exchange are not known to anybody."""
    away = clock.offset_us(host_us) - crystal.true_offset_us(host_us)
    return (away + 2**31) % 2**32 - 2**31


def delays(rng: np.random.Generator) -> Iterator[tuple[int, int]]:
    """There and back: mostly a millisecond, some a hundred times as slow, never alike."""
    while True:
        there, back = rng.exponential(700.0, 2) + 300.0
        slow = rng.random(2) < 0.05
        yield int(there * (100 if slow[0] else 1)), int(back * (100 if slow[1] else 1))


@pytest.mark.long
@pytest.mark.parametrize("drift", [100e-6, -100e-6, 0.005])
def test_offset_stays_right_through_a_day_of_a_crystal_that_is_off(drift):
    clock, crystal = BoardClock(), Crystal(drift)
    ways = delays(np.random.default_rng(1))
    for sent_us in range(0, DAY_US, SYNC_US):
        exchange(clock, crystal, sent_us, *next(ways))
        later_us = sent_us + SYNC_US
        assert abs(error_us(clock, crystal, later_us)) <= clock.uncertainty_us(later_us) + 1
        if sent_us > 1800 * SECOND_US:
            assert clock.uncertainty_us(later_us) < 2_000
            assert clock.drift == pytest.approx(drift, abs=10e-6)


def test_a_crystal_that_warms_up_is_followed():
    clock, crystal = BoardClock(), Crystal(20e-6)
    ways = delays(np.random.default_rng(2))
    for sent_us in range(0, 3600 * SECOND_US, SYNC_US):
        drift = crystal.drift + 20e-6 * SYNC_US / (3600 * SECOND_US)
        crystal.offset_us += sent_us * (crystal.drift - drift)  # the offset itself does not jump
        crystal.drift = drift
        exchange(clock, crystal, sent_us, *next(ways))
        assert abs(error_us(clock, crystal, sent_us)) <= clock.uncertainty_us(sent_us) + 20
    assert clock.drift == pytest.approx(40e-6, abs=10e-6)


@pytest.mark.parametrize(("there_us", "back_us"), [(200, 16_000), (16_000, 200)])
def test_a_way_that_is_always_slower_costs_half_of_it_and_no_drift(there_us, back_us):
    clock, crystal = BoardClock(), Crystal(100e-6)
    for sent_us in range(0, 3600 * SECOND_US, SYNC_US):
        exchange(clock, crystal, sent_us, there_us, back_us)
    assert abs(error_us(clock, crystal, sent_us)) <= 8_100
    assert clock.drift == pytest.approx(100e-6, abs=1e-6)


def test_a_board_that_was_reset_is_related_again_by_the_next_exchange():
    clock, crystal = BoardClock(), Crystal(100e-6)
    ways = delays(np.random.default_rng(3))
    for sent_us in range(0, 3600 * SECOND_US, SYNC_US):
        exchange(clock, crystal, sent_us, *next(ways))
    restarted = Crystal(100e-6, offset_us=-3600.0 * SECOND_US)
    exchange(clock, restarted, 3600 * SECOND_US + SYNC_US, 500, 500)
    now_us = 3600 * SECOND_US + 2 * SYNC_US
    assert abs(error_us(clock, restarted, now_us)) <= clock.uncertainty_us(now_us) + 1
    assert clock.offset_us(now_us) < 0


@given(
    offset_us=st.integers(-(2**31), 2**34),
    exchanges=st.lists(
        st.tuples(st.integers(0, 2**31), st.integers(0, 20_000), st.floats(0, 1)),
        min_size=1,
        max_size=20,
    ),
)
def test_offset_is_right_to_its_uncertainty_however_the_delays_are_shared(offset_us, exchanges):
    clock, crystal = BoardClock(), Crystal(0.0, float(offset_us))
    now_us = 10**6
    for gap_us, round_trip_us, share in exchanges:
        now_us += gap_us
        there_us = int(share * round_trip_us)
        exchange(clock, crystal, now_us, there_us, round_trip_us - there_us)
        now_us += round_trip_us
    assert abs(error_us(clock, crystal, now_us)) <= clock.uncertainty_us(now_us) + 1


def test_nothing_is_known_before_the_first_exchange():
    assert BoardClock().offset_us(0) is None
    assert BoardClock().uncertainty_us(0) is None
