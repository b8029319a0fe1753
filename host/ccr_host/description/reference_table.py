"""The table of all keys of a robot description, made from ``schema.Description``.

Renew the committed copy:
``python -m ccr_host.description.reference_table > docs/robot-description.md``.
"""

from __future__ import annotations

import sys
from typing import Any

from ccr_host.description.refusals import bounds, section_model
from ccr_host.description.schema import Description, Push
from ccr_host.description.source import shipped_descriptions

Schema = dict[str, Any]

_UNITS_BY_SUFFIX = {
    "_us_per_90_deg": "µs",
    "_nm_rad": "N m/rad",
    "_n_m": "N/m",
    "_m_s2": "m/s²",
    "_deg_s2": "deg/s²",
    "_deg_s": "deg/s",
    "_mm": "mm",
    "_deg": "deg",
    "_rad": "rad",
    "_us": "µs",
    "_ms": "ms",
    "_hz": "Hz",
    "_s": "s",
    "_g": "g",
    "_n": "N",
}
_UNITS_BY_KEY = {
    "baud": "Bd",
    "position_weight": "1/mm²",
    "effort_weight": "1/rad²",
    "joint_damping": "N m s/rad",
    "friction": "N",
}

_INTRODUCTION = """\
# Robot description

<!-- Made by `python -m ccr_host.description.reference_table`; edit its schema.py. -->

One TOML file describes a robot: what the controller believes about it (`robot`, `control`), the
servos and the link (`servo`, `link`), how the camera stands against the robot (`registration`, by
`ccr-host register`), how the twin and its camera are in truth (`twin`, `tracker`), and where the
robot rests (`identified`, by `ccr-host calibrate --identify`).
`--robot FILE.toml` reads it, `--set section.key=value` overrides one key. Keys that are left out
have the default below; unknown keys and values out of range are refused. Ranges
are wide: robots from catheters of 2 mm to trunks of a metre, servos as far as the board's protocol
drives them; what lies outside is a slip of a unit. The twin and its camera
follow the description where a default reads "as ...": without hardware it is your robot that is
simulated. Set both keys to simulate a robot that differs from what is believed of it. A key with
two values has one per segment or servo; where one number is given, it stands for both, except for
lengths and flexures.
"""


def reference() -> str:
    """Return the reference as Markdown."""
    sections = [
        _section(name, section_model(field.annotation))
        for name, field in Description.model_fields.items()
        if name != "name"
    ]
    push = _section("twin.push", Push)
    shipped = ", ".join(f"`{name}`" for name in shipped_descriptions())
    names = f"\nShipped with the package, by name instead of a file: {shipped}.\n"
    return "\n".join([_INTRODUCTION + names, *sections, push])


def _section(name: str, model: Any) -> str:  # noqa: ANN401 - pydantic's annotations
    schema = model.model_json_schema()
    lines = [
        f"## {name}",
        "",
        str(schema["description"]).partition("\n\n")[0],
        "",
        "| key | unit | default | range | meaning |",
        "|---|---|---|---|---|",
    ]
    lines += [_row(key, field) for key, field in schema["properties"].items()]
    return "\n".join(lines) + "\n"


def _row(key: str, field: Schema) -> str:
    meaning = " ".join(str(field.get("description", "")).split()).replace("|", "\\|")
    return f"| `{key}` | {_unit(key)} | {_default(field)} | {bounds(field)} | {meaning} |"


def _unit(key: str) -> str:
    if key in _UNITS_BY_KEY:
        return _UNITS_BY_KEY[key]
    return next((unit for end, unit in _UNITS_BY_SUFFIX.items() if key.endswith(end)), "")


def _default(field: Schema) -> str:
    if "default" not in field:
        return "none" if field.get("type") == "object" else "required"
    default = f"as `{field['as_in']}`" if "as_in" in field else field["default"]
    if default is None or default == "":
        return "none"
    if isinstance(default, str):
        return default
    if isinstance(default, bool):
        return str(default).lower()
    if isinstance(default, list):
        return "[" + ", ".join(f"{value:g}" for value in default) + "]"
    return f"{default:g}"


if __name__ == "__main__":
    sys.stdout.write(reference())
