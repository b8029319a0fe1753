"""The drawings in docs/hardware.md."""

from __future__ import annotations

import importlib
import re
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

ROOT = Path(__file__).parents[2]
DOCS = ROOT / "docs"
SCRIPT = DOCS / "draw_robot.py"
CHIPS = ROOT / "host" / "ccr_host" / "sim" / "simavr" / "shim" / "chips.c"
ARDUINO = Path("/usr/share/arduino/hardware/arduino/avr/variants")
VARIANTS = {"uno": "standard", "mega2560": "mega"}


@pytest.fixture(scope="module")
def drawing() -> ModuleType:
    return script_of_docs("draw_robot")


@pytest.fixture(scope="module")
def wiring() -> ModuleType:
    return script_of_docs("draw_wiring")


def script_of_docs(name: str) -> ModuleType:
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(DOCS)
        return importlib.import_module(name)


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


@pytest.mark.parametrize(
    ("robot", "picture"), [(None, "wiring.svg"), ("three-spatial", "wiring-mega.svg")]
)
def test_the_wiring_in_the_docs_is_that_of_the_descriptions(
    wiring: ModuleType, robot: str | None, picture: str
) -> None:
    drawn = wiring.wiring_svg(schema.load(robot))
    assert (DOCS / "images" / picture).read_text() == drawn


@pytest.mark.parametrize("board", VARIANTS)
def test_the_pins_drawn_are_the_firmwares_in_the_numbers_of_arduinos_own_tables(
    wiring: ModuleType, board: str
) -> None:
    chip = CHIPS.read_text().partition(f'.board = "{board}"')[2].partition("},\n    {")[0]
    pins = re.search(r"\.pin = (.*?),\n\s*\.output", chip, re.S)
    stop = re.search(r"\.emergency_stop = {PORT_(\w), (\d)}", chip)
    assert pins and stop
    *servos, supply, _led = re.findall(r"{PORT_(\w), (\d)}", pins[1])
    table = ARDUINO / VARIANTS[board] / "pins_arduino.h"
    assert table.exists(), "apt-get install arduino-core-avr"
    ports, bits = (
        re.findall(form, table.read_text().partition(start)[2].partition("};")[0], re.M)
        for start, form in (
            ("digital_pin_to_port_PGM[] = {", r"^\s*P(\w)\b"),
            ("digital_pin_to_bit_mask_PGM[] = {", r"^\s*_BV\(\s*(\d)"),
        )
    )
    drawn = wiring.BOARDS[board]
    numbers = (*drawn.servos, drawn.supply, drawn.emergency_stop)
    assert [(ports[n], bits[n]) for n in numbers] == [*servos, supply, stop.groups()]


@pytest.mark.parametrize(("robot", "board"), [("single", "UNO"), ("two-spatial", "Mega 2560")])
def test_a_robot_is_wired_to_the_smallest_board_with_a_pin_for_each_motor(
    wiring: ModuleType, robot: str, board: str
) -> None:
    description = schema.load(robot)
    texts = [e.text or "" for e in ET.fromstring(wiring.wiring_svg(description)).iter()]
    motors = range(1, description.robot.motors + 1)
    assert f"Arduino {board}" in texts
    assert [text for text in texts if text.startswith("servo ")] == [f"servo {n}" for n in motors]
