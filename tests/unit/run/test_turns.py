"""A clock that skips the slices in which nothing happens leads the world to the same results."""

from __future__ import annotations

from dataclasses import dataclass, field

import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from ccr_host.core.clock import NEVER_US, VirtualClock
from ccr_host.run.execute import execute
from ccr_host.run.observer import RunObserver
from ccr_host.run.options import RunOptions
from ccr_host.sim.robot.scene import CoSimulation


@dataclass
class Station:
    """Passes messages on to its neighbour, each after a delay; notes when it was turned to what."""

    due_us: list[int]
    delays_us: list[int]
    neighbour: Station | None = None
    turns: int = 0
    noted: list[tuple[int, int]] = field(default_factory=list)

    def advance_to(self, time_us: int) -> None:
        self.turns += 1
        while self.due_us and min(self.due_us) <= time_us:
            due_us = min(self.due_us)
            self.due_us.remove(due_us)
            self.noted.append((time_us, due_us))
            if self.neighbour and self.delays_us:
                self.neighbour.due_us.append(due_us + self.delays_us.pop())

    @property
    def next_turn_us(self) -> int:
        return min(self.due_us, default=NEVER_US)


class Blind:
    """Can be turned to at any time, so the clock has to try every slice."""

    def __init__(self) -> None:
        self.seen_us: list[int] = []

    def advance_to(self, time_us: int) -> None:
        self.seen_us.append(time_us)


times_us = st.lists(st.integers(0, 60_000), max_size=8)


@given(times_us, times_us, times_us, times_us)
@example([1000, 2001], [0], [], [10_000])
def test_messages_are_seen_at_the_same_times_whether_or_not_empty_slices_are_skipped(
    first_us: list[int], second_us: list[int], delays_us: list[int], waits_us: list[int]
) -> None:
    def run(*others: Blind) -> tuple[Station, Station, list[int]]:
        clock, first = VirtualClock(), Station(list(first_us), list(delays_us))
        second = Station(list(second_us), list(delays_us), neighbour=first)
        first.neighbour = second
        for part in (first, second, *others):
            clock.attach(part)
        woke_us = []
        for wait_us in waits_us:
            clock.sleep_until_us(clock.now_us() + wait_us)
            woke_us.append(clock.now_us())
        return first, second, woke_us

    sliced, jumped = run(Blind()), run()
    assert [part.noted for part in jumped[:2]] == [part.noted for part in sliced[:2]]
    assert jumped[2] == sliced[2]
    happened = sum(len(part.noted) for part in jumped[:2])
    assert jumped[0].turns <= happened + len(waits_us)


def test_a_part_that_foresees_nothing_keeps_all_slices_for_all() -> None:
    clock, blind, idle = VirtualClock(), Blind(), Station([], [])
    clock.attach(idle)
    clock.attach(blind)
    clock.sleep_until_us(3500)
    assert blind.seen_us == [1000, 2000, 3000, 3500]
    assert idle.turns == 4


def test_turns_come_at_slices_counted_from_the_beginning_of_the_wait() -> None:
    clock, part = VirtualClock(), Station([2100, 9000], [])
    clock.attach(part)
    clock.sleep_until_us(300)
    clock.sleep_until_us(8700)
    clock.sleep_until_us(9500)
    assert part.noted == [(2300, 2100), (9500, 9000)]


class Witness(RunObserver):
    """Keeps all that a log would."""

    def __init__(self) -> None:
        self.seen: list[object] = []

    def frame(self, direction: str, time_us: int, data: bytes) -> None:
        self.seen.append((direction, time_us, data))

    def state(self, time_us: int, report: object) -> None:
        self.seen.append((time_us, report))

    def tracker_sample(self, time_us: int, sample) -> None:
        self.seen.append((time_us, sample.exposed_us, sample.markers_mm.tobytes()))

    def marker_frame(self, time_us: int, frame) -> None:
        self.seen.append((time_us, frame.exposed_us, frame.frame_number, frame.points_mm.tobytes()))

    def event(self, time_us: int, text: str) -> None:
        self.seen.append((time_us, text))

    def phase(self, time_us: int, phase: object) -> None:
        self.seen.append((time_us, phase))

    def inputs(self, piece: object) -> None:
        self.seen.append(piece)


class Onlooker:
    """Somebody who could stop the run at any time, and does not."""

    wants_stop = False
    wants_pause = False

    def news(self) -> str:
        return ""


@pytest.fixture
def turns(monkeypatch: pytest.MonkeyPatch) -> list[int]:
    """Times at which the simulated world was moved along."""
    seen_us: list[int] = []
    advance_to = CoSimulation.advance_to

    def counted(world: CoSimulation, time_us: int) -> None:
        seen_us.append(time_us)
        advance_to(world, time_us)

    monkeypatch.setattr(CoSimulation, "advance_to", counted)
    return seen_us


@pytest.mark.long
@pytest.mark.parametrize(
    ("tracker", "rate_hz", "overrides"),
    [
        ("twin:", 1.0, ()),
        ("twin:", 20.0, ("tracker.rate_hz=33", "tracker.latency_ms=17.3", "tracker.dropout=0.2")),
        ("twin:", 7.0, ("tracker.rate_hz=120", "tracker.latency_ms=0")),
        ("ndi-emulator:", 1.0, ("polaris_faults.bad_crc=0.2",)),
        (
            "ndi-emulator:",
            5.0,
            ("control.hold_s=9", "polaris_faults={unplugged_s=[[0.5, 0.7]], reset_s=[2]}"),
        ),
    ],
)
def test_a_run_shows_the_same_to_the_microsecond_when_every_slice_is_tried(
    tmp_path, turns: list[int], tracker: str, rate_hz: float, overrides: tuple[str, ...]
) -> None:
    path = tmp_path / "short.csv"
    rows = "".join(f"{t},{5 * t},-100\n" for t in range(4))
    path.write_text("t_s,y_mm,z_mm\n" + rows)
    options = RunOptions(
        path=str(path),
        controller="mpc",
        tracker=tracker,
        rate_hz=rate_hz,
        overrides=overrides,
        seed=3,
    )

    def run(operator: Onlooker | None) -> tuple[Witness, object, int]:
        turns.clear()
        witness = Witness()
        result = execute(options, witness, lambda *_: None, operator)
        assert result.failure is None
        return witness, result.link, len(turns)

    jumped, sliced = run(None), run(Onlooker())
    assert jumped[0].seen == sliced[0].seen
    assert jumped[1] == sliced[1]
    assert jumped[2] < sliced[2] / 2
