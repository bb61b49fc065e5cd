# SPDX-License-Identifier: GPL-3.0-or-later
"""Layout of a HapticTrack in its ZIP container: names, sizes, and the index at its end."""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass
from typing import Final

from .codec import CHANNELS
from .header_json import get, parse_json, texts

HEADER: Final = "header.json"
INDEX: Final = "index.json"

SAMPLES_PER_CHUNK: Final = 128
"""Chunk size of the writer: chunk ``c`` holds the samples ``128 c`` to ``128 c + 127``."""

MAX_SAMPLES_PER_CHUNK: Final = 4096
MAX_JSON_BYTES: Final = 2**24
MAX_CHUNK_BYTES: Final = 2**28

WEIGHTS_BYTE: Final = "uint8"
WEIGHTS_FULL: Final = "float32"


def chunk_name(chunk: int) -> str:
    """Entry of the container that holds a chunk."""
    return f"chunks/{chunk:06d}.bin"


@dataclass
class StreamIndex:
    """Index entry of one stream. Samples are counted by the time base."""

    samples: int = 0
    first: int = -1  # sample index; -1 if there is none
    last: int = -1
    entries: int = 0  # (sample, vertex) pairs
    peak_level: float = 0.0
    channels: tuple[str, ...] = ()

    def add(self, later: StreamIndex) -> None:
        """Merge the entry of later samples of the same stream."""
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


def encode_index(chunks: list[int], streams: list[StreamIndex]) -> bytes:
    """The index as UTF-8 JSON."""
    content = {"chunks": chunks, "streams": [asdict(stream) for stream in streams]}
    return json.dumps(content, sort_keys=True, allow_nan=False).encode() + b"\n"


def decode_index(text: bytes) -> tuple[list[int], list[StreamIndex]]:
    """The chunk numbers, ascending, and an entry for each stream.

    Raises
    ------
    ValueError
        It is not such JSON.
    """
    content = parse_json(text)
    chunks = get(content, "chunks", list)
    if any(type(chunk) is not int for chunk in chunks) or sorted(set(chunks)) != chunks:
        raise ValueError("the chunks of the index are not ascending whole numbers")
    streams = [
        StreamIndex(
            samples=get(item, "samples", int),
            first=get(item, "first", int),
            last=get(item, "last", int),
            entries=get(item, "entries", int),
            peak_level=get(item, "peak_level", float),
            channels=tuple(texts(get(item, "channels", list), "channels")),
        )
        for item in get(content, "streams", list)
    ]
    for stream in streams:
        if any(channel not in CHANNELS for channel in stream.channels):
            raise ValueError("the index names unknown channels")
        if min(stream.samples, stream.entries) < 0 or not 0.0 <= stream.peak_level <= 1.0:
            raise ValueError("a number of the index is out of range")
    return chunks, streams
