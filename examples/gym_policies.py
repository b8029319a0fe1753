"""Gymnasium: a random policy and a PID policy reach for a point; pip install "ccr-host[gym]"."""

import gymnasium
import numpy as np

import ccr_host.tools.gym
from ccr_host.robot.kinematics import ConstantCurvature

gymnasium.register_envs(ccr_host.tools.gym)
KP, KI, KD = 0.1, 2.0, 0.01


class Pid:
    """PID on the error of the tip, turned into steps of the motors by the inverse Jacobian."""

    def __init__(self, env: gymnasium.Env, rate_hz: float = 20.0) -> None:
        description = env.unwrapped.description
        servo = description.servo
        self._low = np.radians(servo.angle_min_deg)
        self._span = np.radians(servo.angle_max_deg) - self._low
        self._model = ConstantCurvature(description.robot)
        self._length_mm = sum(description.robot.segment_lengths_mm)
        self._period_s = 1.0 / rate_hz
        self._errors_mm = None

    def __call__(self, seen: np.ndarray) -> np.ndarray:
        tip_mm, target_mm = self._length_mm * seen[:3], self._length_mm * seen[6:9]
        q_rad = self._low + self._span * (seen[-3:-1] + 1.0) / 2.0
        new = target_mm - tip_mm
        last, before = self._errors_mm or (new, new)
        self._errors_mm = new, last
        step_mm = (
            KP * (new - last)
            + KI * self._period_s * new
            + KD / self._period_s * (new - 2.0 * last + before)
        )
        jacobian = self._model.jacobian_mm_rad(q_rad)
        q_rad = q_rad + np.linalg.pinv(jacobian, rcond=0.1) @ step_mm
        return np.clip(2.0 * (q_rad - self._low) / self._span - 1.0, -1.0, 1.0)


def final_error_mm(env: gymnasium.Env, seed: int, *, is_random: bool) -> float:
    """Run one episode; the true distance from the target at its end."""
    seen, info = env.reset(seed=seed)
    env.action_space.seed(seed)
    policy, is_over = Pid(env), False
    while not is_over:
        action = env.action_space.sample() if is_random else policy(seen)
        seen, _, has_failed, time_is_over, info = env.step(action.astype(np.float32))
        is_over = has_failed or time_is_over
    return info["error_mm"]


if __name__ == "__main__":
    env = gymnasium.make("ccr_host/Reach-v0", randomise=True)
    for name, is_random in (("random", True), ("pid", False)):
        errors_mm = [final_error_mm(env, seed, is_random=is_random) for seed in range(3)]
        print(f"{name}: {np.median(errors_mm):.1f} mm from the target after five seconds")
    env.close()
