"""The scalar jets against the kinematics of any robot."""

from __future__ import annotations

import numpy as np
import pytest

from ccr_host.control.mpc.controller import ModelPredictive, geometry_of
from ccr_host.control.mpc.two_motors import jet_at
from ccr_host.core.errors import ConfigError
from ccr_host.description.schema import Description, Robot
from ccr_host.robot.kinematics import ConstantCurvature, jet_index, jets


def test_scalar_jets_are_those_of_the_kinematics_of_any_robot_to_rounding():
    rng = np.random.default_rng(3)
    for _ in range(50):
        robot = Robot(
            segment_lengths_mm=tuple(rng.uniform(5, 200, 2)),
            tendon_radius_mm=rng.uniform(1, 20),
            marker_offset_mm=rng.uniform(0, 60),
            pulley_radius_mm=rng.uniform(1, 20),
        )
        geometry, model = geometry_of(robot), ConstantCurvature(robot)
        gain = geometry.bending_per_motor
        q = rng.uniform(-4.0, 4.0, 2) / gain
        jet = jet_at(geometry, *q)
        general = jets(model.chain(), model.bending_rad(q)[None])[0]
        for row, motors in enumerate(jet_index(2)):
            suffix = "_" * bool(motors) + "".join(str(motor + 1) for motor in motors)
            s, scale = getattr(jet, f"sagittal{suffix}", 0j), gain ** len(motors)
            scalar = [getattr(jet, f"across{suffix}", 0.0), -s.real, s.imag]
            assert scalar == pytest.approx(scale * general[row], abs=1e-10 * scale)


def test_mpc_of_a_robot_of_other_segments_is_refused_and_says_what_to_do():
    robot = Robot(segments=Robot().chain)
    with pytest.raises(ConfigError, match="two planar segments"):
        ModelPredictive(Description(robot=robot))
