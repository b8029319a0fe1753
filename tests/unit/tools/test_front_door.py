"""The robot as programs use it: ``import ccr_host``."""

import json
import math
import os
import signal
import subprocess
import sys
from functools import partial

import numpy as np
import pytest

import ccr_host
from ccr_host.commands import app
from ccr_host.control.base import Command, Outcome
from ccr_host.sim.robot.robot import TwinRobot

QUICK = ("control.settle_s=0.1", "link.arm_axis_ms=20", "link.relax_after_ms=60000")


@pytest.fixture
def short_path(tmp_path):
    file = tmp_path / "short.csv"
    file.write_text("t_s,y_mm,z_mm\n0,0,30\n2,0,35\n")
    return file


class Watched(TwinRobot):
    """The twin, recording the pulses that it receives."""

    pulses: list

    def __init__(self, description):
        super().__init__(description.twin)
        type(self).pulses = []

    def set_pulses_half_us(self, pulses_half_us):
        super().set_pulses_half_us(pulses_half_us)
        self.pulses.append(pulses_half_us)


def opened(**options):
    return ccr_host.open_robot(**{"plant": Watched, "overrides": QUICK, **options})


DEVICES = pytest.mark.parametrize(
    "options",
    [{}, {"device": "emulator+pty:"}, {"realtime": True}, {"tracker": "ndi-emulator:"}],
    ids=str,
)


@pytest.mark.long
@DEVICES
def test_nothing_is_armed_until_asked_and_the_robot_goes_where_it_is_sent(options):
    with opened(**options) as robot:
        robot.tip_mm()
        assert not np.any(Watched.pulses)
        robot.arm()
        robot.move([0, 0])
        hanging_mm = robot.tip_mm()
        robot.move([10, -20])
        assert robot.angles_deg == pytest.approx([10, -20], abs=0.01)
        neutral_us = np.array(robot.description.servo.neutral_pulse_us)
        turned_us = np.array(robot.description.servo.pulse_per_90_deg_us) * [10 / 90, -20 / 90]
        assert Watched.pulses[-1] == pytest.approx(2 * (neutral_us + turned_us), abs=1)
        assert np.linalg.norm(robot.tip_mm() - hanging_mm) > 20
        robot.disarm()
        assert Watched.pulses[-1] == (0, 0)


@pytest.mark.long
@DEVICES
@pytest.mark.parametrize("error", [ZeroDivisionError, KeyboardInterrupt, SystemExit])
def test_however_the_block_is_left_the_robot_is_disarmed(options, error):
    with pytest.raises(error), opened(**options) as robot:
        robot.arm()
        robot.move([5, 5], settle_s=0.0)
        assert np.all(Watched.pulses[-1])
        raise error
    assert Watched.pulses[-1] == (0, 0)
    with pytest.raises(ccr_host.DeviceError, match="connection is closed"):
        robot.move([0, 0])


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_a_signal_disarms_it_and_leaves_the_programs_own_handlers(number):
    before = {n: signal.getsignal(n) for n in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)}
    with pytest.raises(KeyboardInterrupt), opened() as robot:
        robot.arm()
        os.kill(os.getpid(), number)
        robot.wait(60)
    assert Watched.pulses[-1] == (0, 0)
    assert {n: signal.getsignal(n) for n in before} == before


@pytest.mark.parametrize(
    ("asked", "told"),
    [
        ([86, 0], "motor 1: 86 deg is outside its limits -85 .. 85"),
        ([0, -86], "motor 2: -86 deg"),
        ([0], "not 2 finite angles"),
        ([0, 0, 0], "not 2 finite angles"),
        ([math.nan, 0], "not 2 finite angles"),
        ("left", "not 2 finite angles"),
        ([10**400, 0], "not 2 finite angles"),
        (None, "not 2 finite angles"),
    ],
)
def test_a_pose_that_cannot_be_is_refused_and_nothing_moves(asked, told):
    with opened() as robot:
        robot.arm()
        pulses = list(Watched.pulses)
        with pytest.raises(ccr_host.ConfigError, match=told):
            robot.move(asked)
        assert Watched.pulses == pulses


def test_an_unarmed_robot_does_not_move():
    with opened() as robot:
        for act in (lambda: robot.move([0, 0]), lambda: robot.angles_deg):
            with pytest.raises(ccr_host.DeviceError, match="not armed"):
                act()
        robot.disarm()


