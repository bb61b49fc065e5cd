# SPDX-License-Identifier: GPL-3.0-or-later
"""Shapes of JSON documents: refusals, messages, and the generated schema.

Messages are written out by hand; the package jsonschema judges the schemas.
"""

from __future__ import annotations

import json
from dataclasses import dataclass
from typing import Any

import jsonschema
import pytest

from hfx_blender.errors import InputError
from hfx_blender.files.findings import Report
from hfx_blender.files.json_shapes import (
    Either,
    Flag,
    Items,
    Number,
    Record,
    Shape,
    Text,
    check,
    curve,
    node_of,
    numbers,
    strict,
    tagged,
)
from hfx_tools.json_schema import schema_of


@dataclass(frozen=True)
class Disc:
    kind: str
    radius_m: float
    at_m: tuple[float, ...] = (0.0, 0.0)


SHAPE = strict(
    {
        "area": tagged(
            "kind",
            {
                "disc": strict(
                    {"radius_m": Number(0.0, 2.0, "m")}, {"at_m": numbers(2, -1, 1)}, into=Disc
                ),
                "parts": strict({"names": Items(Text(("arm", "leg")), 1, 2, order="unique")}),
            },
        )
    },
    {
        "bend_mm": Number(-50.0, 50.0, "mm", smallest=3.0),
        "wave": Text(("sine", "noise")),
        "has_wave": Flag(),
        "ids": Items(Number(0, 9, is_whole=True), order="ascending"),
        "level": curve(),
        "range": Either("fixed", strict({"fixed": Number()}), strict({"low": Number()})),
        "one": Text(),
        "other": Text(),
    },
    needs={"wave": "has_wave"},
)
DISC = {"area": {"kind": "disc", "radius_m": 1}}

FAULTS = [
    ([], "the document is [], allowed is an object"),
    ({}, "'area' is missing"),
    (DISC | {"are": 1}, "'are' is unknown, allowed are: area, bend_mm"),
    ({"area": {"kind": "cone"}}, 'area.kind is "cone", allowed is one of disc, parts'),
    ({"area": {"radius_m": 1}}, "area: 'kind' is missing"),
    ({"area": {"kind": "disc", "radius_m": 3}}, "radius_m is 3, allowed is a number from 0 to 2 m"),
    ({"area": {"kind": "disc", "radius_m": True}}, "area.radius_m is true, allowed is a number"),
    ({"area": {"kind": "parts", "names": ["leg", "leg"]}}, 'area.names is ["leg", "leg"], allowed'),
    (DISC | {"bend_mm": -2}, "is -2, allowed is a number from 3 to 50 mm, or its negative"),
    (DISC | {"wave": "sine"}, 'wave is "sine", allowed is left out: it needs "has_wave": true'),
    (DISC | {"wave": "sine", "has_wave": False}, 'it needs "has_wave": true'),
    (DISC | {"ids": [4, 3]}, "ids[1] is 3, allowed is a number above 4"),
    (DISC | {"ids": [4.0]}, "ids[0] is 4.0, allowed is a whole number from 0 to 9"),
    (DISC | {"level": [[1, 0], [0.5, 0]]}, "level[1][0] is 0.5, allowed is a number not below 1"),
    (DISC | {"level": [[1, 0, 0]]}, "level[0] is [1, 0, 0], allowed is 2 items"),
    (DISC | {"range": {"fixed": 1, "low": 1}}, "range: 'low' is unknown, allowed are: fixed"),
    (DISC | {"range": {}}, "range: 'low' is missing"),
]
SEEN_BY_READERS_ONLY = ("ids[1]", "level[1]", "4.0")  # orders; 4.0 is whole in JSON Schema


