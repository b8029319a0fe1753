"""A simulated robot of the user's in place of the twin."""

import numpy as np
import pytest

from ccr_host.core.errors import CodeError, ConfigError
from ccr_host.core.plugins import Given
from ccr_host.link.messages import State
from ccr_host.record.comparisons import paper_mean_mm
from ccr_host.record.keep import execute_logged
from ccr_host.record.log import topics
from ccr_host.record.log.reader import RunRecording
from ccr_host.record.replay import replay
from ccr_host.robot.kinematics import ConstantCurvature
from ccr_host.run.options import RunOptions
from ccr_host.run.summary import summarise
from ccr_host.run.twin_floor import floor_of_run_mm
from ccr_host.sim.robot.plant import Plant

QUICK = (
    "control.settle_s=0.1",
    "link.arm_axis_ms=20",
    "link.relax_after_ms=60000",
    "tracker.noise_mm=0",
)


class Arm:
    """Bends as the controller's model says, at once."""

    def __init__(self, description):
        self.servo = description.servo
        lengths_mm = (description.robot.segment_lengths_mm[0], 0.0)
        shorter = description.robot.model_copy(update={"segment_lengths_mm": lengths_mm})
        self.models = [ConstantCurvature(shorter), ConstantCurvature(description.robot)]
        self.q_rad = np.zeros(2)
        self.time_us = 0

    def set_pulses_half_us(self, pulses_half_us):
        if all(pulses_half_us):
            offset_us = np.array(pulses_half_us) / 2 - self.servo.neutral_pulse_us
            self.q_rad = np.radians(90) * offset_us / self.servo.pulse_per_90_deg_us

    def advance_to(self, time_us):
        assert time_us >= self.time_us
        self.time_us = time_us

    def markers_mm(self):
        return [np.zeros(3), *(model.tip_mm(self.q_rad) for model in self.models)]


def options(path, plant=Arm, **others):
    return RunOptions(
        path=str(path), controller="open-loop", plant=Given(plant), rate_hz=5.0, overrides=QUICK,
        **others,
    )  # fmt: skip


@pytest.fixture
def path(tmp_path):
    file = tmp_path / "short.csv"
    file.write_text("t_s,y_mm,z_mm\n0,0,30\n2,0,35\n")
    return file


@pytest.mark.long
@pytest.mark.parametrize("tracker", ["twin:", "ndi-emulator:"])
@pytest.mark.parametrize("device", ["emulator:", "emulator+pty:"])
def test_a_run_moves_it_and_knows_its_true_tip(path, tmp_path, tracker, device):
    result = execute_logged(
        options(path, tracker=tracker, device=device, checks="motion"), tmp_path, lambda *_: None
    )
    assert result.failure is None
    figures = summarise(result)
    lag_mm = 1.0 if device == "emulator+pty:" else 0.0  # A loaded machine is late in real time.
    assert figures["true_mean_error_mm"] < 0.2 + lag_mm
    assert figures["mean_error_mm"] < 0.2 + lag_mm
    assert floor_of_run_mm(result) is None
    assert replay(RunRecording(tmp_path)).difference is None
    assert RunRecording(tmp_path).options.plant == "python:Arm"


def test_the_papers_figures_are_not_put_beside_its():
    assert paper_mean_mm(RunOptions(path="8shape", controller="mpc", plant=Given(Arm))) is None


def test_its_own_tip_counts_and_it_is_told_when_the_path_begins(path):
    class Told(Arm):
        began_us = None

        def tip_mm(self):
            return np.array([1.0, 2.0, 3.0])

        def start_path_clock(self, time_us):
            type(self).began_us = time_us

    result = execute_logged(options(path, Told), path.parent, lambda *_: None)
    assert [record.true_mm.tolist() for record in result.records] == [[1.0, 2.0, 3.0]] * 11
    assert Told.began_us > 0


def failing(error):
    def deed():
        raise error

    return deed


def mine(method, deed):
    """A plant that does this instead of one of its methods, once the robot moves."""

    def changed(self, *arguments):
        usual = getattr(Arm, method, lambda _: np.zeros(3))
        return deed() if self.q_rad.any() else usual(self, *arguments)

    return type("Mine", (Arm,), {method: changed})


@pytest.mark.long
@pytest.mark.parametrize(
    ("method", "deed", "told"),
    [
        ("markers_mm", failing(ZeroDivisionError("my\nmodel")), "ZeroDivisionError: my model"),
        ("set_pulses_half_us", failing(SystemExit(0)), "Mine.set_pulses_half_us has failed: Sys"),
        ("tip_mm", failing(KeyError("x")), "Mine.tip_mm has failed: KeyError"),
        ("tip_mm", lambda: [0, 0], "Mine.tip_mm has failed: ValueError"),
        ("markers_mm", lambda: None, "Mine.markers_mm has failed"),
        ("tip_mm", lambda: np.zeros(3, complex), "Cannot cast array data"),
        ("markers_mm", lambda: np.zeros((2, 3)), r"\(2, 3\) instead of \(3, 3\)"),
        ("markers_mm", lambda: np.full((3, 3), np.nan), "not finite"),
    ],
)
@pytest.mark.parametrize("device", ["emulator:", "emulator+pty:"])
def test_one_that_fails_ends_the_run_disarmed(path, tmp_path, method, deed, told, device):
    with pytest.raises(CodeError, match=told) as failed:
        failure = execute_logged(
            options(path, mine(method, deed), device=device), tmp_path, lambda *_: None
        )
        raise failure.failure or AssertionError("the run went on")
    assert "\n" not in str(failed.value)
    states = [one.content["state"] for one in RunRecording(tmp_path).messages(topics.STATE)]
    assert states[-1] == State.DISARMED.name.lower()


def test_one_that_lacks_a_method_is_refused_inherited_or_not(path):
    class Inherits(Plant):
        def __init__(self, description):
            pass

    class Lacks:
        def __init__(self, description):
            pass

        set_pulses_half_us = advance_to = __init__

    for plant, told in ((Inherits, "abstract"), (Lacks, "no attribute 'markers_mm'")):
        with pytest.raises(CodeError, match=told):
            execute_logged(options(path, plant), path.parent, lambda *_: None)


def test_a_tracker_that_sees_no_simulated_robot_has_no_use_for_one(path):
    run = options(path, tracker="ndi:/dev/nosuchport")
    with pytest.raises(ConfigError, match="sees no simulated robot"):
        execute_logged(run, path.parent, lambda *_: None)
