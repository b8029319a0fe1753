"""Plan of a sweep: its twins, and the rates and controllers to run on each of them."""

from __future__ import annotations

import json
import shlex
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from ccr_host.control.registry import make_controller
from ccr_host.core.errors import ConfigError
from ccr_host.core.user_file import lines_of, read_text
from ccr_host.description import schema
from ccr_host.robot.paths import sample_path
from ccr_host.run.options import RunOptions
from ccr_host.sim.robot.plant import TWIN
from ccr_host.sim.robot.scene import make_plant
from ccr_host.tools.sweep.random_twin import Settings, as_overrides, draw_twin

_MOST_BYTES = 64_000_000
_DURATION_RATE_HZ = 10.0
"""Rate for finding the duration of a path, the same at every control rate so that twins agree."""

Drive = tuple[float, str]
"""Control rate in Hz, and controller."""


@dataclass(frozen=True)
class TwinJob:
    """One twin on one path, with some rates and controllers; small and picklable."""

    index: int
    base: RunOptions
    """Options of its runs but for rate and controller; the twin's overrides follow the sweep's."""
    drives: tuple[Drive, ...]

    def options(self, drive: Drive) -> RunOptions:
        rate_hz, controller = drive
        return replace(self.base, rate_hz=rate_hz, controller=controller)

    def command(self, drive: Drive) -> str:
        """Command line that exactly repeats one of its runs."""
        rate_hz, controller = drive
        run = self.base
        robot = ["--robot", run.robot] if run.robot else []
        robot += ["--plant", run.plant] if run.plant != TWIN else []
        sets = [word for override in run.overrides for word in ("--set", override)]
        words = ["--controller", controller, "--rate", f"{rate_hz:g}", "--seed", str(run.seed)]
        words.append("--unchecked")
        return shlex.join(["ccr-host", "track", run.path, *words, *robot, *sets])


class GivenTwin(NamedTuple):
    """A twin that is given, not drawn."""

    settings: Settings
    where: str = "a given twin"
    """File and line, for messages."""


@dataclass(frozen=True)
class SweepPlan:
    """Definition of a sweep's twins, without their number, rates and controllers.

    Twin number ``index`` depends on ``seed`` and ``index`` alone; the paths alternate.
    """

    seed: int
    paths: tuple[str, ...]
    robot: str | None = None
    overrides: tuple[str, ...] = ()
    twins: tuple[GivenTwin, ...] | None = None
    """Given twins; None for random ones."""
    plant: str = TWIN
    """Simulated robot created from each twin."""

    def jobs(self, indices: Sequence[int], drives: Sequence[Drive]) -> list[TwinJob]:
        """One job per twin.

        Raises:
            ConfigError: the description, a path, a rate, a controller, a plant or a given twin is
                invalid.
            CodeError: a plug-in cannot be constructed.
        """
        base = schema.load(self.robot, self.overrides)
        for name in {controller for _, controller in drives}:
            make_controller(name, base)
        if self.plant != TWIN:
            make_plant(self.plant, base)
        length_mm = sum(segment.length_mm for segment in base.robot.chain)
        durations_s = {}
        for path in self.paths:
            for rate_hz in {rate_hz for rate_hz, _ in drives}:
                sample_path(path, rate_hz, length_mm)
            sampled = sample_path(path, _DURATION_RATE_HZ, length_mm)
            durations_s[path] = float(sampled.time_s[-1])
        return [self._job(index, tuple(drives), base, durations_s) for index in indices]

    def as_json(self) -> dict[str, Any]:
        """JSON object of everything that determines the runs of an index."""
        return {
            "seed": self.seed,
            "paths": list(self.paths),
            "description": schema.load(self.robot, self.overrides).model_dump(mode="json"),
            "twins": None if self.twins is None else [twin.settings for twin in self.twins],
            "plant": self.plant,
        }

    def _job(
        self,
        index: int,
        drives: tuple[Drive, ...],
        base: schema.Description,
        durations_s: Mapping[str, float],
    ) -> TwinJob:
        twin_seed, run_seed = np.random.SeedSequence(self.seed, spawn_key=(index,)).spawn(2)
        path = self.paths[index % len(self.paths)]
        if self.twins is None:
            drawn = draw_twin(np.random.default_rng(twin_seed), base, durations_s[path])
            settings, where = drawn, f"twin {index}"
        else:
            settings, where = self.twins[index]
        overrides = self.overrides + as_overrides(settings)
        try:
            schema.load(self.robot, overrides)
        except ConfigError as error:
            raise ConfigError(f"{where}: {error.cause}", error.cure) from error
        seed = int(run_seed.generate_state(1)[0])
        run = RunOptions(
            path=path, robot=self.robot, overrides=overrides, plant=self.plant, seed=seed
        )
        return TwinJob(index, run, drives)


def read_twins(file: Path) -> tuple[GivenTwin, ...]:
    """Read the user's twins: one JSON object with dotted keys per line.

    Raises:
        ConfigError: the file cannot be read, or a line is not such an object, or names a key twice.
    """
    text, _ = read_text(file, "--twins", "give a file of JSON lines", _MOST_BYTES)
    lines = [(f"--twins {file}, line {n}", line) for n, line in enumerate(lines_of(text), 1)]
    twins = tuple(GivenTwin(_settings(where, line), where) for where, line in lines if line.strip())
    if not twins:
        raise ConfigError(f"--twins {file}: empty", "give one JSON object per line")
    return twins


def _settings(where: str, line: str) -> Settings:
    def once(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
        found = {key.strip(): value for key, value in pairs}
        if len(found) < len(pairs):
            keys = [key.strip() for key, _ in pairs]
            twice = next(key for key in keys if keys.count(key) > 1)
            raise ConfigError(f"{where}: {twice} stands there twice", "keep one of them")
        return found

    try:
        settings = json.loads(line, object_pairs_hook=once)
    except (ValueError, RecursionError):
        settings = None
    if not isinstance(settings, dict):
        raise ConfigError(
            f"{where}: not a JSON object",
            'write e.g. {"twin.slack_mm": 0.8, "tracker.latency_ms": 60}',
        )
    return settings
