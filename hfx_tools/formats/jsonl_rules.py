# SPDX-License-Identifier: GPL-3.0-or-later
"""Rules and facts of JSON Lines of samples."""

from __future__ import annotations

import operator
from collections import Counter
from collections.abc import Iterator
from io import BytesIO
from itertools import islice
from pathlib import Path
from typing import Any, Final

import numpy as np

from hfx_blender.engine.modality import MODALITIES
from hfx_blender.engine.stepwise import tell
from hfx_blender.errors import InputError
from hfx_blender.files.findings import Finding, Report, refuse_errors
from hfx_blender.files.json_shapes import (
    Flag,
    Items,
    Number,
    Record,
    Shape,
    Table,
    Text,
    check,
    strict,
)
from hfx_blender.files.strict_json import Place, mapped_data, parse, shown
from hfx_blender.formats.jsonl_samples import FORMAT

_TOLD_AFTER: Final = 1 << 20  # bytes between two reports of progress
_TEXT = Text()
_SHARE = Number(0.0, 1.0)
_ROUNDING: Final = 1e-4  # of limits in 32 bits, and of directions
_LINES: Final[dict[str, Shape]] = {
    "header": strict(
        {
            "type": _TEXT,
            "format": Text((FORMAT,)),
            "version": Number(1, 1, is_whole=True),
            "rate_hz": Number(1e-9),
            "duration_s": Number(0.0),
            "models": Items(
                strict(
                    {
                        "id": _TEXT,
                        "modality": _TEXT,
                        "hash": _TEXT,
                        "vertex_count": Number(1, is_whole=True),
                    }
                )
            ),
            "bodies": Items(strict({"id": _TEXT, "name": _TEXT})),
            "effects": Items(
                strict(
                    {
                        "id": _TEXT,
                        "name": _TEXT,
                        "modality": Text(tuple(MODALITIES)),
                        "kind": Text(("painted", "volume", "spot", "actuators")),
                        "model": _TEXT,
                        "is_contact": Flag(),
                    },
                    {"device": _TEXT, "actuators": Items(_TEXT)},
                )
            ),
        }
    ),
    "set": strict(
        {
            "type": _TEXT,
            "set": Number(0, is_whole=True),
            "vertices": Items(Number(0, 2**31 - 1, is_whole=True)),
            "weights": Items(_SHARE),
        }
    ),
    "sample": strict(
        {
            "type": _TEXT,
            "t": Number(),
            "effect": _TEXT,
            "body": _TEXT,
            "set": Number(0, is_whole=True),
            "level": _SHARE,
            "parameters": Table(Number()),
        },
        {
            "spot": Record({"centre_m": Items(Number(), least=3, most=3), "radius_m": Number(0.0)}),
            "actuators": Items(_SHARE),
            "forces_n": Items(Items(Number(), least=3, most=3)),
        },
    ),
}


def validate(content: bytes, name: str) -> list[Finding]:
    """Return the findings of all lines and references; InputError for a line without valid JSON. A
    single line is held in memory, if ``content`` is a mapped file."""
    report = Report("JSONL")
    for _ in _sound_lines(content, name, report):
        pass
    return report.findings


def read(path: Path) -> Iterator[dict[str, Any]]:
    """Yield the lines of a file, the header first; InputError for an unreadable file, and after
    the last valid line before a fault."""
    report = Report("JSONL")
    for line in _sound_lines(mapped_data(path), str(path), report):
        refuse_errors(report.findings, str(path))
        yield line
    refuse_errors(report.findings, str(path))


def facts(path: Path) -> dict[str, Any]:
    """Rate, duration, bodies, effects and counts for ``hfx info``; InputError for an invalid
    file."""
    lines = read(path)
    header = next(lines)
    counts = Counter(line["type"] for line in lines)
    return {
        "rate_hz": header["rate_hz"],
        "seconds": header["duration_s"],
        "bodies": [body["name"] for body in header["bodies"]],
        "effects": [effect["name"] for effect in header["effects"]],
        "samples": counts["sample"],
        "sets": counts["set"],
    }


def _sound_lines(content: bytes, name: str, report: Report) -> Iterator[dict[str, Any]]:
    """Yield lines without faults of structure, and add findings to ``report``; no lines without a
    valid header. Raises InputError for a line without valid JSON or a header with an ``encoding``.
    """
    rules = _Rules(report)
    source = BytesIO(content) if isinstance(content, bytes) else content  # a map reads lines
    done = told = 0
    # Faulty lines are dropped from the result, but checking goes on with the next line.
    for k, text in enumerate(iter(source.readline, b"")):
        done += len(text)
        if done - told > _TOLD_AFTER:
            told = done
            tell(done / len(content))
        value = parse(text, f"{name}, line {k + 1}")
        if k == 0 and isinstance(value, dict) and "encoding" in value:
            raise InputError(
                f"{name}: line 1: 'encoding' is {shown(value['encoding'])}, allowed is a header "
                "without it; export the scene again with 'hfx export SCENE.blend -f jsonl'."
            )
        if rules.is_sound(value, k == 0, (None, f"line {k + 1}")):
            yield value
        elif k == 0:  # without a header every other line would be reported
            return
    if not done:
        report.error("EMPTY", None, "it has no header")


