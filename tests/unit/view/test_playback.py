import math

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from ccr_host.view.page import Playback
from ccr_host.view.palette import error_colours, error_full_scale_mm


def test_playing_follows_time_and_speed_and_ends_at_the_end() -> None:
    playback = Playback(end_us=10.0)
    playback.advance(5)
    assert playback.at_us == 0, "it waits for the button"
    playback.press_play()
    playback.speed = 0.5
    playback.advance(4)
    assert playback.at_us == 2
    playback.speed = 10.0
    playback.advance(4)
    assert playback.at_us == 10
    assert not playback.playing
    playback.press_play()
    assert playback.at_us == 0, "and begins again"


@given(st.lists(st.floats(-1e9, 1e9), max_size=20))
def test_no_seek_leaves_the_run(seeks: list[float]) -> None:
    playback = Playback(end_us=1e6)
    for at_us in seeks:
        playback.seek(at_us)
        assert 0 <= playback.at_us <= 1e6


@given(st.lists(st.floats(0, 1e4), min_size=1))
def test_the_error_scale_is_round_and_covers_all_but_a_few(errors: list[float]) -> None:
    full_scale = error_full_scale_mm(np.array([*errors, np.nan]))
    assert math.isclose(float(f"{full_scale:.1e}"), full_scale)
    assert full_scale >= np.quantile(errors, 0.95) * (1 - 1e-9)


def test_the_error_scale_grows_darker_all_the_way() -> None:
    brightness = error_colours(np.linspace(0, 2, 50), 1.0).astype(float) @ (0.299, 0.587, 0.114)
    assert (np.diff(brightness) <= 0.5).all()
    assert brightness[-1] == brightness[25]
