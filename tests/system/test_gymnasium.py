"""The environments behave as Gymnasium's own checker wants, on any robot."""

from typing import Any

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env

import ccr_host
import ccr_host.tools.gym

TASKS = ("ccr_host/Reach-v0", "ccr_host/Track-v0")
LONGER = ("robot.segment_lengths_mm=[60, 45]", "servo.angle_max_deg=[60, 70]")
STILL = np.zeros(2, np.float32)

gymnasium.register_envs(ccr_host.tools.gym)


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize(
    ("task", "kwargs"), [(TASKS[0], {"randomise": True}), (TASKS[1], {"path": "star"})]
)
def test_gymnasiums_checker_accepts_it(task: str, kwargs: dict[str, Any]) -> None:
    check_env(gymnasium.make(task, **kwargs).unwrapped, skip_render_check=True)


def test_environments_step_side_by_side_each_with_its_own_robot() -> None:
    envs = gymnasium.make_vec(TASKS[0], num_envs=2, randomise=True)
    first, _ = envs.reset(seed=1)
    again, _ = envs.reset(seed=1)
    assert np.array_equal(first, again)
    assert not np.allclose(first[0], first[1])
    _, reward, *_ = envs.step(np.zeros((2, 2), np.float32))
    assert reward.shape == (2,)
    assert (reward < 0).all()
    envs.close()


def test_an_action_moves_the_motors_to_that_share_of_their_range_on_any_robot() -> None:
    env = gymnasium.make(TASKS[0], overrides=LONGER)
    env.reset(seed=1)
    for _ in range(20):
        seen, *_ = env.step(np.array([1.0, -1.0], np.float32))
    assert seen[-3:-1] == pytest.approx([1.0, -1.0], abs=1e-3)
    servo = env.unwrapped.description.servo
    assert servo.angle_max_deg == (60, 70)
    assert np.linalg.norm(seen[:3]) < 1.2, "in lengths of this robot"
    env.close()


def test_targets_of_reach_lie_on_the_surface_of_the_robot() -> None:
    env = gymnasium.make(TASKS[0], overrides=LONGER)
    goals_mm = [env.reset(seed=seed)[1]["target_mm"] for seed in range(3)]
    nearest = env.unwrapped._workspace.nearest(np.array(goals_mm)[:, [0, 2]])
    assert nearest.distance_mm == pytest.approx(0, abs=1e-6)
    assert len(np.unique(np.round(goals_mm), axis=0)) == 3
    env.close()


def test_track_shows_where_the_path_goes_and_ends_with_it(tmp_path) -> None:
    path = tmp_path / "line.csv"
    path.write_text("t_s,y_mm,z_mm\n0,0,0\n0.5,10,5\n")
    env = gymnasium.make(TASKS[1], path=str(path), rate_hz=10)
    seen, info = env.reset(seed=1)
    length_mm = sum(env.unwrapped.description.robot.segment_lengths_mm)
    assert seen[6:9] * length_mm == pytest.approx(info["target_mm"], abs=1e-3)
    ends = []
    while not any(ends):
        ahead = seen[9:12] * length_mm
        seen, _, has_failed, is_over, info = env.step(STILL)
        ends.append(is_over)
        assert not has_failed
        if not is_over:
            assert seen[6:9] * length_mm == pytest.approx(ahead, abs=1e-3)
    assert len(ends) == 6
    env.close()


def test_markers_that_stay_lost_terminate_the_episode(monkeypatch: pytest.MonkeyPatch) -> None:
    env = gymnasium.make(TASKS[0], overrides=("control.coast_s=0.1", "control.hold_s=0.1"))
    env.reset(seed=1)
    monkeypatch.setattr(env.unwrapped._rig.tracker, "arrived", list)
    for _ in range(20):
        *_, has_failed, _, info = env.step(STILL)
        if has_failed:
            break
    assert "no markers" in info["fault"]
    env.close()


def test_an_impossible_rate_is_refused() -> None:
    with pytest.raises(ccr_host.ConfigError, match="rate_hz = 200"):
        gymnasium.make(TASKS[0], rate_hz=200)
