# SPDX-License-Identifier: GPL-3.0-or-later
"""A wrong value in every field of the JSON Schema; schema and reader agree.

The fields come from a walk of the schema. A new field fails the first test until a document has the
field; then all tests cover the field.
"""

from __future__ import annotations

import copy
import json
import re
from collections.abc import Iterator
from typing import Any

import jsonschema
import pytest
from device_documents import FULL, documents, with_list
from hypothesis import given, settings
from hypothesis import strategies as st
from test_output_configuration import GOOD, with_output

from hfx_blender.devices.configurations.configuration_reader import device_from
from hfx_blender.errors import InputError
from hfx_blender.files import resources
from hfx_blender.files.json_shapes import node_of
from hfx_tools.json_schema import device_schema

SCHEMA = json.loads(
    (resources.device_configs() / "schema" / "device.schema.json").read_text(encoding="utf-8")
)
VALIDATOR = jsonschema.Draft202012Validator(SCHEMA)
DOCUMENTS = documents(
    {name: with_output(copy.deepcopy(FULL), item) for name, (item, _) in GOOD.items()}
)
DOCUMENTS["output text stop"] = copy.deepcopy(FULL) | {
    "output": {"encoder": GOOD["text"][0]["encoder"] | {"stop": "STOP"}}
}
DOCUMENTS |= {
    f"list of {name}": with_list(document)
    for name, document in DOCUMENTS.items()
    if "output" in document
}

KINDS = ("scheme", "modality", "kind", "as")
"""Members whose value says which of several objects one is."""

Place = tuple[str | int, ...]


def resolved(schema: Any) -> Any:
    while "$ref" in schema:
        schema = SCHEMA["$defs"][schema["$ref"].removeprefix("#/$defs/")]
    return schema


def kind_of(members: dict[str, Any]) -> str:
    """Return ``[ring]`` for an object with the ``scheme`` ``ring``; usually empty."""
    return "".join(f"[{members[key]}]" for key in KINDS if isinstance(members.get(key), str))


def fields_of_schema(schema: Any, path: str = "") -> Iterator[tuple[str, Any]]:
    """Yield the path and the allowed values of each member and list element in the schema."""
    schema = resolved(schema)
    for item in schema.get("anyOf", ()):
        yield from fields_of_schema(item, path)
    known = schema.get("properties", {})
    here = path + kind_of({key: item.get("const") for key, item in known.items()})
    for key, item in known.items():
        yield f"{here}.{key}", resolved(item)
        yield from fields_of_schema(item, f"{here}.{key}")
    lists = [schema[key] for key in ("items", "additionalProperties") if schema.get(key)]
    for item in [*lists, *schema.get("prefixItems", ())]:
        yield f"{path}.*", resolved(item)
        yield from fields_of_schema(item, f"{path}.*")


def fields_of(value: Any, at: Place = (), path: str = "") -> Iterator[tuple[str, Place]]:
    """Yield fields of a document with the path of each."""
    if isinstance(value, dict):
        is_free = path == ".actuator_types" or path.endswith(".custom")
        here = path + kind_of(value)
        for key, item in value.items():
            inner = f"{path}.*" if is_free else f"{here}.{key}"
            yield inner, (*at, key)
            yield from fields_of(item, (*at, key), inner)
    elif isinstance(value, list):
        for k, item in enumerate(value):
            yield f"{path}.*", (*at, k)
            yield from fields_of(item, (*at, k), f"{path}.*")


ALLOWED: dict[str, list[Any]] = {}
for _path, _schema in fields_of_schema(SCHEMA):
    ALLOWED.setdefault(_path, []).extend(map(resolved, _schema.get("anyOf", [_schema])))

FIRST: dict[str, tuple[str, Place]] = {}
"""A document in which each field is, and where."""
for _name, _document in DOCUMENTS.items():
    for _path, _place in fields_of(_document):
        FIRST.setdefault(_path, (_name, _place))

OF_ANY_TYPE = [None, True, 0.5, "?", [], {}]
UNKNOWN = "unknown_field"


def put(document: Any, path: Place, value: Any) -> Any:
    *keys, last = path
    for key in keys:
        document = document[key]
    document[last] = value


def at(document: Any, path: Place) -> Any:
    for key in path:
        document = document[key]
    return document


def refusal(document: Any) -> str | None:
    """Return the reader's message about a document, or None without a message."""
    content = document if isinstance(document, bytes) else json.dumps(document).encode()
    try:
        device_from(node_of(content, "device.json"))
    except InputError as error:
        return str(error)
    return None


def check_refused(content: Any, path: Place, why: str) -> None:
    message = refusal(content)
    assert message is not None, f"{path} {why} is accepted"
    assert message.startswith("device.json: ") and message.endswith(".") and "\n" not in message, (
        message
    )
    assert len(message) < 1500, message
    names = [item for item in path if isinstance(item, str)]
    assert any(name in message for name in names[-2:]), f"{path} {why}: {message}"


def type_name(value: Any) -> str:
    is_number = isinstance(value, int | float) and not isinstance(value, bool)
    return "number" if is_number else type(value).__name__


def with_raw(document: Any, path: Place, raw: str) -> bytes:
    """Return a document's bytes with raw text at a place, for text outside JSON writers."""
    document = copy.deepcopy(document)
    put(document, path, "@raw@")
    return json.dumps(document).replace('"@raw@"', raw).encode()


def test_every_field_of_the_schema_is_in_a_document():
    assert not sorted(set(ALLOWED) - set(FIRST)), "use them in device_documents.py"
    assert not sorted(set(FIRST) - set(ALLOWED)), "the schema does not know them"


