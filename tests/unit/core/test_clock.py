import pytest
from hypothesis import given
from hypothesis import strategies as st

from ccr_host.core.clock import LaggingClock, RealClock, VirtualClock


class Follower:
    def __init__(self) -> None:
        self.seen_us: list[int] = []

    def advance_to(self, time_us: int) -> None:
        self.seen_us.append(time_us)


@given(st.lists(st.integers(0, 100_000), max_size=20))
def test_virtual_time_never_goes_back_and_ends_at_the_latest_wish(wishes: list[int]) -> None:
    clock = VirtualClock()
    follower = Follower()
    clock.attach(follower)
    for wish in wishes:
        before = clock.now_us()
        clock.sleep_until_us(wish)
        assert clock.now_us() == max(before, wish)
    assert follower.seen_us == sorted(follower.seen_us)
    assert follower.seen_us[-1:] == ([max(wishes)] if any(wishes) else [])


def test_virtual_clock_moves_its_parts_in_slices_so_that_none_runs_far_ahead() -> None:
    clock = VirtualClock()
    first, second = Follower(), Follower()
    clock.attach(first)
    clock.attach(second)
    clock.sleep_until_us(10_500)
    assert first.seen_us == second.seen_us
    assert max(b - a for a, b in zip([0, *first.seen_us], first.seen_us, strict=False)) <= 1000


def test_real_clock_keeps_its_parts_near_the_wall_clock_while_it_waits() -> None:
    clock = RealClock()
    follower = Follower()
    clock.attach(follower)
    clock.sleep_until_us(20_000)
    assert clock.now_us() >= 20_000
    assert len(follower.seen_us) >= 2
    assert follower.seen_us[-1] <= clock.now_us()


@pytest.mark.parametrize("clock", [VirtualClock(), RealClock()])
def test_waiting_for_a_moment_that_has_passed_returns_at_once(clock: VirtualClock) -> None:
    clock.sleep_until_us(1000)
    now = clock.now_us()
    clock.sleep_until_us(0)
    assert clock.now_us() - now < 1_000_000


def test_a_lagging_clock_skips_the_time_it_missed(monkeypatch: pytest.MonkeyPatch) -> None:
    wall_ns = 0
    monkeypatch.setattr("ccr_host.core.clock._elapsed_ns", lambda: wall_ns)
    clock = LaggingClock()
    wall_ns = 5_000_000
    assert clock.now_us() == 5_000
    wall_ns += 10_000_000_000
    assert 5_000 < clock.now_us() < 100_000
