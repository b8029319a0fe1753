"""How the core handles frames on a line that flips bits, and drops and doubles bytes."""

from pathlib import Path

import pytest

from tests.firmware.native_core.conftest import TESTS, Build, core_sources, run

FRAMES = 1_000_000
LONG_FRAMES = 200_000_000
NOISE = 1e-3

PREDICTED_PAST_CRC = (5.5e-7 + 3.0e-6 + 9.5e-7) / 3
"""Share of frames with one flip, drop or doubling, a third each, that pass CRC-16/X-25 unseen
(protocol reference, "Why CRC-16/X-25")."""
PREDICTED_MANIFOLD = 2.0**-16
"""Share of frames with several errors that pass."""
FRAME_BYTES = 16
"""A `set_target` on the wire."""
_DAMAGED = 1 - (1 - 3 * NOISE) ** FRAME_BYTES
_DAMAGED_ONCE = FRAME_BYTES * 3 * NOISE * (1 - 3 * NOISE) ** (FRAME_BYTES - 1)
SHARE_MANIFOLD = 1 - _DAMAGED_ONCE / _DAMAGED
"""Share of the damaged frames."""


@pytest.fixture(scope="module")
def line_noise(build: Build) -> Path:
    source = TESTS / "line_noise" / "line_noise.cpp"
    return build("g++", ["-O2"], [source, *core_sources()])


def test_no_damaged_command_is_obeyed_and_the_next_frame_is_understood(line_noise: Path) -> None:
    _check(line_noise, FRAMES)


@pytest.mark.slow
def test_the_same_holds_for_many_more_frames(line_noise: Path) -> None:
    _check(line_noise, LONG_FRAMES)


def _check(program: Path, frames: int) -> None:
    report = run(program, str(frames), "1", str(NOISE))
    count = {name: int(value) for name, value in map(str.split, report.splitlines())}
    assert count["frames"] == frames
    assert count["damaged"] == pytest.approx(_DAMAGED * frames, rel=0.02)
    # With the exact length of each id no single damage passes.
    assert count["bad_commands_accepted"] <= _upper_bound(
        count["damaged"] * SHARE_MANIFOLD * PREDICTED_MANIFOLD
    )
    assert count["bad_frames_past_crc"] <= _upper_bound(
        count["damaged"] * (PREDICTED_PAST_CRC + SHARE_MANIFOLD * PREDICTED_MANIFOLD)
    )
    # A frame is lost without being damaged only where the zero before it was.
    assert 0 < count["clean_lost"] < 0.003 * frames
    assert count["clean_lost_unexplained"] == 0


def _upper_bound(expected: float) -> float:
    """Upper limit of a Poisson count, exceeded once in a million trials."""
    return expected + 5 * expected**0.5 + 2
