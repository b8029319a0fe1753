"""Building blocks of the sections of a robot description, and messages for invalid ones."""

from __future__ import annotations

import difflib
import itertools
import json
import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from functools import cache
from types import NoneType
from typing import Annotated, Any, TypeVar, get_args

from pydantic import AfterValidator, BaseModel, BeforeValidator, ConfigDict, Field, ValidationError
from pydantic.fields import FieldInfo

T = TypeVar("T")
Location = tuple[int | str, ...]
Model = type[BaseModel]

_SHOWN_CHARACTERS = 60
_MEMBERS = {2: "two", 3: "three"}
_NOUNS: dict[int | str, str] = {"segments": "segment", "tendons": "tendon"}
"""What a member of a list of tables is called; others are values."""
_SEE = "see docs/robot-description.md"
_PROBLEMS = {
    "greater_than_equal": "too small",
    "less_than_equal": "too large",
    "finite_number": "not a finite number",
    "float_type": "not a number",
    "int_type": "not a whole number",
    "bool_type": "neither true nor false",
    "string_type": "not text",
    "missing": "missing",
    "too_short": "too few values",
    "too_long": "too many values",
    "tuple_type": "not a list of values",
    "dict_type": "not a table",
    "model_type": "not a table",
    "literal_error": "unknown",
}
"""Text for pydantic's error types; for others pydantic's own message is used."""


class Section(BaseModel):
    """A table of the description: strict, and documented by its attributes' docstrings."""

    model_config = ConfigDict(
        frozen=True, extra="forbid", allow_inf_nan=False, use_attribute_docstrings=True
    )


def within(low: float, high: float) -> FieldInfo:
    """Bounds of a number; strict, so that text and `true` are rejected."""
    bounds: FieldInfo = Field(ge=low, le=high, strict=True)
    return bounds


@dataclass(frozen=True)
class Per:
    """Marks a key that has a value for each part of the robot."""

    part: str
    """Motor, segment or tendon."""
    usual: int = 2
    """Number of values of a section alone, which are those of the paper's robot."""
    one_for_all: bool = True
    """Whether one number may stand for all of them."""


def one_for_all(value: object, count: int) -> object:
    """Repeat a single number; leave any other value to be validated."""
    is_number = isinstance(value, int | float) and not isinstance(value, bool)
    return (value,) * count if is_number else value


def pair(value: object) -> object:
    """Repeat a single number once."""
    return one_for_all(value, 2)


def _four(value: object) -> object:
    return one_for_all(value, 4)


PerMotor = Annotated[tuple[T, ...], Per("motor"), BeforeValidator(pair)]
"""One value per motor, or one for all."""
PerSegment = Annotated[tuple[T, ...], Per("segment"), BeforeValidator(pair)]
"""One value per segment from the base, or one for all."""
PerTendon = Annotated[tuple[T, ...], Per("tendon", 4), BeforeValidator(_four)]
"""One value per tendon, in the order of `Robot.tendons`, or one for all."""
EachSegment = Annotated[tuple[T, ...], Per("segment", one_for_all=False)]
"""One value per segment from the base."""


def fitted(
    section: type[Section], name: str, given: Mapping[str, Any], counts: Mapping[str, int]
) -> dict[str, Any]:
    """Values of a section, with as many per part as a robot has where one stands for all.

    ``counts`` are the numbers of the robot's parts; ``name`` is for messages.

    Raises:
        ValueError: a key has too many values, or too few.
    """
    complete = dict(given)
    for key, field in section.model_fields.items():
        if (per := per_part(field)) is None:
            continue
        count = counts[per.part]
        if key not in given:
            if per.usual != count and not followed_key(field):
                complete[key] = (field.default[0],) * count
            continue
        value = one_for_all(given[key], count) if per.one_for_all else given[key]
        if isinstance(value, list | tuple) and len(value) != count:
            one = "one number or " if per.one_for_all else ""
            raise ValueError(
                f"{name}.{key} = {_shown(value)}: this robot has {_counted(count, per.part)}, give "
                f"{one}{_counted(count, 'value')} in brackets"
            )
        complete[key] = value
    return complete


def _counted(count: int, noun: str) -> str:
    return f"{count} {noun}{'' if count == 1 else 's'}"


def per_part(field: FieldInfo) -> Per | None:
    """How a key has a value for each part of the robot; None if it has one value."""
    return next((mark for mark in field.metadata if isinstance(mark, Per)), None)


# Robots and tendons: from catheters of 2 mm to trunks of a metre.
SegmentLength = Annotated[float, within(5, 1000)]
TendonRadius = Annotated[float, within(0.2, 100)]
MarkerOffset = Annotated[float, within(0, 500)]
PulleyRadius = Annotated[float, within(1, 200)]
# Servos: what the board's protocol can carry.
Pulse = Annotated[float, within(500, 2500)]
PulseSpan = Annotated[float, within(-2000, 2000)]
LEAST_SPAN_US = 50.0
FULL_TURN_DEG = 360
Turn = Annotated[float, within(-FULL_TURN_DEG, FULL_TURN_DEG)]
_Share = Annotated[float, within(-1e6, 1e6)]
_LEAST_LENGTH = 1e-6


def _unit(vector: tuple[float, float, float]) -> tuple[float, float, float]:
    """The vector with length 1; zeros lose their sign, so that equal directions look equal."""
    length = math.hypot(*vector)
    if length < _LEAST_LENGTH:
        raise ValueError(f"{list(vector)} has no direction")
    x, y, z = (part / length + 0.0 for part in vector)
    return x, y, z


Direction = Annotated[tuple[_Share, _Share, _Share], AfterValidator(_unit)]
"""A vector of any length, which becomes 1."""


