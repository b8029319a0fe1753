"""The drawing of the robot in docs/hardware.md."""

from __future__ import annotations

import importlib.util
import subprocess
import sys
from pathlib import Path
from types import ModuleType
from xml.etree import ElementTree as ET

import pytest

from ccr_host.description import schema
from ccr_host.robot.kinematics import ConstantCurvature
from ccr_host.sim.robot.mechanics import Mechanics
from ccr_host.sim.robot.mjcf import robot_mjcf

SCRIPT = Path(__file__).parents[2] / "docs" / "draw_robot.py"


@pytest.fixture(scope="module")
def drawing() -> ModuleType:
    spec = importlib.util.spec_from_file_location("draw_robot", SCRIPT)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_the_picture_in_the_docs_is_that_of_the_default_description(drawing: ModuleType) -> None:
    assert drawing.PICTURE.read_text() == drawing.robot_svg(schema.load())


def test_another_robot_is_drawn_with_its_own_measures(tmp_path: Path) -> None:
    description = tmp_path / "mine.toml"
    description.write_text("[robot]\nsegment_lengths_mm = [61.5, 44]\nmarker_offset_mm = 12\n")
    drawn = tmp_path / "mine.svg"
    words = ["--robot", str(description), "--out", str(drawn)]
    subprocess.run([sys.executable, str(SCRIPT), *words], check=True)
    texts = {element.text for element in ET.parse(drawn).iter() if element.tag.endswith("text")}
    assert {"L_1 = 61.5 mm", "L_2 = 44 mm", "d_m = 12 mm"} <= texts


@pytest.mark.parametrize("robot", [None, "two-spatial", "three-spatial"])
def test_the_holes_are_where_the_twin_has_them(drawing: ModuleType, robot: str | None) -> None:
    description = schema.load(robot)
    sites = ET.fromstring(robot_mjcf(description.twin)).iter("site")
    # The twin's names end with the radius.
    places = {site.get("name", "").rpartition("_")[0]: site.get("pos", "") for site in sites}
    for number, (y_mm, z_mm) in enumerate(drawing.holes_mm(description), start=1):
        x_m, _, z_m = map(float, places[f"tendon{number}_disk0"].split())
        assert (1000 * x_m, 1000 * z_m) == pytest.approx((y_mm, z_mm), abs=1e-9)


def test_a_positive_angle_bends_as_drawn_towards_the_tendon_that_it_winds_up() -> None:
    description = schema.load()
    lifted, aside = ConstantCurvature(description.robot).tip_mm([[0.1, 0.0], [0.0, 0.1]])
    assert lifted[2] > 0
    assert aside[0] > 0
    for angles_rad, coordinate in (((0.3, 0.0), 2), ((0.0, 0.3), 0)):
        twin = Mechanics(description.twin, payload_g=0.0)
        before_mm = twin.markers_mm()[2, coordinate]
        twin.pull(angles_rad)
        twin.advance(2000)
        assert twin.markers_mm()[2, coordinate] > before_mm + 5
