"""The few words of JSON Schema that the log's messages need."""

from __future__ import annotations

from typing import Any

from pydantic_core import SchemaValidator, core_schema

Schema = dict[str, Any]

NUMBER: Schema = {"type": "number"}
INTEGER: Schema = {"type": "integer"}
COUNT: Schema = {"type": "integer", "minimum": 0}
TEXT: Schema = {"type": "string"}
FLAG: Schema = {"type": "boolean"}
OBJECT: Schema = {"type": "object"}
_GREATEST = 2**53


def record(title: str, /, **fields: Schema) -> Schema:
    """An object that has all these fields."""
    return {"title": title, "type": "object", "properties": fields, "required": list(fields)}


def array(items: Schema, length: int | None = None) -> Schema:
    """An array of any or of a given length."""
    bounds = {} if length is None else {"minItems": length, "maxItems": length}
    return {"type": "array", "items": items, **bounds}


def nullable(schema: Schema) -> Schema:
    """The same, or null."""
    return {**schema, "type": [schema["type"], "null"]}


def described(schema: Schema, description: str) -> Schema:
    """The same, with a word on what it means."""
    return {**schema, "description": description}


def validator(schema: Schema) -> SchemaValidator:
    """Checks that what there is of a message has the right types; fields may be missing.

    Numbers are finite and integers are exact as floating-point numbers, so that whoever reads them
    may compute with them.
    """
    return SchemaValidator(_core(schema))


def _core(schema: Schema) -> core_schema.CoreSchema:
    kind = schema["type"]
    if isinstance(kind, list):
        return core_schema.nullable_schema(_core({**schema, "type": kind[0]}))
    if kind == "object":
        fields = {
            name: core_schema.typed_dict_field(_core(field), required=False)
            for name, field in schema.get("properties", {}).items()
        }
        return core_schema.typed_dict_schema(fields, extra_behavior="allow")
    if kind == "array":
        return core_schema.list_schema(
            _core(schema["items"]),
            min_length=schema.get("minItems"),
            max_length=schema.get("maxItems"),
            strict=True,
        )
    if "enum" in schema:
        return core_schema.literal_schema(schema["enum"])
    bounds = {"ge": schema.get("minimum", -_GREATEST), "le": schema.get("maximum", _GREATEST)}
    return {
        "number": core_schema.float_schema(**bounds, strict=True),
        "integer": core_schema.int_schema(**bounds, strict=True),
        "boolean": core_schema.bool_schema(strict=True),
        "string": core_schema.str_schema(strict=True),
    }[kind]
