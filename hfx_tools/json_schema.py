# SPDX-License-Identifier: GPL-3.0-or-later
"""JSON Schemas of the document shapes of this package's readers.

``python docs/regenerate.py schema`` writes ``device_configs/schema/device.schema.json``.
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from typing import Any, Final

from hfx_blender.devices.configurations import device_shape
from hfx_blender.files.json_shapes import (
    PRINTABLE,
    Anything,
    Either,
    Flag,
    Items,
    Number,
    Record,
    Row,
    Shape,
    Table,
    Tagged,
    Text,
)

_Names = Mapping[int, str]
"""Names of shapes with a definition, by ``id()``."""

_DEFINITIONS: Final[Mapping[str, Shape]] = {
    "id": device_shape.ID,
    "text": PRINTABLE,
    "usb_id": device_shape.USB_ID,
    "parts": device_shape.BODY_PARTS,
    "actuator_type": device_shape.ACTUATOR_TYPE,
    "actuator": device_shape.ACTUATOR,
    "placement": device_shape.PLACEMENT,
    "vertices": device_shape.VERTICES,
}


def device_schema() -> str:
    """Build the text of the JSON Schema of device configurations."""
    names = {id(shape): name for name, shape in _DEFINITIONS.items()}
    schema = {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "$id": "urn:hfx-blender:device-configuration:1",
        "title": "HFX device configuration, version 1",
        "description": "The reader is stricter where a schema cannot be: repeated keys and ids, "
        "references between fields, ascending vertex ids, ranges that depend on other ranges.",
        **_schema(device_shape.DEVICE, names),
        "$defs": {name: _plain(shape, names) for name, shape in _DEFINITIONS.items()},
    }
    return json.dumps(schema, indent=2) + "\n"


def schema_of(shape: Shape) -> dict[str, Any]:
    """Build the JSON Schema of a shape, without references to definitions."""
    return _plain(shape, {})


def _schema(shape: Shape, names: _Names) -> dict[str, Any]:
    """Schema of a shape, or a reference for a shape with a definition."""
    if id(shape) in names:
        return {"$ref": f"#/$defs/{names[id(shape)]}"}
    return _plain(shape, names)


def _plain(shape: Shape, names: _Names) -> dict[str, Any]:
    match shape:
        case Number():
            return _number(shape)
        case Text():
            return _text(shape)
        case Flag():
            return {"type": "boolean"} if shape.only is None else {"const": shape.only}
        case Items():
            return _items(shape, names)
        case Row():
            return _row(shape, names)
        case Record():
            return _record(shape, names)
        case Table():
            key = {"propertyNames": _schema(shape.key, names)} if shape.key.pattern else {}
            item = _schema(shape.item, names)
            least = {"minProperties": shape.least} if shape.least else {}
            return {"type": "object", **least, **key, "additionalProperties": item}
        case Tagged():
            return _any_of([*shape.kinds.values()], names)
        case Either():
            return _any_of([shape.present, shape.absent], names)
        case Anything():
            return {}


def _any_of(shapes: list[Shape], names: _Names) -> dict[str, Any]:
    """Schema of alternatives; a single alternative is its own schema."""
    schemas = [_schema(shape, names) for shape in shapes]
    return schemas[0] if len(schemas) == 1 else {"anyOf": schemas}


def _number(shape: Number) -> dict[str, Any]:
    kind = {"type": "integer" if shape.is_whole else "number"}
    if shape.choices:
        return {"enum": list(shape.choices)}
    if shape.lowest == shape.highest:
        return {**kind, "const": shape.lowest}
    if shape.smallest:
        sides = ((shape.smallest, shape.highest), (shape.lowest, -shape.smallest))
        return {"anyOf": [{**kind, "minimum": low, "maximum": high} for low, high in sides]}
    ends = {"minimum": shape.lowest, "maximum": shape.highest}
    return kind | {key: value for key, value in ends.items() if math.isfinite(value)}


def _text(shape: Text) -> dict[str, Any]:
    if len(shape.choices) == 1:
        return {"const": shape.choices[0]}
    if shape.choices:
        return {"enum": list(shape.choices)}
    pattern = {"pattern": f"^(?:{shape.pattern})$"} if shape.pattern else {}
    return {"type": "string"} | pattern


def _items(shape: Items, names: _Names) -> dict[str, Any]:
    schema: dict[str, Any] = {"type": "array"}
    if shape.least:
        schema["minItems"] = shape.least
    if shape.most is not None:
        schema["maxItems"] = shape.most
    if shape.order == "unique" or (shape.order == "ascending" and isinstance(shape.item, Number)):
        schema["uniqueItems"] = True
    return {**schema, "items": _schema(shape.item, names)}


def _row(shape: Row, names: _Names) -> dict[str, Any]:
    count = {"minItems": len(shape.items), "maxItems": len(shape.items)}
    if all(item == shape.items[0] for item in shape.items):
        return {"type": "array", **count, "items": _schema(shape.items[0], names)}
    items = [_schema(item, names) for item in shape.items]
    return {"type": "array", **count, "prefixItems": items, "items": False}


def _record(shape: Record, names: _Names) -> dict[str, Any]:
    members = {**shape.required, **shape.optional}
    schema: dict[str, Any] = {
        "type": "object",
        "properties": {key: _schema(member, names) for key, member in members.items()},
    }
    if shape.required:
        schema["required"] = list(shape.required)
    if shape.unknown == "error":
        schema["additionalProperties"] = False
    if shape.one_of:
        schema["oneOf"] = [{"required": [key]} for key in shape.one_of]
    if shape.needs:
        schema["dependentRequired"] = {key: [needed] for key, needed in shape.needs.items()}
    conditions = [
        {"if": {"required": [key]}, "then": {"properties": {needed: {"const": True}}}}
        for key, needed in shape.needs.items()
        if isinstance(members[needed], Flag)
    ]
    if conditions:
        schema["allOf"] = conditions
    return schema
