from dataclasses import replace

import numpy as np
import pytest

from ccr_host.description import schema
from ccr_host.link.messages import Fault, State, StateReport, StatusFlags
from ccr_host.run.execute import execute, reference_of
from ccr_host.run.observer import RunSetup
from ccr_host.run.options import RunOptions
from ccr_host.tools.sweep.job import LimitWatch

REPORT = StateReport(
    tick=100, state=State(0), fault=Fault(0), flags=StatusFlags(0), target_sequence=0,
    target_age_ms=0, target_cdeg=(0, 0), setpoint_cdeg=(0, 0), pulse_half_us=(3000, 3000),
    link_errors=0, free_stack_bytes=65535, supply_dv=0,
)  # fmt: skip
NARROW = ("servo.angle_max_deg=[40, 85]", "servo.pulse_min_us=[600, 1000]")


@pytest.fixture
def watch():
    options = RunOptions("8shape", "mpc", overrides=NARROW)
    made = LimitWatch()
    made.begin(RunSetup(options, schema.load(None, NARROW), reference_of(options)))
    return made


@pytest.mark.parametrize(
    "report",
    [
        REPORT,
        replace(REPORT, target_cdeg=(4000, -8500), setpoint_cdeg=(0, 0)),
        replace(REPORT, pulse_half_us=(0, 0)),
        replace(REPORT, pulse_half_us=(2 * 1944 + 1, 2000)),
    ],
)
def test_what_is_within_the_limits_passes(watch, report):
    watch.state(0, report)
    assert watch.violations == set()


@pytest.mark.parametrize(
    ("report", "what"),
    [
        (replace(REPORT, target_cdeg=(4002, 0)), "target"),
        (replace(REPORT, setpoint_cdeg=(0, -8502)), "setpoint"),
        (replace(REPORT, pulse_half_us=(2 * 1946, 3000)), "pulse"),
        (replace(REPORT, pulse_half_us=(3000, 1996)), "pulse"),
    ],
)
def test_what_is_outside_is_named(watch, report, what):
    watch.state(0, report)
    assert watch.violations == {what}


def test_a_setpoint_that_moves_faster_than_the_slew_limit_is_named(watch):
    per_tick_cdeg = 600
    watch.state(0, REPORT)
    watch.state(1, replace(REPORT, tick=103, setpoint_cdeg=(0, 3 * per_tick_cdeg)))
    assert watch.violations == set()
    watch.state(2, replace(REPORT, tick=104, setpoint_cdeg=(per_tick_cdeg + 3, 1800)))
    assert watch.violations == {"slew"}


def test_a_command_beyond_the_limits_is_named(tmp_path):
    file = tmp_path / "short.csv"
    file.write_text("t_s,y_mm,z_mm\n0,0,30\n2,10,35\n")
    watch, records = LimitWatch(), []
    options = RunOptions(str(file), "open-loop")
    execute(options, watch, lambda _step, _steps, record: records.append(record))
    assert watch.violations == set()
    watch.step(replace(records[0], q_rad=np.radians([0.0, 85.01])))
    assert watch.violations == {"command"}
