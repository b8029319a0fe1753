"""What the shell makes of the pictures of a period before a law sees them."""

import numpy as np
import pytest

from ccr_host.control.base import Observation, Picture
from ccr_host.control.shell import Law, Shell
from ccr_host.description.schema import load
from ccr_host.run.execute import reference_of
from ccr_host.run.options import RunOptions

UNSEEN = np.full((1, 3), np.nan)
PERIOD_US = 1_000_000
FRAME_US = 50_000
STEP_RAD = np.array([0.05, -0.02])


class Listening(Law):
    name = "listening"

    def start(self, path, history) -> None:
        super().start(path, history)
        self.seen = []

    def observe(self, measurement) -> None:
        self.seen.append(measurement)

    def plan(self, index, commanded_rad, time_s):
        return super().plan(index, commanded_rad + STEP_RAD, time_s)


class Bench:
    """Steps a shell at 1 Hz; the pictures of each period come from a function of their age."""

    def __init__(self) -> None:
        self.law = Listening()
        self.shell = Shell(load(None), self.law)
        self.q_rad = self.shell.start(reference_of(RunOptions(path="8shape"))).q_rad
        self.steps = 0

    def step(self, tip_of, newest: bool = True):
        self.steps += 1
        ages_us = range(1_000_000, 0, -FRAME_US)
        pictures = [Picture(tip_of(age_us), age_us, UNSEEN) for age_us in ages_us]
        time_us = self.steps * PERIOD_US
        last = pictures.pop() if newest else Picture(None, 0, UNSEEN)
        command = self.shell.step(
            Observation(
                self.steps, time_us, last.tip_mm, last.age_us, self.q_rad, UNSEEN, tuple(pictures)
            )
        )
        self.q_rad = command.q_rad
        return command


@pytest.fixture
def bench() -> Bench:
    bench = Bench()
    bench.step(lambda age_us: np.array([0.0, -100.0, 0.0]))
    return bench


def test_the_pictures_of_a_rest_are_one_measurement_which_neither_noise_nor_an_outlier_moves(
    bench: Bench,
) -> None:
    def swinging(age_us: int):
        outlier_mm = 30.0 if age_us == 200_000 else 0.0
        return np.array([1.0, -99.0, 2.0]) + 0.5 * (-1) ** (age_us // FRAME_US) + outlier_mm

    bench.step(swinging)
    seen = bench.law.seen[1:]
    assert len(seen) == 1
    assert np.abs(seen[0].tip_mm - [1.0, -99.0, 2.0]).max() <= 0.5 + 1e-9


def test_pictures_of_the_motion_do_not_count_as_the_rest_after_it(bench: Bench) -> None:
    bench.step(lambda age_us: np.array([0.0, -100.0, 40.0 if age_us > 450_000 else 0.0]))
    seen = bench.law.seen[-1]
    assert np.allclose(seen.tip_mm, [0.0, -100.0, 0.0])
    assert seen.setpoint_rad == pytest.approx(bench.q_rad - STEP_RAD)
    assert 1.55 < seen.exposed_s < 1.95
    assert seen.elapsed_s == pytest.approx(1.0)


def test_a_law_learns_from_what_was_seen_before_the_markers_were_hidden(bench: Bench) -> None:
    before = len(bench.law.seen)
    command = bench.step(lambda age_us: np.array([0.0, -100.0, 5.0]), newest=False)
    assert command.outcome.value == "coasted"
    assert len(bench.law.seen) == before + 1
    assert np.allclose(bench.law.seen[-1].tip_mm, [0.0, -100.0, 5.0])
