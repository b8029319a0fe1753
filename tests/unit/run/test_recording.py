"""The tape beside the rest of the log."""

from __future__ import annotations

import numpy as np

from ccr_host.run.observer import RunObserver
from ccr_host.run.recording import RecordedTracker, Tape, TapePiece, Token
from ccr_host.tracking.tracker import Sample


class Log(RunObserver):
    """Keeps the order in which things were written."""

    def __init__(self) -> None:
        self.written: list[object] = []

    def tracker_sample(self, time_us: int, sample: Sample) -> None:
        self.written.append(sample)

    def inputs(self, piece: TapePiece) -> None:
        self.written.append(piece)


class Camera:
    """Has one sample."""

    name = "camera"

    def __init__(self, sample: Sample) -> None:
        self.sample = sample

    def newest(self) -> Sample:
        return self.sample

    def trouble(self) -> str:
        return ""


def test_a_sample_is_in_the_log_before_the_piece_of_tape_that_tells_of_it() -> None:
    """A log that is cut between the two could not be replayed."""
    log = Log()
    after_a_stall = Sample(250_000, np.zeros((3, 3)))
    RecordedTracker(Camera(after_a_stall), Tape(log.inputs), log).advance_to(300_000)
    sample, piece = log.written
    assert sample is after_a_stall
    assert isinstance(piece, TapePiece)
    assert piece.tokens == Token.SAMPLE