def test_an_emergency_stop_holds_until_it_is_cleared():
    with opened() as robot:
        robot.arm()
        robot.stop()
        robot.wait(0.1)
        assert Watched.pulses[-1] == (0, 0)
        with pytest.raises(ccr_host.DeviceError, match="stopped"):
            robot.arm()
        robot.clear_fault()
        robot.arm()
        robot.move([1, 1])


def test_an_armed_robot_keeps_its_pose_while_it_waits():
    with opened() as robot:
        robot.arm()
        robot.move([10, 10])
        robot.wait(10)
        assert np.all(Watched.pulses[-1])
        robot.move([-10, 10])


def test_a_robot_without_markers_has_no_tip():
    old = pytest.raises(ccr_host.TrackerError, match="no markers from twin:")
    with opened(overrides=(*QUICK, "tracker.latency_ms=1000")) as robot, old:
        robot.tip_mm()


class Mine:
    def __init__(self, description):
        self.steps = 0

    def start(self, reference):
        return Command(reference.q_rad[0], np.zeros((0, 3)), Outcome.SOLVED)

    def step(self, observation):
        self.steps += 1
        return Command(observation.q_rad, np.zeros((0, 3)), Outcome.SOLVED)


@pytest.mark.long
def test_a_run_is_the_same_as_the_commands_and_is_read_back(short_path, tmp_path, capsys):
    with ccr_host.open_robot(seed=3, overrides=QUICK) as robot:
        robot.arm()
        robot.move([3, 4])
        run = robot.track(short_path, controller="mpc", rate_hz=5, out=tmp_path / "mine")
        robot.arm()
    words = ["track", str(short_path), "--controller", "mpc", "--rate", "5", "--seed", "3"]
    sets = [word for override in QUICK for word in ("--set", override)]
    app.run([*words, *sets, "--json", "--out", str(tmp_path / "commands")])
    told = json.loads(capsys.readouterr().out)
    timed = {"solve_us", "wall_s"}
    assert told.keys() == run.summary.keys()
    assert {k: told[k] for k in told if k not in timed} == {
        k: v for k, v in run.summary.items() if k not in timed
    }
    mine, commands = (tmp_path / name / "log_0000.mcap" for name in ("mine", "commands"))
    assert mine.read_bytes() == commands.read_bytes()
    loaded = ccr_host.load_run(run.folder)
    assert loaded.summary == run.summary
    assert loaded.steps["step"].tolist() == list(range(11))
    assert loaded.steps["error_mm"].mean() == pytest.approx(run.summary["mean_error_mm"])


@pytest.mark.long
@pytest.mark.parametrize(
    "controller", [Mine, partial(Mine), Mine(None)], ids=["class", "function", "object"]
)
def test_a_controller_may_be_a_class_a_function_or_an_object(short_path, tmp_path, controller):
    seen = []

    class Onlooker(ccr_host.RunObserver):
        def step(self, record):
            seen.append(record.step)

    with opened() as robot:
        run = robot.track(
            short_path, controller, rate_hz=5, unchecked=True, out=tmp_path / "out",
            observers=[Onlooker()],
        )  # fmt: skip
    assert seen == list(range(11))
    assert run.summary["steps"] == 11
    assert run.summary["twin_floor_mean_error_mm"] is None
    assert Watched.pulses[-1] == (0, 0)


@pytest.mark.long
def test_a_run_that_ends_early_raises_and_keeps_what_was_reached(short_path, tmp_path):
    class Failing(Mine):
        def step(self, observation):
            return (
                1 / (3 - observation.step) if observation.step == 3 else super().step(observation)
            )

    with opened() as robot, pytest.raises(ccr_host.CodeError, match="ZeroDivision") as failed:
        robot.track(short_path, Failing, rate_hz=5, unchecked=True, out=tmp_path / "out")
    assert any("run.json" in note for note in failed.value.__notes__)
    run = ccr_host.load_run(tmp_path / "out")
    assert run.steps["step"].tolist() == [0, 1, 2]
    assert run.table("events")["text"].size
    with pytest.raises(ccr_host.ConfigError, match="no table"):
        run.table("step")


