"""Gymnasium environments on the simulated robot: ``ccr_host/Reach-v0`` and ``ccr_host/Track-v0``.

An action reaches the robot as a controller's command does: board, servos, tendons and camera with
their delays are in between. Importing this module makes both names known to Gymnasium, whose
``make("ccr_host.tools.gym:ccr_host/Reach-v0")`` does so by itself.
"""

from __future__ import annotations

import weakref
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ccr_host.core.arrays import Array
from ccr_host.core.errors import ConfigError, DeviceError, TrackerError
from ccr_host.core.plugins import import_optional
from ccr_host.robot.workspace import MotorLimits
from ccr_host.run.execute import reference_of, workspace_of
from ccr_host.run.marker_watch import MarkerWatch
from ccr_host.run.observer import Observers
from ccr_host.run.open_rig import open_rig
from ccr_host.run.options import RunOptions
from ccr_host.run.rest_motion import move_to
from ccr_host.run.summary import LATERAL
from ccr_host.sim.robot.mechanics import UnfitTwinError
from ccr_host.sim.robot.plant import TWIN
from ccr_host.tools.sweep.random_twin import as_overrides, draw_twin

gymnasium: Any = import_optional("gymnasium", "gym", "ccr_host.tools.gym")


_EPISODE_S = 5.0
_PREVIEW = 3
"""Points of the path that an observation shows beyond the present one."""
_BOUND = 2.0
"""No coordinate exceeds one robot's length by this factor, the marker offset included."""
_LEAST_RATE_HZ, _GREATEST_RATE_HZ = 1.0, 50.0
_VALIDITY_MS = 2000
"""Two of the longest periods."""
_ATTEMPTS_TO_DRAW = 20


class RobotEnv(gymnasium.Env):
    """Common part of both tasks.

    - Action, (motors,), -1 .. 1: motor angles, from the lower to the upper limit of each servo.
      The board moves there within the period, as fast as ``servo.slew_deg_s`` allows.
    - Observation, float32: measured tip (3) and ends of the other segments (3 each), targets (3
      each), in lengths of the robot; the accepted action (motors); the age of the measurement in s.
      The axes are those of f in (10).
    - Reward: minus the distance of the true tip from the target, in lengths of the robot. A step
      is rewarded for the target of the observation before it.
    - ``info``: ``error_mm`` (true), ``tip_mm`` (measured), ``target_mm``, ``time_s``.
    - Terminated: the board has latched a fault, or the markers are lost; ``info["fault"]`` says
      which. Truncated: the time is over.

    Args:
        robot: description file, or the name of a shipped one.
        overrides: ``section.key=value``, as with ``--set``.
        plant: simulated robot, as with ``--plant``.
        rate_hz: steps per second.
        randomise: draw another twin and camera at each reset, as ``ccr-host sweep`` does; the
            robot's geometry stays as described, so that the targets stay on its surface.

    Raises:
        ConfigError: unusable description or rate.
    """

    def __init__(
        self,
        *,
        robot: str | Path | None = None,
        overrides: tuple[str, ...] = (),
        plant: str = TWIN,
        rate_hz: float = 20.0,
        randomise: bool = False,
        path: str = "8shape",
        targets: int = 1,
    ) -> None:
        if not _LEAST_RATE_HZ <= rate_hz <= _GREATEST_RATE_HZ:
            raise ConfigError(
                f"rate_hz = {rate_hz:g}: not in {_LEAST_RATE_HZ:g}..{_GREATEST_RATE_HZ:g}",
                "servos take 50 pulses a second",
            )
        self._base = RunOptions(
            robot=None if robot is None else str(robot),
            overrides=tuple(overrides),
            plant=plant,
            path=path,
            rate_hz=rate_hz,
            seed=0,
        )
        self.description = self._base.description()
        """The robot description with its overrides applied; randomisation is not in it."""
        self._randomise = randomise
        self._targets = targets
        self._period_us = round(1e6 / rate_hz)
        self._limits = MotorLimits.of(self.description.servo)
        segments = self.description.robot.chain
        self._length_mm = float(sum(segment.length_mm for segment in segments))
        self._markers_mm = np.zeros((len(segments) + 1, 3))
        motors = len(self._limits.lower_rad)
        self.action_space = gymnasium.spaces.Box(-1.0, 1.0, (motors,), np.float32)
        size = 3 * len(segments) + 3 * targets + motors + 1
        self.observation_space = gymnasium.spaces.Box(-_BOUND, _BOUND, (size,), np.float32)
        self._rig_stack = ExitStack()
        weakref.finalize(self, self._rig_stack.close)

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[NDArray[np.float32], dict[str, Any]]:
        """Start with a new robot at rest, led to ``start_rad`` of the task."""
        super().reset(seed=seed)
        self.close()
        start_rad = self._begin_task()
        for _ in range(_ATTEMPTS_TO_DRAW):
            try:
                self._connect()
                break
            except UnfitTwinError:
                self.close()
        else:
            raise ConfigError("no drawn twin can be simulated", "change the description")
        move_to(self._rig, self._rig.client.accepted_rad, start_rad)
        self._step = 0
        self._start_us = self._rig.clock.now_us()
        self._rig.start_path_clock(self._start_us)
        self._watch = MarkerWatch(self._rig, self._twin, self._period_us, None)
        self._watch.wait_for_markers()
        self._watch.start()
        self._markers_mm = np.zeros_like(self._markers_mm)
        return self._observation(), self._info()

    def step(
        self, action: NDArray[np.float32]
    ) -> tuple[NDArray[np.float32], float, bool, bool, dict[str, Any]]:
        """Command the motors, let a period pass, measure."""
        share = (np.clip(np.asarray(action, dtype=np.float64), -1.0, 1.0) + 1.0) / 2.0
        low, high = self._limits.lower_rad, self._limits.upper_rad
        fault = ""
        try:
            self._rig.client.set_target(
                low + share * (high - low),
                ramp_ms=self._period_us // 1000,
                validity_ms=_VALIDITY_MS,
            )
            self._rig.clock.sleep_until_us(self._start_us + (self._step + 1) * self._period_us)
            self._watch.look(self._rig.clock.now_us())
        except (DeviceError, TrackerError) as error:
            fault = str(error)
        info = self._info()
        reward = -info["error_mm"] / self._length_mm
        self._step += 1
        return (
            self._observation(),
            reward,
            bool(fault),
            self._is_over(),
            {**info, "fault": fault} if fault else info,
        )

    def close(self) -> None:
        """Disarm and disconnect; no effect before the first reset."""
        self._rig_stack.close()

    def _begin_task(self) -> Array:
        """Choose the task of this episode; the motor angles to start from, (motors,), rad."""
        raise NotImplementedError

    def _target_mm(self, step: int) -> Array:
        """Desired tip at the end of a step, (3,)."""
        raise NotImplementedError

    def _is_over(self) -> bool:
        raise NotImplementedError

    def _connect(self) -> None:
        overrides = self._base.overrides
        if self._randomise:
            drawn = draw_twin(self.np_random, self.description, _EPISODE_S)
            kept = {key: value for key, value in drawn.items() if not key.startswith("robot.")}
            overrides += as_overrides(kept)
        seed = int(self.np_random.integers(2**31))
        options = RunOptions(**{**vars(self._base), "overrides": overrides, "seed": seed})
        self._twin = options.description()
        self._rig = self._rig_stack.enter_context(open_rig(options, self._twin, Observers()))
        self._rig.client.arm()

    def _observation(self) -> NDArray[np.float32]:
        sample = self._rig.tracker.newest()
        age_s = 0.0
        if sample is not None:
            seen = np.isfinite(sample.markers_mm)
            self._markers_mm = np.where(seen, sample.markers_mm, self._markers_mm)
            age_s = (self._rig.clock.now_us() - sample.exposed_us) * 1e-6
        targets = [self._target_mm(self._step + ahead) for ahead in range(self._targets)]
        others_mm = self._markers_mm[1:-1] - self._markers_mm[0]
        positions_mm = np.concatenate([self._tip_mm(), *others_mm, *targets])
        low, high = self._limits.lower_rad, self._limits.upper_rad
        accepted = 2.0 * (self._rig.client.accepted_rad - low) / (high - low) - 1.0
        flat = np.concatenate([positions_mm / self._length_mm, accepted, [age_s]])
        shown: NDArray[np.float32] = np.clip(flat, -_BOUND, _BOUND).astype(np.float32)
        return shown

    def _info(self) -> dict[str, Any]:
        target_mm = self._target_mm(self._step)
        true_mm = self._rig.true_tip_mm()
        reached_mm = self._tip_mm() if true_mm is None else true_mm
        return {
            "error_mm": float(np.linalg.norm(reached_mm - target_mm)),
            "tip_mm": self._tip_mm(),
            "target_mm": target_mm.copy(),
            "time_s": (self._rig.clock.now_us() - self._start_us) * 1e-6,
        }

    def _tip_mm(self) -> Array:
        tip_mm: Array = self._markers_mm[-1] - self._markers_mm[0]
        return tip_mm


