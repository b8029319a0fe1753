"""The few words of JSON Schema that the log's messages need."""

from __future__ import annotations

from typing import Any

Schema = dict[str, Any]

NUMBER: Schema = {"type": "number"}
INTEGER: Schema = {"type": "integer"}
COUNT: Schema = {"type": "integer", "minimum": 0}
TEXT: Schema = {"type": "string"}
FLAG: Schema = {"type": "boolean"}
OBJECT: Schema = {"type": "object"}


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
