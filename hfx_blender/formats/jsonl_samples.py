# SPDX-License-Identifier: GPL-3.0-or-later
"""Track as JSON Lines for game engines: a header, then vertex sets and samples in time order.

``docs/formats/samples.schema.json`` is the schema of a line. A set precedes the first sample using
the set. The effect at a vertex is weight times level times the strength parameter (for temperature:
times the difference from neutral).
"""

from __future__ import annotations

import operator
from collections import Counter
from collections.abc import Iterator, Sequence
from functools import lru_cache
from io import BytesIO
from itertools import islice
from pathlib import Path
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from ..engine.arrays import F32, I32
from ..engine.modality import MODALITIES
from ..engine.rendering.device_config import DeviceConfig
from ..engine.rendering.render import blocks
from ..engine.samples import SampleRun, Stream
from ..engine.stepwise import tell
from ..engine.track import TrackHeader, TrackReader
from ..errors import InputError
from ..files.atomic import atomic_file
from ..files.findings import Finding, Report, refuse_errors
from ..files.json_shapes import (
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
from ..files.strict_json import Place, clean, encoded, mapped_data, parse, shown
from .registry import FORMATS
from .written import Written

SUFFIX: Final = FORMATS["jsonl"].suffix
FORMAT: Final = "hfx-samples"

_WEIGHT_STEPS: Final = 10_000
_TOLD_AFTER: Final = 1 << 20  # bytes between two reports of progress
_LARGEST_TABLE: Final = 2**20
"""Smallest vertex id formatted individually instead of by table."""

_TEXT = Text()
_SHARE = Number(0.0, 1.0)
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
        },
    ),
}


def write(track: TrackReader, path: Path) -> None:
    """Write a track without positions, velocities and depths. Raises InputError for a damaged
    track, OutputError for an unwritable file; no partial file remains."""
    last: dict[Stream, tuple[bytes, int]] = {}  # each stream's latest set, and its number
    count = 0
    with atomic_file(path) as file:
        file.write(encoded(_header(track.header)))
        for block in blocks(track.header, track.runs()):
            # Samples of all streams in time order, a set before the first sample using it.
            entries = sorted(
                (int(index), b, k)
                for b, run in enumerate(block)
                for k, index in enumerate(run.indices)
            )
            for _, b, k in entries:
                run = block[b]
                j = k if run.sets is None else int(run.sets[k])
                part = slice(int(run.offsets[j]), int(run.offsets[j + 1]))
                vertices, weights = run.vertices[part], run.weights[part]
                content = vertices.tobytes() + weights.tobytes()
                # Streams often repeat a set for many samples: only changed content is written.
                if run.stream not in last or last[run.stream][0] != content:
                    file.write(_set_line(count, vertices, weights))
                    last[run.stream] = (content, count)
                    count += 1
                file.write(encoded(_sample(run, k, last[run.stream][1])))


def export(
    track: TrackReader, devices: Sequence[DeviceConfig], stem: Path, tolerance: float
) -> Written:
    """Write a track as ``stem.samples.jsonl``; ``devices`` and ``tolerance`` are not used."""
    path = stem.with_name(stem.name + SUFFIX)
    write(track, path)
    return Written((path,))


def _header(header: TrackHeader) -> dict[str, Any]:
    """Header line: rate, duration, models, bodies and effects."""
    time = header.time
    return {
        "type": "header",
        "format": FORMAT,
        "version": 1,
        "rate_hz": float(time.rate_hz),
        "duration_s": time.sample_count / float(time.rate_hz),
        "models": [
            {
                "id": model.id,
                "modality": model.modality,
                "hash": model.content_hash,
                "vertex_count": model.vertex_count,
            }
            for model in header.models
        ],
        "bodies": [{"id": clean(body.id), "name": clean(body.name)} for body in header.bodies],
        "effects": [
            {
                "id": clean(effect.id),
                "name": clean(effect.name),
                "modality": effect.modality,
                "kind": effect.kind,
                "model": effect.model_id,
                "is_contact": effect.is_contact,
                **(
                    {"device": clean(effect.device_id), "actuators": list(effect.actuators)}
                    if effect.device_id is not None
                    else {}
                ),
            }
            for effect in header.effects
        ],
    }


def _sample(run: SampleRun, k: int, set_number: int) -> dict[str, Any]:
    """JSON of sample ``k`` of a run, with the number of its set: time rounded to 1 ns, values to
    1e-6. With the place of a spot, m, or the values of actuators, to 1e-4, if the run has these."""
    extras: dict[str, Any] = {}
    if run.focus is not None:
        *centre, radius = (round(number, 6) for number in run.focus[k].astype(float).tolist())
        extras["spot"] = {"centre_m": centre, "radius_m": radius}
    if run.drive is not None:
        values = run.drive.values[k].astype(float).tolist()
        extras["actuators"] = [round(number, 4) for number in values]
    names = MODALITIES[run.stream.modality].parameter_names
    values = run.parameters[k].tolist()
    return {
        "type": "sample",
        "t": round(float(run.times_s[k]), 9),
        "effect": clean(run.stream.effect_id),
        "body": clean(run.stream.body_id),
        "set": set_number,
        "level": round(float(run.levels[k]), 6),
        **extras,
        "parameters": {name: round(value, 6) for name, value in zip(names, values, strict=True)},
    }


def _set_line(number: int, vertices: I32, weights: F32) -> bytes:
    """Encode vertices (n,), ascending, and weights 0..1 (n,) as the line of set ``number``. Weights
    are rounded to 1e-4. Numbers are looked up in tables of texts for speed."""
    # Formatting each number by itself would take most of the time of an export.
    steps = np.rint(weights * float(_WEIGHT_STEPS)).astype(np.int64)
    highest = int(vertices[-1]) if len(vertices) else 0
    if highest < _LARGEST_TABLE:
        ids = _joined(_texts(1 << highest.bit_length()), vertices)
    else:
        ids = ",".join(map(str, vertices.tolist())).encode()
    shares = _joined(_texts(_WEIGHT_STEPS + 1, is_weight=True), steps)
    head = f'{{"type":"set","set":{number},"vertices":['.encode()
    return head + ids + b'],"weights":[' + shares + b"]}\n"


def _joined(texts: npt.NDArray[np.uint64], chosen: npt.NDArray[Any]) -> bytes:
    """Concatenate the entries of a table of :func:`_texts` with the indices ``chosen`` (n,),
    without the final comma; empty for n = 0."""
    return texts[chosen].tobytes().translate(None, b"\0")[:-1]


@lru_cache(maxsize=5)
def _texts(count: int, *, is_weight: bool = False) -> npt.NDArray[np.uint64]:
    """Texts ``"<number>,"`` of 0 to ``count`` - 1, or of these times 1e-4 for ``is_weight``. Each
    is zero-padded to 8 bytes and viewed as an integer, which numpy indexes faster."""
    numbers = (step / _WEIGHT_STEPS if is_weight else step for step in range(count))
    return np.array([f"{number!r}," for number in numbers], "S8").view(np.uint64)


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
        else:
            self._check_sample(value, place)
        return True

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
        highest = self._sets.get(value["set"])
        if highest is None:
            self._report.error("SAMPLE-SET", place, f"there is no set {value['set']} before it")
        elif highest >= self._models.get(effect["model"], 0):
            self._report.error("SET-VERTEX", place, "the set has vertices beyond the model")