class ReachEnv(RobotEnv):
    """Move the tip to a point on the robot's surface, drawn at each reset; five seconds."""

    def __init__(self, **common: Any) -> None:  # noqa: ANN401 - those of RobotEnv
        super().__init__(**common)
        self._workspace = workspace_of(self._base)

    def _begin_task(self) -> Array:
        low, high = self._limits.lower_rad, self._limits.upper_rad
        model = self._workspace.model
        drawn_mm = model.tip_mm(self.np_random.uniform(low, high))
        self._goal_mm = model.tip_mm(self._workspace.nearest(drawn_mm[None, LATERAL]).q_rad[0])
        return np.clip(np.zeros(len(low)), low, high)

    def _target_mm(self, step: int) -> Array:
        return self._goal_mm

    def _is_over(self) -> bool:
        return self._step * self._period_us >= _EPISODE_S * 1e6


class TrackEnv(RobotEnv):
    """Follow a path from its first point to its last; four targets show where it goes.

    Args:
        path: ellipse, 8shape, star, or a file.
        common: see `RobotEnv`.
    """

    def __init__(self, *, path: str = "8shape", **common: Any) -> None:  # noqa: ANN401
        super().__init__(path=path, targets=1 + _PREVIEW, **common)
        self._reference = reference_of(self._base)

    def _begin_task(self) -> Array:
        start_rad: Array = self._reference.q_rad[0]
        return start_rad

    def _target_mm(self, step: int) -> Array:
        target_mm: Array = self._reference.target_mm[min(step, len(self._reference) - 1)]
        return target_mm

    def _is_over(self) -> bool:
        return self._step >= len(self._reference)


for _task in ("Reach", "Track"):
    gymnasium.register(f"ccr_host/{_task}-v0", entry_point=f"{__name__}:{_task}Env")
