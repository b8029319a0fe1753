"""Makes the layouts for a robot with another number of motors: the plots get a curve for each.

python layouts/for_robot.py --robot three-spatial --out FOLDER
"""

from __future__ import annotations

import argparse
import json
import re
from pathlib import Path
from typing import Any
from xml.etree import ElementTree as ET

from ccr_host.description import schema

HERE = Path(__file__).parent
FOXGLOVE, PLOTJUGGLER = "foxglove.json", "plotjuggler.xml"
_PER_MOTOR = re.compile(r"(/board/state.*|.*\bq_rad)\[(\d+)\]$")
_COLOURS = ("#1f77b4", "#d62728", "#2ca02c", "#ff7f0e", "#9467bd", "#17becf", "#8c564b", "#e377c2")
"""Of a plot's curves, from the first again after the last."""


def foxglove(motors: int) -> str:
    """Text of the layout for Foxglove."""
    layout = json.loads((HERE / FOXGLOVE).read_text(encoding="utf-8"))
    for panel in layout["configById"].values():
        if "paths" in panel:
            panel["paths"] = [path for n in range(motors) for path in _paths(panel["paths"], n)]
    return json.dumps(layout, indent=1) + "\n"


def _paths(paths: list[dict[str, Any]], motor: int) -> list[dict[str, Any]]:
    """A motor's curves, made of the first one's; all that belongs to no motor comes with it."""
    found = []
    for path in paths:
        place = _PER_MOTOR.match(path["value"])
        if place and place[2] == "0":
            name = path["label"].removesuffix("1") + str(motor + 1)
            found.append({**path, "value": f"{place[1]}[{motor}]", "label": name})
        elif not place and motor == 0:
            found.append(path)
    return found


def plotjuggler(motors: int) -> str:
    """Text of the layout for PlotJuggler."""
    tree = ET.parse(HERE / PLOTJUGGLER)
    for plot in tree.iter("plot"):
        firsts = [place[1] for curve in plot if (place := _PER_MOTOR.match(curve.attrib["name"]))]
        if not firsts:
            continue
        names = [f"{first}[{n}]" for n in range(motors) for first in dict.fromkeys(firsts)]
        plot[:] = [
            ET.Element("curve", name=name, color=_COLOURS[n % len(_COLOURS)])
            for n, name in enumerate(names)
        ]
    ET.indent(tree, " ")
    head = '<?xml version="1.0" encoding="UTF-8"?>\n'
    return head + ET.tostring(tree.getroot(), encoding="unicode").replace(" />", "/>") + "\n"


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--robot", help="description; the default robot without it")
    parser.add_argument("--out", type=Path, required=True, help="folder for both files")
    words = parser.parse_args()
    count = schema.load(words.robot).robot.motors
    words.out.mkdir(parents=True, exist_ok=True)
    (words.out / FOXGLOVE).write_text(foxglove(count), encoding="utf-8")
    (words.out / PLOTJUGGLER).write_text(plotjuggler(count), encoding="utf-8")