@pytest.mark.long
def test_an_interrupted_run_disarms_first_and_keeps_what_was_reached(short_path, tmp_path):
    class Interrupting(ccr_host.RunObserver):
        def step(self, record):
            if record.step == 3:
                os.kill(os.getpid(), signal.SIGTERM)

    out = tmp_path / "out"
    with opened() as robot, pytest.raises(KeyboardInterrupt):
        robot.track(
            short_path, Mine, rate_hz=5, unchecked=True, out=out, observers=[Interrupting()]
        )
    assert Watched.pulses[-1] == (0, 0)
    assert ccr_host.load_run(out).steps["step"].tolist() == [0, 1, 2, 3]


@pytest.mark.long
def test_a_table_has_nan_for_missing_numbers(short_path, tmp_path):
    with opened(overrides=(*QUICK, "tracker.dropout=0.9")) as robot:
        run = robot.track(short_path, Mine, rate_hz=10, unchecked=True, out=tmp_path / "out")
    lost = np.isnan(run.steps["error_mm"])
    assert 0 < lost.sum() < len(lost)
    assert np.isnan(run.steps["measured_age_us"][lost]).all()


def test_what_is_not_a_run_is_rejected(tmp_path):
    for folder in (tmp_path, tmp_path / "gone", None, 3, ["runs"], b"runs", "a\0b"):
        with pytest.raises(ccr_host.ConfigError):
            ccr_host.load_run(folder)


def test_bad_options_are_refused_before_anything_starts(short_path, tmp_path):
    for options in ({"device": "emulater:"}, {"robot": "gone.toml"}, {"plant": "gone.py:Mine"}):
        with pytest.raises(ccr_host.ConfigError), opened(**options):
            raise AssertionError("it was opened")
    with opened() as robot, pytest.raises(ccr_host.ConfigError, match="unknown controller"):
        robot.track(short_path, "gone", out=tmp_path / "out")
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    "option",
    [
        {"device": None},
        {"robot": 3},
        {"seed": "1"},
        {"seed": 1.5},
        {"seed": True},
        {"overrides": 3},
        {"overrides": [3]},
        {"overrides": "twin.slack_mm=1"},
    ],
)
def test_options_of_another_kind_are_refused_by_name(option):
    (name,) = option
    with pytest.raises(ccr_host.ConfigError, match=f"^{name} = .*: n") as refused, opened(**option):
        raise AssertionError("it was opened")
    assert refused.value.cure


def test_arguments_of_another_kind_leave_the_robot_where_it_is(short_path, tmp_path):
    with opened() as robot:
        robot.arm()
        pulses = list(Watched.pulses)
        for name, value in (("rate_hz", "1"), ("laps", 1.5), ("out", 3), ("path", None)):
            with pytest.raises(ccr_host.ConfigError, match=f"{name} = "):
                robot.track(**{"path": short_path, "out": tmp_path / "out", name: value})
        for seconds in (-1, math.nan, math.inf, "1", None):
            with pytest.raises(ccr_host.ConfigError, match="duration_s = "):
                robot.wait(seconds)
            with pytest.raises(ccr_host.ConfigError, match="settle_s = "):
                robot.move([0, 0], settle_s=seconds)
        assert Watched.pulses == pulses
    assert not (tmp_path / "out").exists()


def test_the_import_is_quick_and_names_what_it_has():
    told = subprocess.run(
        [sys.executable, "-c", "import sys, ccr_host; print(*sys.modules)"],
        capture_output=True, text=True, check=True,
    ).stdout.split()  # fmt: skip
    assert "ccr_host" in told
    assert not {"numpy", "mujoco", "scipy", "pydantic", "typer"} & set(told)
    assert set(dir(ccr_host)) == set(ccr_host.__all__)
    assert all(getattr(ccr_host, name) for name in ccr_host.__all__)
    with pytest.raises(AttributeError, match="opne_robot"):
        _ = ccr_host.opne_robot


def test_a_run_that_cannot_be_published_is_refused_and_leaves_no_folder(short_path, tmp_path):
    out = tmp_path / "run"
    refused = pytest.raises(ccr_host.ConfigError, match="igtl://:18944")
    with ccr_host.open_robot(overrides=QUICK) as robot, refused:
        robot.track(short_path, "mpc", publish="tcp://:1", out=out)
    assert not out.exists()
