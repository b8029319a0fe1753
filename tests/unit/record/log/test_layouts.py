"""The layouts for Foxglove and PlotJuggler name what is in a log."""

import json
import re
import xml.etree.ElementTree as ET
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from mcap.reader import make_reader

LAYOUTS = Path(__file__).parents[4] / "layouts"
FOXGLOVE = json.loads((LAYOUTS / "foxglove.json").read_text(encoding="utf-8"))
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
def channels(recording) -> dict[str, tuple[str, list[Any]]]:
    """Schema's name and messages by topic, read by the mcap package alone."""
    found: dict[str, tuple[str, list[Any]]] = {}
    with (recording.source / "log_0000.mcap").open("rb") as file:
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


def test_every_plotted_path_of_foxglove_is_a_number_in_the_log(channels) -> None:
    panels = FOXGLOVE["configById"]
    plotted = {
        path["value"]
        for name, panel in panels.items()
        if name.startswith("Plot!")
        for path in panel["paths"]
    }
    assert len(plotted) > 8
    assert plotted <= series(channels, ".")


def test_every_topic_of_foxglove_has_a_schema_that_its_panel_shows(channels) -> None:
    for name, panel in FOXGLOVE["configById"].items():
        kind = name.partition("!")[0]
        topics = panel.get("topics") or [panel.get("topicToRender")]
        for topic in topics if kind != "Plot" else ():
            assert channels[topic][0] in SHOWN_SCHEMAS[kind], topic


def test_every_panel_of_foxglove_has_its_place() -> None:
    def leaves(node: Any) -> Iterator[str]:
        if isinstance(node, str):
            yield node
        else:
            assert node["direction"] in ("row", "column")
            yield from leaves(node["first"])
            yield from leaves(node["second"])

    placed = list(leaves(FOXGLOVE["layout"]))
    assert sorted(placed) == sorted(FOXGLOVE["configById"])


def test_every_curve_of_plotjuggler_is_a_number_in_the_log(channels) -> None:
    root = ET.parse(LAYOUTS / "plotjuggler.xml").getroot()
    curves = {curve.attrib["name"] for curve in root.iter("curve")}
    assert len(curves) > 8
    assert all(re.fullmatch(r"#[\da-f]{6}", curve.attrib["color"]) for curve in root.iter("curve"))
    assert curves <= series(channels, "/")
