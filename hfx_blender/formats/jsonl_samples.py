# SPDX-License-Identifier: GPL-3.0-or-later
"""Track as JSON Lines for game engines: a header, then vertex sets and samples in time order.

``docs/formats/samples.schema.json`` is the schema of a line. A set precedes the first sample using
the set. The effect at a vertex is weight times level times the strength parameter (for temperature:
times the difference from neutral).
"""

from functools import lru_cache
from pathlib import Path
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from ..engine.arrays import F32, I32
from ..engine.modality import MODALITIES
from ..engine.rendering.render import blocks
from ..engine.samples import SampleRun, Stream
from ..engine.track import TrackHeader, TrackReader
from ..files.atomic import atomic_file
from ..files.strict_json import clean, encoded
from .registry import FORMATS
from .written import single_file

SUFFIX: Final = FORMATS["jsonl"].suffix
FORMAT: Final = "hfx-samples"

_WEIGHT_STEPS: Final = 10_000
_LARGEST_TABLE: Final = 2**20
"""Smallest vertex id formatted individually instead of by table."""


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


export: Final = single_file(write, SUFFIX)


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
    1e-6. With the place of a spot, m, the values of actuators, to 1e-4, or the forces on vertices,
    to 0.1 mN, if the run has these."""
    extras: dict[str, Any] = {}
    if run.focus is not None:
        *centre, radius = (round(number, 6) for number in run.focus[k].astype(float).tolist())
        extras["spot"] = {"centre_m": centre, "radius_m": radius}
    if run.drive is not None:
        values = run.drive.values[k].astype(float).tolist()
        extras["actuators"] = [round(number, 4) for number in values]
    if run.forces_n is not None:  # such a run has a set for each sample
        part = slice(int(run.offsets[k]), int(run.offsets[k + 1]))
        extras["forces_n"] = run.forces_n[part].astype(float).round(4).tolist()
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