class _Rules:
    """Checker of lines against the schema and earlier lines."""

    def __init__(self, report: Report) -> None:
        self._report = report
        self._sets: dict[int, int] = {}  # highest vertex by set
        self._sizes: dict[int, int] = {}  # vertex count by set
        self._models: dict[str, int] = {}  # vertex count by model
        self._effects: dict[str, dict[str, Any]] = {}
        self._bodies: set[str] = set()
        self._time_s = -np.inf

    def is_sound(self, value: Any, is_first: bool, place: Place) -> bool:
        """Report the faults of the next line, a header exactly if ``is_first``; False only for a
        fault of structure or schema."""
        kind = value.get("type") if isinstance(value, dict) else None
        if not isinstance(kind, str) or kind not in _LINES or (kind == "header") != is_first:
            self._report.error("LINE", place, "expected a header first, then sets and samples")
            return False
        # The rules below rely on members of the right types.
        before = self._report.count
        check(_LINES[kind], value, self._report, place)
        if self._report.count > before:
            return False
        if kind == "header":
            self._models = {model["id"]: model["vertex_count"] for model in value["models"]}
            self._effects = {effect["id"]: effect for effect in value["effects"]}
            self._bodies = {body["id"] for body in value["bodies"]}
            self._check_header(value, place)
        elif kind == "set":
            vertices, number = value["vertices"], value["set"]
            if len(vertices) != len(value["weights"]):
                self._report.error("SET-SIZE", place, "there are not as many weights as vertices")
            if not all(map(operator.lt, vertices, islice(vertices, 1, None))):
                self._report.error("SET-ORDER", place, "the vertices do not ascend")
            if number in self._sets:
                self._report.error("SET-DUPLICATE", place, f"the set {number} is there before")
            # Samples compare the largest with the vertex count of the model.
            self._sets[number] = max(vertices, default=-1)
            self._sizes[number] = len(vertices)
        else:
            self._check_sample(value, place)
        return True

    def _check_header(self, value: dict[str, Any], place: Place) -> None:
        """Report equal ids in a list, an unknown model of an effect, and actuators of an effect of
        another kind."""
        for key in ("models", "bodies", "effects"):
            twice = [id for id, count in Counter(x["id"] for x in value[key]).items() if count > 1]
            if twice:
                message = f"the id '{twice[0][:60]}' is there twice, allowed is once"
                self._report.error("ID-DUPLICATE", (place, key), message)
        for k, effect in enumerate(value["effects"]):
            here = ((place, "effects"), k)
            if effect["model"] not in self._models:
                message = f"is '{effect['model'][:60]}', allowed is the id of a model"
                self._report.error("MODEL", (here, "model"), message)
            for key in ("device", "actuators"):
                if (key in effect) != (effect["kind"] == "actuators"):
                    message = f"'{key}' is there for the kind actuators, and for no other kind"
                    self._report.error("KIND", here, message)

    def _check_sample(self, value: dict[str, Any], place: Place) -> None:
        """Report a sample with a descending time, unknown ids or set, or wrong parameters."""
        if value["t"] < self._time_s:
            self._report.error("ORDER", place, "the time is before the last sample")
        self._time_s = value["t"]
        effect = self._effects.get(value["effect"])
        if effect is None or value["body"] not in self._bodies:
            self._report.error("SAMPLE-ID", place, "the header has no such effect or body")
            return
        # The order of the parameters is a part of the format.
        expected = MODALITIES[effect["modality"]].parameter_names
        if tuple(value["parameters"]) != expected:
            self._report.error("SAMPLE-PARAMETERS", place, f"expected {', '.join(expected)}")
        for parameter in MODALITIES[effect["modality"]].parameters:
            found = value["parameters"].get(parameter.name, parameter.default)
            low, high = parameter.minimum, parameter.maximum
            if not low - _ROUNDING <= found <= high + _ROUNDING:
                here = ((place, "parameters"), parameter.name)
                message = f"is {found:g}, allowed is {low:g} to {high:g} {parameter.unit}"
                self._report.error("SAMPLE-RANGE", here, message.rstrip())
        if "spot" in value and effect["kind"] != "spot":
            self._report.error("KIND", place, f"'spot' of an effect of the kind {effect['kind']}")
        count = len(effect.get("actuators", ()))
        if len(value.get("actuators", ())) != count:
            found = len(value.get("actuators", ()))
            message = f"has {found} values, allowed is one for each of {count} actuators"
            self._report.error("SAMPLE-ACTUATORS", (place, "actuators"), message)
        highest = self._sets.get(value["set"])
        if highest is None:
            self._report.error("SAMPLE-SET", place, f"there is no set {value['set']} before it")
        elif len(value.get("forces_n", ())) not in (0, self._sizes[value["set"]]):
            self._report.error("SAMPLE-FORCES", place, "expected a force for each vertex")
        elif highest >= self._models.get(effect["model"], 0):
            self._report.error("SET-VERTEX", place, "the set has vertices beyond the model")
