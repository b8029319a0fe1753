import numpy as np
import pytest

from ccr_host.control.adaptive.motion import first_pose, moved
from ccr_host.control.adaptive.parameters import parameters_of, prior_of
from ccr_host.control.adaptive.path_plan import polished
from ccr_host.control.adaptive.tip import tip_mm
from ccr_host.control.base import Observation, Outcome
from ccr_host.control.registry import make_controller
from ccr_host.description.schema import Description
from ccr_host.robot.kinematics import ConstantCurvature
from ccr_host.robot.paths import load_path
from ccr_host.robot.workspace import MotorLimits, Workspace

DESCRIPTION = Description()
PRIOR = parameters_of(prior_of(DESCRIPTION.robot).mean)
LIMITS = MotorLimits.of(DESCRIPTION.servo)


def _reference(name, rate_hz):
    return load_path(name, rate_hz, Workspace(ConstantCurvature(DESCRIPTION.robot), LIMITS))


def _approach(controller, tip_of, time_us):
    """A picture of 50 ms ago shows the command before the last one, half a period delayed."""
    before_rad, q_rad, calls = np.zeros(2), np.zeros(2), 0
    while True:
        observation = Observation(0, time_us, tip_of(before_rad), 50_000, q_rad)
        command = controller.approach(observation)
        if command is None:
            return q_rad, time_us
        before_rad, q_rad = q_rad, command.q_rad
        calls, time_us = calls + 1, time_us + 50_000
        assert LIMITS.clip(q_rad) == pytest.approx(q_rad)
        assert calls < 2400


def test_without_any_measurement_it_still_approaches_and_follows():
    controller = make_controller("adaptive", DESCRIPTION)
    controller.start(_reference("star", 1.0))
    q_rad, time_us = _approach(controller, lambda _: None, 1_000_000)
    command = controller.step(Observation(0, time_us, None, 0, q_rad))
    assert command.outcome is Outcome.COASTED
    assert LIMITS.clip(command.q_rad) == pytest.approx(command.q_rad)


@pytest.mark.long
@pytest.mark.parametrize("tip", [np.full(3, np.nan), np.full(3, 1e6), np.zeros(3)])
def test_senseless_measurements_never_lead_outside_the_limits_or_beyond_the_slew(tip):
    controller = make_controller("adaptive", DESCRIPTION)
    reference = _reference("8shape", 20.0)
    controller.start(reference)
    q_rad, time_us = _approach(controller, lambda _: tip, 1_000_000)
    most = np.radians(DESCRIPTION.servo.slew_deg_s[0]) * reference.period_s
    for step in range(100):
        command = controller.step(Observation(step, time_us, tip, 50_000, q_rad))
        assert np.isfinite(command.q_rad).all()
        assert LIMITS.clip(command.q_rad) == pytest.approx(command.q_rad)
        assert np.abs(command.q_rad - q_rad).max() <= most + 1e-9
        q_rad, time_us = command.q_rad, time_us + 50_000


@pytest.mark.long
def test_a_robot_as_believed_is_led_along_the_path():
    """The twin's own statics would do the same; here the prior model plays the robot."""
    controller = make_controller("adaptive", DESCRIPTION)
    reference = _reference("8shape", 1.0)
    controller.start(reference)
    pose = first_pose(PRIOR, 0.0, 0.0)

    def tip_of(q_rad):
        nonlocal pose
        pose = moved(PRIOR, pose, *q_rad.tolist())
        return tip_mm(PRIOR, *pose.theta_rad)

    q_rad, time_us = _approach(controller, tip_of, 1_000_000)
    errors, unavoidable = [], []
    for step, target_mm in enumerate(reference.target_mm):
        observation = Observation(step, time_us, tip_of(q_rad), 50_000, q_rad)
        q_rad = controller.step(observation).q_rad
        time_us += 1_000_000
        errors.append(np.linalg.norm(tip_of(q_rad) - target_mm))
        nearest = polished(PRIOR, pose.theta_rad, target_mm, 30)
        unavoidable.append(np.linalg.norm(tip_mm(PRIOR, *nearest) - target_mm))
    assert np.mean(errors) < np.mean(unavoidable) + 0.1
