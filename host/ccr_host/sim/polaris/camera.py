"""Builds an emulated camera from a robot description."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ccr_host.description import simulation
from ccr_host.description.simulation import Tracker
from ccr_host.sim.polaris.device import PolarisDevice
from ccr_host.sim.polaris.faults import NO_FAULTS, PolarisFaults, Span
from ccr_host.sim.polaris.line import PolarisLine
from ccr_host.sim.polaris.sensor import PositionSensor


def faults_of(described: simulation.PolarisFaults, start_us: int | None) -> PolarisFaults:
    """Faults of a robot description.

    Args:
        described: the `polaris_faults` section.
        start_us: zero of its times; None leaves out the timed faults.
    """
    lasting = PolarisFaults(
        shuffle=described.shuffle,
        phantoms=described.phantoms,
        occlusion=described.occlusion,
        bad_crc=described.bad_crc,
    )
    if start_us is None:
        return lasting

    def spans_us(spans_s: Sequence[tuple[float, float]]) -> tuple[Span, ...]:
        return tuple((_at(start_us, begin), _at(start_us, end)) for begin, end in spans_s)

    return replace(
        lasting,
        occluded_us=spans_us(described.occluded_s),
        out_of_volume_us=spans_us(described.out_of_volume_s),
        silent_us=spans_us(described.silent_s),
        unplugged_us=spans_us(described.unplugged_s),
        resets_us=tuple(_at(start_us, time_s) for time_s in described.reset_s),
    )


def _at(start_us: int, time_s: float) -> int:
    return start_us + round(time_s * 1e6)


def change_faults(line: PolarisLine, faults: PolarisFaults, tracker: Tracker) -> None:
    """Replace the active faults; `tracker.dropout` still applies."""
    line.device.sensor.faults = _with_dropout(faults, tracker)


def make_polaris(
    tracker: Tracker,
    seed: np.random.SeedSequence,
    *,
    faults: PolarisFaults = NO_FAULTS,
    paced: bool = True,
) -> PolarisLine:
    """An emulated Vicra with the noise, faults and misalignment of a robot description's tracker.

    Its rate is the Vicra's 20 Hz; `tracker.rate_hz` is ignored. It skips exposures with the
    probability `tracker.dropout`, in addition to `faults.frozen`.

    Args:
        tracker: the `tracker` section of the robot description.
        seed: seed of noise and faults.
        faults: further faults.
        paced: False if the bytes travel over TCP.
    """
    optics_seed, line_seed = seed.spawn(2)
    sensor = PositionSensor(
        np.random.default_rng(optics_seed),
        tracker,
        faults=_with_dropout(faults, tracker),
    )
    return PolarisLine(PolarisDevice(sensor), np.random.default_rng(line_seed), paced=paced)


def _with_dropout(faults: PolarisFaults, tracker: Tracker) -> PolarisFaults:
    skipped = 1.0 - (1.0 - faults.frozen) * (1.0 - tracker.dropout)
    return replace(faults, frozen=skipped)