@pytest.mark.parametrize(("document", "message"), FAULTS)
def test_a_fault_names_path_found_and_allowed(document: Any, message: str) -> None:
    with pytest.raises(InputError) as caught:
        node_of(json.dumps(document).encode(), "x.json").hold(SHAPE)
    assert str(caught.value).startswith("x.json: ") and message in str(caught.value)
    is_seen = not any(item in message for item in SEEN_BY_READERS_ONLY)
    assert jsonschema.Draft202012Validator(schema_of(SHAPE)).is_valid(document) != is_seen


def test_values_are_converted_by_shape() -> None:
    document = DISC | {"bend_mm": 3, "wave": "noise", "has_wave": True, "ids": [1, 2]}
    jsonschema.Draft202012Validator(schema_of(SHAPE)).validate(document)
    value = node_of(json.dumps(document).encode(), "x.json").read(SHAPE)
    assert value["area"] == Disc("disc", 1.0) and type(value["area"].radius_m) is float
    assert value["ids"] == (1, 2) and type(value["bend_mm"]) is float


@pytest.mark.parametrize(
    ("shape", "wrong", "message"),
    [
        (Record({}, {"a": Text(), "b": Text()}, one_of=("a", "b")), {}, "exactly one of a, b"),
        (Record({}, {"a": Text(), "b": Text()}, one_of=("a", "b")), {"a": "", "b": ""}, "one of"),
    ],
)
def test_exactly_one_of_some_members_is_there(shape: Shape, wrong: Any, message: str) -> None:
    with pytest.raises(InputError, match=message):
        node_of(json.dumps(wrong).encode(), "x").hold(shape)
    validator = jsonschema.Draft202012Validator(schema_of(shape))
    assert not validator.is_valid(wrong) and validator.is_valid({"b": ""})


@pytest.mark.parametrize("mark", [b"", b"\xef\xbb\xbf"])
def test_parser_faults_are_reported_with_path(mark: bytes) -> None:
    assert node_of(mark + b'{"a": [1, 2]}', "x")["a"].value == [1, 2]
    for text, message in (
        (b'{"a": [1, NaN]}', "x: a[1]: the number NaN is not finite."),
        (b'{"a": {"b": 1, "b": 2}}', "x: a: the key 'b' is there twice in one object."),
        (b'{"a": 123456789012345678901}', "x: a: the number 12345678901234567890... is too long."),
    ):
        with pytest.raises(InputError) as caught:
            node_of(mark + text, "x")
        assert str(caught.value) == message


def test_a_large_value_is_not_repeated_whole() -> None:
    with pytest.raises(InputError) as caught:
        node_of(json.dumps([[7] * 100_000]).encode(), "x").hold(Record())
    assert len(str(caught.value)) < 120


@pytest.mark.parametrize(
    ("item", "values", "faults"),
    [
        (Number(0.0, 1.0), [0, 0.5, 1], []),
        (Number(0.0, 1.0), [0.5, 1.5, -0.1], [("RANGE", "[1]"), ("RANGE", "[2]")]),
        (Number(0.0, 1.0), [0.5, True], [("TYPE", "[1]")]),  # true is no full power
        (Number(0.0, 1.0), [0.5, float("nan"), 0.7], [("RANGE", "[1]")]),
        (Number(), [1, float("nan")], [("RANGE", "[1]")]),
        (Number(0, 9, is_whole=True), [0, 9], []),
        (Number(0, 9, is_whole=True), [0, 9.0], [("TYPE", "[1]")]),
        (Number(0, 9, choices=(1, 2)), [1, 3], [("RANGE", "[1]")]),
        (Number(-1.0, 1.0, smallest=0.5), [0.5, 0.1], [("RANGE", "[1]")]),
        (Number(), ["1"], [("TYPE", "[0]")]),
    ],
)
def test_each_fault_in_a_list_of_numbers_is_found(
    item: Number, values: list[Any], faults: list[tuple[str, str]]
) -> None:
    report = Report("X")
    check(Items(item), values, report)
    assert [(finding.code, finding.place) for finding in report.findings] == [
        (f"X-{code}", place) for code, place in faults
    ]
