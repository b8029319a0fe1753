import os
import pty

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ccr_host.core.errors import ConfigError
from ccr_host.description.schema import Servo
from ccr_host.robot.workspace import MotorLimits
from ccr_host.tools.jog import (
    CLEAR,
    DOWN,
    ESCAPE,
    LEFT,
    QUIT,
    RIGHT,
    STEPS_DEG,
    STOP,
    UP,
    JogTarget,
    Keyboard,
    split_keys,
)

LIMITS = MotorLimits.of(Servo(angle_min_deg=(-30.0, -5.0), angle_max_deg=(20.0, 40.0)))
MOVES = {UP: (1, 0), DOWN: (-1, 0), RIGHT: (0, 1), LEFT: (0, -1)}
KEYS = (*MOVES, "+", "-", "0", "x", " ", "c", ESCAPE)


def target() -> JogTarget:
    return JogTarget(np.zeros(2), LIMITS, np.zeros(2))


@given(st.lists(st.sampled_from(KEYS), max_size=200))
def test_no_sequence_of_keys_leaves_the_limits(keys: list[str]) -> None:
    now = target()
    for key in keys:
        now = now.after(key)
        assert np.all(now.q_rad >= LIMITS.lower_rad)
        assert np.all(now.q_rad <= LIMITS.upper_rad)
        assert now.step_deg in STEPS_DEG


@pytest.mark.parametrize("key", MOVES)
def test_an_arrow_moves_its_motor_by_one_step(key: str) -> None:
    moved = target().after(key)
    np.testing.assert_allclose(np.degrees(moved.q_rad), MOVES[key])
    finer = target().after("-").after(key)
    np.testing.assert_allclose(np.degrees(finer.q_rad), 0.5 * np.array(MOVES[key]))


def test_zero_moves_back_to_rest_and_keeps_the_step() -> None:
    there = target().after("+").after(UP).after(RIGHT)
    back = there.after("0")
    np.testing.assert_array_equal(back.q_rad, np.zeros(2))
    assert back.step_deg == there.step_deg


@pytest.mark.parametrize("motors", [1, 4, 9, 12])
def test_a_digit_chooses_the_motors_that_the_arrows_move(motors: int) -> None:
    limits = MotorLimits(np.full(motors, -1.0), np.full(motors, 1.0))
    now = JogTarget(np.zeros(motors), limits, np.zeros(motors))
    for pair in range(-(-motors // 2)):
        now = now.after(str(pair + 1)).after(UP).after(LEFT)
    step_rad = np.radians(now.step_deg)
    wanted = np.where(np.arange(motors) % 2 == 0, step_rad, -step_rad)
    np.testing.assert_allclose(now.q_rad, wanted)
    assert now.after("9") == now
    shown = dict(now.help)
    assert shown["up, down"] == f"motor {2 * pair + 1}"
    assert ("right, left" in shown) == (motors % 2 == 0)


def test_only_its_keys_stop_clear_and_leave() -> None:
    assert STOP.intersection(KEYS) == {" ", ESCAPE}
    assert CLEAR.intersection(KEYS) == {"c"}
    assert not QUIT.intersection(KEYS)
    assert {"q"} == QUIT


@given(st.lists(st.sampled_from([*MOVES, "a", "+", " ", "\x1b[3~", "ü"]), max_size=30))
def test_keys_pressed_quickly_are_distinguished(keys: list[str]) -> None:
    assert split_keys("".join(keys)) == keys


def test_arrows_of_a_terminal_in_application_mode_are_arrows() -> None:
    assert split_keys("\x1bOA\x1bOD") == [UP, LEFT]


def test_a_lone_escape_is_a_key() -> None:
    assert split_keys(ESCAPE) == [ESCAPE]


def test_a_pipe_is_not_a_keyboard(tmp_path) -> None:
    with (tmp_path / "pipe").open("w") as pipe, pytest.raises(ConfigError, match="terminal"):
        Keyboard(pipe)


def test_a_terminal_that_goes_away_ends_like_ctrl_c() -> None:
    master, slave = pty.openpty()
    with os.fdopen(slave) as stream, Keyboard(stream) as keyboard:
        assert keyboard.pressed() == []
        os.close(master)
        with pytest.raises(KeyboardInterrupt):
            keyboard.pressed()
