import numpy as np
import pytest

from ccr_host.control.adaptive.estimator import Estimator, LapMemory
from ccr_host.control.adaptive.model import PLAIN
from ccr_host.control.adaptive.parameters import Scaling
from ccr_host.description.schema import Robot

STEPS = 80
PHASE = 2.0 * np.pi * np.arange(STEPS) / STEPS


def _slow(phase):
    """A disturbance as a static model leaves it: waves of some ten steps and longer, in mm."""
    return np.stack([0.4 * np.sin(phase), 0.3 * np.cos(3.0 * phase), np.full_like(phase, 0.2)], -1)


def _lap(memory, number, disturbance, slope=1.0, trust=1.0):
    """One lap; the memory's correction moves the tip ``slope`` times as far as modelled."""
    for step, disturbance_mm in enumerate(disturbance):
        index = float(number * STEPS + step)
        memory.turn(index)
        unexplained_mm = disturbance_mm + (1.0 - slope) * memory.at(index)
        memory.note(index, unexplained_mm, trust)


def _learnt(memory, laps):
    memory.turn(float(laps * STEPS))
    return np.array([memory.at(float(laps * STEPS + step)) for step in range(STEPS)])


def _run(disturbance, laps, slope=1.0, trust=1.0):
    memory = LapMemory(STEPS, 1.0)
    for lap in range(laps):
        _lap(memory, lap, disturbance, slope, trust)
    return _learnt(memory, laps)


def test_nothing_is_corrected_in_the_first_lap():
    memory = LapMemory(STEPS, 1.0)
    for step in range(STEPS):
        assert memory.turn(float(step)) is None
        memory.note(float(step), np.ones(3), 1.0)
        assert not memory.at(float(step) + 3.5).any()


@pytest.mark.parametrize("slope", [0.5, 1.0, 1.8])
def test_what_repeats_is_learnt_even_from_a_model_with_a_wrong_slope(slope):
    left = [
        np.abs(slope * _run(_slow(PHASE), laps, slope) - _slow(PHASE)).max() for laps in (1, 4, 20)
    ]
    assert left[2] < left[1] < left[0]
    assert left[2] < 0.05


def test_learning_shifts_nothing_along_the_path():
    learnt, wave = _run(_slow(PHASE), 30)[:, 0], np.exp(1j * PHASE)
    assert np.angle(learnt @ wave) == pytest.approx(np.angle(_slow(PHASE)[:, 0] @ wave), abs=1e-9)


def test_swings_of_the_structure_are_not_learnt():
    period_s = 0.05
    phase = 2.0 * np.pi * 5.0 * period_s * np.arange(STEPS)
    memory = LapMemory(STEPS, period_s)
    for lap in range(10):
        _lap(memory, lap, np.sin(phase)[:, None] * np.ones(3))
    assert np.abs(_learnt(memory, 10)).max() < 1e-3


def test_markers_mixed_up_once_teach_little():
    disturbance = np.zeros((STEPS, 3))
    disturbance[40] = (300.0, 0.0, 0.0)
    assert np.abs(_run(disturbance, 1)).max() < 0.5


def test_steps_without_measurements_keep_what_was_learnt():
    memory = LapMemory(STEPS, 1.0)
    _lap(memory, 0, _slow(PHASE))
    before = _learnt(memory, 1)
    memory.turn(2.0 * STEPS)
    assert _learnt(memory, 2) == pytest.approx(before)


def test_handing_over_to_the_memory_leaves_the_command_as_it_was():
    estimator = Estimator(PLAIN, Scaling(Robot()), None)
    memory = LapMemory(STEPS, 1.0)
    _lap(memory, 0, _slow(PHASE))
    index = float(STEPS) + 0.4
    before_mm = estimator.offset_mm + memory.at(index)
    gained_mm = memory.turn(index)
    assert gained_mm is not None
    assert gained_mm.any()
    estimator.hand_over(gained_mm)
    assert estimator.offset_mm + memory.at(index) == pytest.approx(before_mm)
