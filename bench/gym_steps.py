"""Environment steps per second of CPU, ours beside gym-softrobot's: python -m bench.gym_steps.

gym-softrobot (MIT, 0.3.0) simulates Cosserat rods; install it in the same environment, or its rows
are left out.
"""

import importlib
import time

import gymnasium

import ccr_host.tools.gym

gymnasium.register_envs(ccr_host.tools.gym)
SECONDS = 5.0
OURS = ("ccr_host/Reach-v0", "ccr_host/Track-v0")
THEIRS = ("TendonArmReach-v1",)


def steps_per_second(name: str) -> tuple[float, float]:
    """Steps, and simulated seconds, per second of CPU, resets included, under random actions."""
    env = gymnasium.make(name, disable_env_checker=True)
    env.reset(seed=1)
    env.action_space.seed(1)
    env.step(env.action_space.sample())
    start_s, steps, is_over = time.process_time(), 0, False
    while time.process_time() - start_s < SECONDS:
        if is_over:
            env.reset()
        _, _, failed, over, _ = env.step(env.action_space.sample())
        is_over, steps = failed or over, steps + 1
    rate = steps / (time.process_time() - start_s)
    theirs = env.unwrapped
    period_s = 0.05 if name in OURS else theirs.time_step * theirs.simulation_steps_per_action
    env.close()
    return rate, rate * period_s


if __name__ == "__main__":
    names = list(OURS)
    try:
        importlib.import_module("gym_softrobot")
        names += THEIRS
    except ImportError as error:
        print(f"gym-softrobot is not there: {error}")
    for name in names:
        rate, simulated = steps_per_second(name)
        print(f"{name}: {rate:.1f} steps/s, {simulated:.2f} simulated s/s")
