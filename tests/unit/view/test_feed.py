import numpy as np

from ccr_host.control.base import Outcome, Phase
from ccr_host.run.observer import StepRecord
from ccr_host.view.feed import Batch, ViewFeed, play
from ccr_host.view.history import RunHistory


class Mailbox:
    def __init__(self) -> None:
        self.batches: list[Batch] = []
        self.has_room = True

    def put(self, batch: Batch) -> bool:
        if self.has_room:
            self.batches.append(batch)
        return self.has_room


def step_record(step: int, end_us: int) -> StepRecord:
    here = np.zeros(3)
    return StepRecord(
        step, end_us, end_us * 1e-6, here, np.zeros(2), Outcome.SOLVED, "", here[None], 1.0, False,
        here, 0, here,
    )  # fmt: skip


def test_frames_travel_in_batches_and_events_at_once() -> None:
    box = Mailbox()
    feed = ViewFeed(box.put, realtime=True)
    for time_us in range(0, 100_000, 1000):
        feed.frame("sent", time_us, b"")
    assert len(box.batches) == 2
    feed.event(100_000, "arming")
    assert [item[0] for item in box.batches[-1].items][-1] == "event"
    assert sum(len(batch.items) for batch in box.batches) == 101, "nothing lost, nothing twice"


def test_a_page_that_lags_costs_updates_but_neither_memory_nor_order() -> None:
    box = Mailbox()
    feed = ViewFeed(box.put, realtime=True)
    feed.event(0, "first")
    box.has_room = False
    for time_us in range(0, 10_000_000, 1000):
        feed.frame("sent", time_us, b"")
    box.has_room = True
    feed.event(10_000_000, "last")
    assert len(box.batches) == 2
    assert box.batches[-1].dropped_batches > 200
    assert len(box.batches[-1].items) < 100


def test_steps_of_a_fast_controller_are_thinned_out() -> None:
    box = Mailbox()
    feed = ViewFeed(box.put, realtime=True)
    for step in range(1000):
        feed.step(step_record(step, step * 1000))
    feed.event(1_000_000, "end")
    assert sum(item[0] == "step" for batch in box.batches for item in batch.items) == 200


def test_what_was_handed_on_can_be_played_to_an_observer() -> None:
    box = Mailbox()
    feed = ViewFeed(box.put, realtime=False)
    feed.step(step_record(0, 1_000_000))
    feed.phase(1_500_000, Phase("disarming"))
    history = RunHistory()
    for batch in box.batches:
        play(batch.items, history)
    moment = history.at(2e6)
    assert moment.phase == Phase("disarming")
    assert moment.record is not None
    assert moment.record.step == 0
