"""Measured robots as judge: OpenCR v4 and v6, three spatial segments of three tendons.

Only where the measurements are present; see `tests.measured`.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from ccr_host.description.schema import Segment, Tendon
from ccr_host.tools.chain_fit import ChainModel, fit_chain
from ccr_host.tools.identify import Residual
from ccr_host.tools.measured import Measured, home_of, read_measured, sweeps_of
from tests.measured import measured

pytestmark = pytest.mark.long

LENGTHS_MM = {"v4": (60.0, 62.5, 64.0), "v6": (100.0, 100.0, 22.0)}
FILES = {name: measured(f"opencr_{name}_quasistatic.csv") for name in LENGTHS_MM}
OWN_SIMULATOR_MM = 7.7
"""Held-out RMSE of that project's own simulator after identification."""


def at_work(file: Path) -> Measured:
    """Without the phase in which all tendons but one are paid out by 10 mm."""
    recording = read_measured(file)
    return recording.kept(np.char.find(recording.pattern, "_pull") < 0)


def as_built(lengths_mm: tuple[float, ...]) -> tuple[Segment, ...]:
    """Three tendons each, turned by 30 deg from segment to segment."""
    return tuple(
        Segment(
            length_mm=length_mm,
            tendon_radius_mm=4.5,
            tendons=tuple(
                Tendon(angle_deg=30.0 * place + turn, motor=3 * place + number)
                for number, turn in enumerate((0.0, 120.0, -120.0), 1)
            ),
        )
        for place, length_mm in enumerate(lengths_mm)
    )


def held_out(name: str, recording: Measured) -> Residual:
    """Motion in one bending plane, fitted in the first half of the time, judged in the second."""
    model = ChainModel(as_built(LENGTHS_MM[name]), recording.command)
    rows = np.arange(len(recording.time_s))
    rows = rows[model.in_one_plane(rows)]
    time_s = recording.time_s[rows]
    first = time_s < 0.5 * (time_s[0] + time_s[-1])
    tip_mm, judged = recording.tip_mm[:, None], rows[~first]
    fit = fit_chain(model, tip_mm, rows[first])
    return Residual.of(fit.predicted_mm(judged) - tip_mm[judged])


if FILES["v4"] is not None:
    V4 = FILES["v4"]

    @pytest.mark.parametrize(
        ("segment", "tip_mm", "travel_mm"), [(1, 4.5, 0.14), (2, 3.7, 0.16), (3, 3.1, 0.30)]
    )
    def test_hysteresis_of_v4_is_that_of_its_own_evaluation(segment, tip_mm, travel_mm):
        sweeps = [s for s in sweeps_of(at_work(V4)) if f"_seg{segment}_" in s.pattern]
        assert np.mean([s.tip_mm for s in sweeps]) == pytest.approx(tip_mm, rel=0.1)
        assert np.mean([s.command for s in sweeps]) == pytest.approx(travel_mm, rel=0.15)

    def test_v4_is_predicted_better_than_by_its_own_simulator_and_than_it_repeats():
        recording = at_work(V4)
        home = home_of(recording)
        assert home is not None
        assert home.rms_mm == pytest.approx(6.5, rel=0.1)
        assert held_out("v4", recording).rmse_mm < min(OWN_SIMULATOR_MM, home.rms_mm)


if FILES["v6"] is not None:
    V6 = FILES["v6"]

    def test_v6_is_predicted_to_twice_what_it_repeats():
        recording = at_work(V6)
        home = home_of(recording)
        assert home is not None
        assert home.rms_mm == pytest.approx(5.4, rel=0.1)
        assert held_out("v6", recording).rmse_mm < 2.0 * home.rms_mm
