"""A spec that uses what the real one does not: shapes that the code generators must also manage."""

from typing import Any

from .edit import find

Tree = dict[str, Any]

_PROSE = (
    "A long explanation of something that takes more than a line of code can hold, and then goes "
    "on for a while without a full stop to break it at"
)


def make_odd(tree: Tree) -> None:
    """Add sparse enums, all integer types, ranges at the types' ends, long names and prose."""
    tree["enum"].append(
        {
            "name": "sparse",
            "type": "u16",
            "prose": _PROSE,
            "values": [
                {"name": f"value_{number}", "value": number, "prose": _PROSE}
                for number in (3, 5, 700, 65535)
            ],
        }
    )
    tree["struct"].append(
        {
            "name": "unranged",
            "prose": _PROSE,
            "fields": [
                {"name": "kind", "type": "u16", "enum": "sparse", "prose": _PROSE},
                {"name": "bits", "type": "u8", "flags": "config_groups", "prose": _PROSE},
            ],
        }
    )
    integers = [
        {
            "name": f"a_field_with_a_rather_long_name_{name}",
            "type": name,
            "unit": "mm",
            "scale": 0.125,
            "min": low,
            "max": high,
            "prose": _PROSE,
        }
        for name, low, high in (
            ("i8", -128, 126),
            ("u8", 1, 255),
            ("i16", -32767, 32767),
            ("i32", -(2**31) + 1, 2**31 - 2),
            ("u32", 1, 2**32 - 2),
        )
    ]
    tree["message"] += [
        {
            "id": 0xD0,
            "name": "integers",
            "direction": "to_host",
            "prose": f"{_PROSE}.",
            "fields": integers,
        },
        {
            "id": 0xD1,
            "name": "nesting",
            "direction": "to_host",
            "prose": "Own fields before a struct without ranges.",
            "fields": [
                {"name": "own", "type": "i32", "count": 3, "prose": "Own."},
                {"name": "many", "type": "u16", "count": 6, "prose": "Gone through in a loop."},
            ],
            "struct": "unranged",
        },
        {"id": 0xD2, "name": "nothing", "direction": "to_host", "prose": "Empty."},
    ]
    find(tree, "constant", "boot_ticks")["value"] = -70000
