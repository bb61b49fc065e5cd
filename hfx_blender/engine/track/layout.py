# SPDX-License-Identifier: GPL-3.0-or-later
"""Layout of a HapticTrack in the ZIP container: names, limits, and the index."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any, Final

from ...files.json_shapes import Items, Number, Text, loose
from .codec import CHANNELS
from .header_json import parse_json, value_in

HEADER: Final = "header.json"
INDEX: Final = "index.json"

SAMPLES_PER_CHUNK: Final = 128
"""Chunk size of the writer: chunk ``c`` holds samples ``128 c`` to ``128 c + 127``."""

MAX_SAMPLES_PER_CHUNK: Final = 4096
MAX_JSON_BYTES: Final = 2**24
MAX_CHUNK_BYTES: Final = 2**28

WEIGHTS_BYTE: Final = "uint8"
WEIGHTS_FULL: Final = "float32"


def chunk_name(chunk: int) -> str:
    """Name of a chunk's entry in the container: number with at least six digits."""
    return f"chunks/{chunk:06d}.bin"


@dataclass
class StreamIndex:
    """Index entry of a stream; sample numbers are those of the time base."""

    samples: int = 0
    first: int = -1  # sample index; -1 without samples
    last: int = -1
    entries: int = 0  # (sample, vertex) pairs
    peak_level: float = 0.0
    channels: tuple[str, ...] = ()

    def add(self, later: StreamIndex) -> None:
        """Merge the entry of later samples of the same stream, in place; an entry without samples
        changes nothing."""
        if not later.samples:
            return
        if self.first < 0:
            self.first = later.first
        self.last = later.last
        self.samples += later.samples
        self.entries += later.entries
        self.peak_level = max(self.peak_level, later.peak_level)
        both = {*self.channels, *later.channels}
        self.channels = tuple(name for name in CHANNELS if name in both)


_INDEX: Final = loose(
    {
        "chunks": Items(Number(is_whole=True), order="ascending"),
        "streams": Items(
            loose(
                {
                    **dict.fromkeys(("first", "last"), Number(is_whole=True)),
                    **dict.fromkeys(("samples", "entries"), Number(0, is_whole=True)),
                    "peak_level": Number(0.0, 1.0),
                    "channels": Items(Text(tuple(CHANNELS))),
                },
                into=StreamIndex,
            )
        ),
    }
)


_STORAGE: Final = loose(
    {
        "samples_per_chunk": Number(1, MAX_SAMPLES_PER_CHUNK, is_whole=True),
        "weights": Text((WEIGHTS_BYTE, WEIGHTS_FULL)),
    }
)


def storage_of(encoding: Mapping[str, Any]) -> dict[str, Any]:
    """Read ``samples_per_chunk`` and ``weights`` from a header's encoding; raises ValueError for a
    missing or invalid value."""
    storage: dict[str, Any] = value_in(encoding, _STORAGE, "encoding")
    return storage


def encode_index(chunks: list[int], streams: list[StreamIndex]) -> bytes:
    """Chunk numbers and the streams' entries as UTF-8 JSON with a final newline."""
    content = {"chunks": chunks, "streams": [asdict(stream) for stream in streams]}
    return json.dumps(content, sort_keys=True, allow_nan=False).encode() + b"\n"


def decode_index(text: bytes) -> tuple[list[int], list[StreamIndex]]:
    """Read ascending chunk numbers and one entry for each stream; raises ValueError if the text is
    no such index."""
    document = parse_json(text, "index")
    content = value_in(document, _INDEX, "index")
    return list(content["chunks"]), list(content["streams"])
