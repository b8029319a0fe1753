"""The layouts for Foxglove and PlotJuggler name what is in a log."""

import importlib
import json
import re
import xml.etree.ElementTree as ET
from collections.abc import Iterator
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest
from mcap.reader import make_reader

from ccr_host.record.keep import execute_logged
from ccr_host.run.options import RunOptions

LAYOUTS = Path(__file__).parents[4] / "layouts"
MOTORS = {"default": 2, "two-spatial": 4}
SHOWN_SCHEMAS = {
    "3D": {"foxglove.SceneUpdate", "foxglove.PoseInFrame", "foxglove.FrameTransforms"},
    "Log": {"foxglove.Log"},
    "DiagnosticSummary": {"diagnostic_msgs/DiagnosticArray"},
}


def flat(prefix: str, value: Any, joint: str) -> Iterator[tuple[str, float]]:
    """Numbers with their paths, as both programs name them; they differ in the joint alone."""
    if isinstance(value, dict):
        for key, inner in value.items():
            yield from flat(f"{prefix}{joint}{key}", inner, joint)
    elif isinstance(value, list):
        for index, inner in enumerate(value):
            yield from flat(f"{prefix}[{index}]", inner, joint)
    elif isinstance(value, bool | int | float):
        yield prefix, value


@pytest.fixture(scope="module")
def for_robot() -> ModuleType:
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(LAYOUTS)
        return importlib.import_module("for_robot")


@pytest.fixture(
    scope="module", params=["default", pytest.param("two-spatial", marks=pytest.mark.long)]
)
def robot(request: pytest.FixtureRequest) -> str:
    return request.param


@pytest.fixture(scope="module")
def foxglove(for_robot: ModuleType, robot: str) -> Any:
    return json.loads(for_robot.foxglove(MOTORS[robot]))


@pytest.fixture(scope="module")
def channels(
    robot: str, recording, tmp_path_factory: pytest.TempPathFactory
) -> dict[str, tuple[str, list[Any]]]:
    """Schema's name and messages by topic, read by the mcap package alone."""
    folder = recording.source
    if robot != "default":
        folder = tmp_path_factory.mktemp("run")
        path = folder / "short.csv"
        path.write_text("t_s,y_mm,z_mm\n0,0,30\n1,2,31\n")
        options = RunOptions(str(path), "pid-ik", robot=robot, rate_hz=10.0)
        assert execute_logged(options, folder, lambda *_: None).failure is None
    found: dict[str, tuple[str, list[Any]]] = {}
    with (folder / "log_0000.mcap").open("rb") as file:
        for schema, channel, message in make_reader(file).iter_messages():
            _, messages = found.setdefault(channel.topic, (schema.name, []))
            messages.append(json.loads(message.data))
    return found


def series(channels: dict[str, tuple[str, list[Any]]], joint: str) -> set[str]:
    return {
        name
        for topic, (_, messages) in channels.items()
        for message in messages
        for name, _ in flat(topic, message, joint)
    }


def test_the_layouts_in_the_folder_are_those_for_two_motors(for_robot: ModuleType) -> None:
    made = {
        for_robot.FOXGLOVE: for_robot.foxglove(2),
        for_robot.PLOTJUGGLER: for_robot.plotjuggler(2),
    }
    assert {name: (LAYOUTS / name).read_text(encoding="utf-8") for name in made} == made


def test_every_plotted_path_of_foxglove_is_a_number_in_the_log(channels, foxglove, robot) -> None:
    panels = foxglove["configById"]
    plotted = {
        path["value"]
        for name, panel in panels.items()
        if name.startswith("Plot!")
        for path in panel["paths"]
    }
    assert {f"/board/state.target_cdeg[{motor}]" for motor in range(MOTORS[robot])} <= plotted
    assert plotted <= series(channels, ".")


def test_every_topic_of_foxglove_has_a_schema_that_its_panel_shows(channels, foxglove) -> None:
    for name, panel in foxglove["configById"].items():
        kind = name.partition("!")[0]
        topics = panel.get("topics") or [panel.get("topicToRender")]
        for topic in topics if kind != "Plot" else ():
            assert channels[topic][0] in SHOWN_SCHEMAS[kind], topic


def test_every_panel_of_foxglove_has_its_place(foxglove) -> None:
    def leaves(node: Any) -> Iterator[str]:
        if isinstance(node, str):
            yield node
        else:
            assert node["direction"] in ("row", "column")
            yield from leaves(node["first"])
            yield from leaves(node["second"])

    placed = list(leaves(foxglove["layout"]))
    assert sorted(placed) == sorted(foxglove["configById"])


def test_every_curve_of_plotjuggler_is_a_number_in_the_log(channels, for_robot, robot) -> None:
    root = ET.fromstring(for_robot.plotjuggler(MOTORS[robot]).partition("\n")[2])
    curves = {curve.attrib["name"] for curve in root.iter("curve")}
    assert {f"/control/step/q_rad[{motor}]" for motor in range(MOTORS[robot])} <= curves
    assert all(re.fullmatch(r"#[\da-f]{6}", curve.attrib["color"]) for curve in root.iter("curve"))
    assert curves <= series(channels, "/")
