"""Whatever lies within a description's bounds is run or refused; nothing of it crashes."""

from __future__ import annotations

import json
import math

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from ccr_host.core.errors import CcrError, ConfigError
from ccr_host.run.execute import execute_quietly
from ccr_host.run.options import RunOptions
from ccr_host.run.summary import summarise
from tests.unit.description.keys import KEYS, overrides, values

SLOW = {"twin.flexures", "twin.time_step_ms", "twin.tendon_stiffness_n_m", "control.settle_s"}
"""At their bounds a few seconds take minutes to simulate."""
RUN = sorted(
    key for key in KEYS if key.split(".")[0] in ("robot", "servo", "link", "control", "twin")
)
QUICK = [key for key in RUN if key not in SLOW]


@pytest.fixture(scope="module")
def path(tmp_path_factory: pytest.TempPathFactory) -> str:
    file = tmp_path_factory.mktemp("path") / "short.csv"
    file.write_text("t_s,y_mm,z_mm\n0,0,30\n2,10,35\n")
    return str(file)


def assert_run_or_refused(path: str, controller: str, sets: list[str]) -> None:
    options = RunOptions(path=path, controller=controller, overrides=tuple(sets))
    try:
        result = execute_quietly(options)
    except ConfigError as refused:
        assert refused.cause
        assert refused.cure
        return
    if result.failure is None:
        assert len(result.records) == 3
        summary = summarise(result, twin_floor_mm=None)
        json.dumps(summary, allow_nan=False)
        assert math.isfinite(summary["mean_error_mm"])
    else:
        assert isinstance(result.failure, CcrError)


@pytest.mark.long
@given(
    st.sampled_from(["open-loop", "mpc", "pid-ik"]),
    st.lists(st.sampled_from(QUICK), min_size=1, max_size=3, unique=True).flatmap(
        lambda keys: st.fixed_dictionaries({key: values(KEYS[key]) for key in keys})
    ),
)
@settings(
    max_examples=15,
    deadline=None,
    suppress_health_check=[HealthCheck.function_scoped_fixture, HealthCheck.too_slow],
)
def test_any_few_keys_within_their_bounds(
    path: str, controller: str, chosen: dict[str, list[float]]
) -> None:
    assert_run_or_refused(path, controller, overrides(chosen))


@pytest.mark.slow
@pytest.mark.parametrize("controller", ["mpc", "adaptive"])
@pytest.mark.parametrize("end", ["least", "greatest"])
@pytest.mark.parametrize("key", RUN)
def test_every_key_at_its_bounds(path: str, key: str, end: str, controller: str) -> None:
    chosen = {key: [getattr(number, end) for number in KEYS[key].numbers]}
    assert_run_or_refused(path, controller, overrides(chosen))


@pytest.mark.long
def test_a_marker_on_the_backbone_is_a_robot_too(path: str) -> None:
    overrides = ("robot.marker_offset_mm=0", "control.solver=compiled")
    options = RunOptions(path=path, overrides=overrides)
    assert execute_quietly(options).failure is None