def as_in(key: str) -> dict[str, Any]:
    """Mark a key of the simulation that takes its value from another section unless it is set."""
    return {"as_in": key}


def followed_key(field: FieldInfo) -> str | None:
    """The ``section.key`` whose value a field of the simulation takes unless it is set."""
    extra = field.json_schema_extra
    return str(extra["as_in"]) if isinstance(extra, dict) and "as_in" in extra else None


def explain(error: ValidationError, whole: Model, where: str) -> tuple[str, str]:
    """Cause and cure of the first error; an unknown key comes before a missing one.

    ``where`` is the file that the values come from, as in " in robot.toml"; it may be empty.
    """
    first = min(error.errors(), key=lambda one: one["type"] != "extra_forbidden")
    location = first["loc"]
    more = f" (and {error.error_count() - 1} more)" if error.error_count() > 1 else ""
    if first["type"] == "extra_forbidden":
        cause = f"unknown key {_dotted(location)}{where}{more}"
        return cause, _known_instead(location, whole)
    if first["type"] == "value_error":
        text = first["msg"].removeprefix("Value error, ")
        key = _dotted(location)
        named = text if not key or text.startswith(f"{key}.") else f"{key}: {text}"
        return f"{named}{where}{more}", _SEE
    problem = _PROBLEMS.get(first["type"], first["msg"])
    shown = "" if first["type"] == "missing" else f" = {_shown(first['input'])}"
    schema = _schema(location, whole)
    cure = f"give {allowed(schema)}; {_SEE}" if schema else _SEE
    return f"{_dotted(location)}{shown}{where}: {problem}{more}", cure


def section_model(annotation: Any) -> Any:  # noqa: ANN401 - pydantic's annotations
    """The section model in an annotation, also if the section is optional."""
    return next((part for part in get_args(annotation) if part is not NoneType), annotation)


def bounds(schema: dict[str, Any]) -> str:
    """Range of a key, or its allowed values, from its JSON schema."""
    if "enum" in schema:
        return " or ".join(schema["enum"])
    number = _element(schema)
    if "minimum" not in number:
        return ""
    return f"{number['minimum']:.10g} to {number['maximum']:.10g}"


def allowed(schema: dict[str, Any]) -> str:
    """Description of the values allowed for a key, from its JSON schema."""
    schema = schema.get("anyOf", [schema])[0]
    between = bounds(schema)
    if "prefixItems" in schema:
        count = len(schema["prefixItems"])
        each = f", each from {between}" if between else ""
        return f"{_MEMBERS.get(count, count)} values in brackets{each}"
    if schema.get("type") == "array":
        return f"a list in brackets, each member {allowed(schema['items'])}"
    return {
        "number": f"a number from {between}",
        "integer": f"a whole number from {between}",
        "boolean": "true or false",
        "string": between or "text in quotes",
    }.get(schema.get("type", ""), "a table of keys")


def _element(schema: dict[str, Any]) -> dict[str, Any]:
    """Schema of the number itself, from that of a number, a tuple of numbers, or an optional."""
    schema = schema.get("anyOf", [schema])[0]
    members = schema.get("prefixItems", [schema.get("items")])[0]
    return _element(members) if members else schema


def _schema(location: Location, whole: Model) -> dict[str, Any]:
    """JSON schema of a key or of a member of its value; empty if there is no such key."""
    root = _json_schema(whole)
    node: Any = root
    for part in location:
        node = _resolved(node, root)
        if isinstance(part, int):
            members = node.get("prefixItems")
            node = members[part] if members else node.get("items", {})
        else:
            node = node.get("properties", {}).get(part, node.get("additionalProperties", {}))
    return _resolved(node, root) if isinstance(node, dict) else {}


@cache
def _json_schema(whole: Model) -> dict[str, Any]:
    return whole.model_json_schema()


def _resolved(node: dict[str, Any], root: dict[str, Any]) -> dict[str, Any]:
    for branch in (node, *node.get("anyOf", ())):
        if "$ref" in branch:
            resolved: dict[str, Any] = root["$defs"][branch["$ref"].rpartition("/")[2]]
            return resolved
    return node


def _known_instead(location: Location, whole: Model) -> str:
    """The known keys in this place, and the ones probably meant."""
    sections = {name: section_model(field.annotation) for name, field in whole.model_fields.items()}
    *_, last = location
    model: Any = whole
    for part in location[:-1]:
        if isinstance(part, str):
            model = section_model(model.model_fields[part].annotation)
    known = sorted(model.model_fields)
    meant = [
        f"{name}.{last}"
        for name, section in sections.items()
        if last in getattr(section, "model_fields", ())
    ] or difflib.get_close_matches(str(last), known, n=1)
    return f"{did_you_mean(meant)}known: {', '.join(known)}"


def did_you_mean(meant: Iterable[str]) -> str:
    """Start of a cure that suggests names; empty if there are none."""
    names = " or ".join(meant)
    return f"did you mean {names}? " if names else ""


def _dotted(location: Location) -> str:
    """`section.key`, with the number of the table or value if there are several."""
    keys = ".".join(str(part) for part in location if isinstance(part, str))
    members = [
        f"{_NOUNS.get(key, 'value')} {part + 1}"
        for key, part in itertools.pairwise(location)
        if isinstance(part, int)
    ]
    return f"{keys} ({' of '.join(reversed(members))})" if members else keys


def _shown(value: object) -> str:
    """The value roughly as it was written, on one line, shortened."""
    try:
        text = json.dumps(value, default=str)
    except (ValueError, RecursionError):  # more digits than Python will write, or too deep
        text = "..."
    return text if len(text) <= _SHOWN_CHARACTERS else f"{text[:_SHOWN_CHARACTERS]}..."