@pytest.mark.parametrize("name", DOCUMENTS)
def test_the_documents_are_right_for_reader_and_schema(name):
    assert refusal(DOCUMENTS[name]) is None
    VALIDATOR.validate(DOCUMENTS[name])


@pytest.mark.parametrize("path", sorted(ALLOWED))
def test_every_field_wrong_in_turn(path):
    name, path_in_document = FIRST[path]
    whole = DOCUMENTS[name]
    value = at(whole, path_in_document)
    wrong: list[tuple[str, Any]] = [
        (f"as {content!r}", content)
        for content in OF_ANY_TYPE
        if type_name(content) != type_name(value)
    ]
    most = 400
    for schema in ALLOWED[path]:
        wrong += [("too low", schema["minimum"] - 1)] if "minimum" in schema else []
        wrong += [("too high", schema["maximum"] + 1)] if "maximum" in schema else []
        most = max(most, schema.get("maxItems", 0))
    if type_name(value) == "number":
        wrong += [("huge", 1e300), ("huge", -1e300), ("huge", 10**19)]
    elif isinstance(value, str):
        wrong += [("huge", "x" * 10_000), ("with a line", value + "\n"), ("maybe", "")]
    elif isinstance(value, list):
        wrong += [
            ("huge", (value * (most // len(value) + 1))[: most + 1]),
            ("null", [*value, None]),
        ]
    elif isinstance(value, dict):
        wrong += [("unknown", value | {UNKNOWN: 1})]
    for why, content in wrong:
        document = copy.deepcopy(whole)
        put(document, path_in_document, content)
        # Another allowed kind; and in Python, unlike in the standard, $ also matches before a line
        # feed.
        if why in ("maybe", "too low", "too high") and VALIDATOR.is_valid(document):
            continue
        check_refused(
            document, (*path_in_document, UNKNOWN) if why == "unknown" else path_in_document, why
        )
        if why in ("as None", "as 0.5", "as '?'"):  # the schema is slow, so only for some values
            assert not VALIDATOR.is_valid(document), f"the schema accepts {path_in_document} {why}"
    for raw in ("NaN", "-Infinity", "1e999", "9" * 40):
        check_refused(with_raw(whole, path_in_document, raw), path_in_document, raw)
    if isinstance(path_in_document[-1], str):
        twice = f"0, {json.dumps(path_in_document[-1])}: {json.dumps(value)}"
        check_refused(with_raw(whole, path_in_document, twice), path_in_document, "twice")


@pytest.mark.parametrize("path", sorted(ALLOWED))
def test_schema_and_reader_agree_on_optional_fields(path):
    name, path_in_document = FIRST[path]
    document = copy.deepcopy(DOCUMENTS[name])
    del at(document, path_in_document[:-1])[path_in_document[-1]]
    message = refusal(document)
    if VALIDATOR.is_valid(document):
        assert message is None or reader_only(message), message
    else:
        assert message is not None, f"only the schema needs {path_in_document}"
        check_refused(document, path_in_document, "missing")


READER_ONLY = re.compile(
    r"ascending|which an actuator before it has|both rise|allowed is [0-9]+ items"
    r"|\.(type|as|unit) is .*, allowed is one of "
    "|has no 'mount'|differs for each|each model once|the hottest allowed|a direction"
    r"|\.(parameters|limits)\..*, allowed is a number from "
    r"|\.custom\..*, allowed is (0|-?[0-9.]+|a number from .*)\.$"
    "|not silent at its minimum|actuators at most|once round is|of a private network"
    "|for all actuators|no other output has|next to 'output'"
    "|allowed is a list with|have a range only|a name other than those"
)
"""What the reader says of faults that a schema cannot see."""


def reader_only(told: str) -> bool:
    return READER_ONLY.search(told) is not None


values = st.recursive(
    st.one_of(
        st.none(),
        st.booleans(),
        st.integers(-3, 300),
        st.floats(-1e4, 1e4),
        st.sampled_from([0, 0.5, 1, 100, 1e6, "", "left", "right", "motor", "vibration", "ff"]),
        st.sampled_from(["kPa", "torso", "Vibrate", "VestFront", "/a/{number}", "0x1234", "log"]),
        st.text(max_size=5),
    ),
    lambda inner: st.lists(inner, max_size=3),
    max_leaves=4,
)


@given(st.sampled_from(sorted(FIRST)), values, st.sampled_from(["put", "remove", "twice", "add"]))
@settings(max_examples=100)
def test_schema_and_reader_agree_on_anything(path, value, action):
    name, path_in_document = FIRST[path]
    document = copy.deepcopy(DOCUMENTS[name])
    inside = at(document, path_in_document[:-1])
    if action == "put":
        put(document, path_in_document, value)
    elif action == "remove":
        del inside[path_in_document[-1]]
    elif action == "add" and isinstance(inside, dict):
        inside[str(value)[:20]] = value
    elif isinstance(inside, list):
        inside.append(copy.deepcopy(inside[path_in_document[-1]]))
    message = refusal(document)
    if VALIDATOR.is_valid(document):
        assert message is None or reader_only(message), message
    else:
        assert message is not None, "only the schema refuses this"


def test_the_published_schema_is_the_one_that_the_shapes_give():
    reason = "made by 'python docs/regenerate.py schema'"
    path = resources.device_configs() / "schema" / "device.schema.json"
    assert path.read_text(encoding="utf-8") == device_schema(), reason
