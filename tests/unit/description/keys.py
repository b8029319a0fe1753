"""The keys of a robot description that hold numbers, with their bounds, from its JSON schema."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from hypothesis import strategies as st

from ccr_host.description.schema import Description


@dataclass(frozen=True)
class Number:
    least: float
    greatest: float
    whole: bool


@dataclass(frozen=True)
class Key:
    numbers: tuple[Number, ...]
    single: bool


def _keys() -> dict[str, Key]:
    schema = Description.model_json_schema()
    keys = {}
    for section, field in schema["properties"].items():
        reference = field.get("$ref", "").rpartition("/")[2]
        for name, value in schema["$defs"].get(reference, {}).get("properties", {}).items():
            numbers = _numbers(value.get("anyOf", [value])[0])
            if numbers:
                keys[f"{section}.{name}"] = Key(numbers, not {"prefixItems", "items"} & set(value))
    return keys


def _numbers(value: Mapping[str, Any]) -> tuple[Number, ...]:
    several = [value["items"]] * len(value.get("default", [])) if "items" in value else [value]
    members = value.get("prefixItems", several)
    if any("minimum" not in member for member in members):
        return ()
    return tuple(
        Number(member["minimum"], member["maximum"], member["type"] == "integer")
        for member in members
    )


KEYS = _keys()


def values(key: Key) -> st.SearchStrategy[list[float]]:
    """A value for each number of a key: one of its bounds, or a value between them."""
    return st.tuples(*(_value(number) for number in key.numbers)).map(list)


def _value(number: Number) -> st.SearchStrategy[float]:
    low, high = number.least, number.greatest
    between = st.integers(int(low), int(high)) if number.whole else st.floats(low, high)
    return st.sampled_from([low, high]) | between


def overrides(chosen: Mapping[str, list[float]]) -> list[str]:
    """Argument for ``--set``."""
    return [
        f"{key}={json.dumps(value[0] if KEYS[key].single else value)}"
        for key, value in chosen.items()
    ]
