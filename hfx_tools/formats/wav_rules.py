# SPDX-License-Identifier: GPL-3.0-or-later
"""Structure and rules of WAV files and channel lists."""

from __future__ import annotations

import struct
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np

from hfx_blender.files.findings import Finding, Report
from hfx_blender.files.json_shapes import Items, Number, Record, Shape, Text, check
from hfx_blender.files.strict_json import mapped, parse, read_bytes

_PCM, _FLOAT, _EXTENSIBLE = 1, 3, 0xFFFE
_BITS: Final = {_PCM: (8, 16, 24, 32), _FLOAT: (32, 64)}
_MOST_CHUNKS: Final = 1000
_BLOCK_BYTES: Final = 1 << 22


@dataclass(frozen=True)
class WavForm:
    """Storage format of the samples."""

    channels: int
    rate_hz: int
    bits: int
    kind: int  # 1: integers, 3: floating-point numbers; others are compressed
    frames: int
    begin: int  # first byte of the samples

    @property
    def is_float(self) -> bool:
        return self.kind == _FLOAT

    @property
    def is_plain(self) -> bool:
        """True for samples without compression, of a known size."""
        return self.bits in _BITS.get(self.kind, ()) and bool(self.channels and self.rate_hz)


def validate(content: bytes, name: str) -> list[Finding]:
    """Return the findings of a file; empty: valid. ``name`` is unused."""
    return inspect(content)[1]


def facts(path: Path) -> dict[str, Any]:
    """Channels, rate, sample type and duration of a validated file for ``hfx info``."""
    form, _ = inspect(mapped(path))
    assert form is not None
    return {
        "channels": form.channels,
        "rate_hz": form.rate_hz,
        "samples": f"{form.bits} bit {'float' if form.is_float else 'integer'}",
        "seconds": round(form.frames / form.rate_hz, 6),
    }


def inspect(content: bytes) -> tuple[WavForm | None, list[Finding]]:
    """Storage format (None for no WAV, or without fmt or data chunk) and findings of a file."""
    report = Report("WAV")
    if content[:4] != b"RIFF" or content[8:12] != b"WAVE":
        report.error("RIFF", None, "it does not begin with RIFF and WAVE")
        return None, report.findings
    (size,) = struct.unpack_from("<I", content, 4)
    if size + 8 != len(content):
        report.error("SIZE", None, f"it says {size + 8} bytes, there are {len(content)}")
    # The first chunk of each kind counts; a truncated chunk ends at the file's end.
    chunks: dict[bytes, tuple[int, int]] = {}
    at = 12
    while at + 8 <= len(content) and len(chunks) < _MOST_CHUNKS:
        kind = content[at : at + 4]
        (length,) = struct.unpack_from("<I", content, at + 4)
        if at + 8 + length > len(content):
            title = kind.decode("latin-1")
            report.error("CHUNK", None, f"the chunk '{title}' is longer than the file")
            length = len(content) - at - 8
        chunks.setdefault(kind, (at + 8, length))
        # Chunks begin at even bytes.
        at += 8 + length + length % 2
    for kind in (b"fmt ", b"data"):
        if kind not in chunks or (kind == b"fmt " and chunks[kind][1] < 16):
            report.error("CHUNK", None, f"it has no chunk '{kind.decode()}'")
            return None, report.findings
    return _form(content, chunks, report), report.findings


def _form(content: bytes, chunks: dict[bytes, tuple[int, int]], report: Report) -> WavForm:
    """Storage format of the fmt chunk; reports unknown kinds, wrong sizes and non-finite samples.
    ``chunks``: (first byte, length) by name."""
    start, length = chunks[b"fmt "]
    tag, channels, rate, byte_rate, frame, bits = struct.unpack_from("<HHIIHH", content, start)
    # The extensible form has the real sample format in its first two GUID bytes.
    is_extensible = tag == _EXTENSIBLE
    mask = 0
    if is_extensible and length >= 40:
        (mask,) = struct.unpack_from("<I", content, start + 20)
        (tag,) = struct.unpack_from("<H", content, start + 24)
    elif is_extensible:
        report.error("EXTENSIBLE", None, "its extensible form is cut short")
    if bits not in _BITS.get(tag, ()):
        report.error("FORM", None, f"samples of the kind {tag} with {bits} bits")
    if not channels or not rate:
        report.error("FORM", None, f"{channels} channels at {rate} Hz")
    if frame != channels * bits // 8 or byte_rate != rate * frame:
        report.error("FORM", None, "the sizes in its form contradict each other")
    if channels > 2 and not is_extensible:
        report.warn("EXTENSIBLE", None, "more than two channels without the extensible form")
    if mask.bit_count() > channels:
        report.error("MASK", None, "its mask names more loudspeakers than there are channels")
    begin, data = chunks[b"data"]
    if frame and data % frame:
        report.error("DATA", None, "the last sample is not complete")
    if tag == _FLOAT and bits in _BITS[_FLOAT] and not _is_finite(content, begin, data, bits // 8):
        report.error("DATA", None, "it has samples that are not finite numbers")
    frames = data // frame if frame else 0
    return WavForm(channels, rate, bits, tag, frames, begin)


def _is_finite(content: bytes, begin: int, length: int, width: int) -> bool:
    """Test floating-point samples of ``width`` bytes for finite values."""
    # Block by block, as a mapped file may be larger than the memory.
    end = begin + length - length % width
    parts = (content[at : min(at + _BLOCK_BYTES, end)] for at in range(begin, end, _BLOCK_BYTES))
    return all(np.isfinite(np.frombuffer(part, f"<f{width}")).all() for part in parts)


_CHANNEL: Final = Number(0, is_whole=True)
_SHARED: Final[dict[str, Shape]] = {
    "version": Number(1, 1, is_whole=True),
    "rate_hz": Number(1, is_whole=True),
    "start_s": Number(),
}
_ACTUATOR: Final = Record({"channel": _CHANNEL, "actuator": Text()})
_LOUDSPEAKER: Final = Record(
    {
        "channel": _CHANNEL,
        "azimuth_deg": Number(-360.0, 360.0),
        "elevation_deg": Number(-90.0, 90.0),
    }
)
_KINDS: Final = {
    "hfx-wav-channels": Record(
        {
            **_SHARED,
            "format": Text(("hfx-wav-channels",)),
            "device": Text(),
            "body": Text(),
            "full_scale_m_s2": Number(0.0),
            "channels": Items(_ACTUATOR, least=1),
        }
    ),
    "hfx-sound-channels": Record(
        {
            **_SHARED,
            "format": Text(("hfx-sound-channels",)),
            "layout": Text(),
            "gain": Number(0.0, 1.0),
            "channels": Items(_LOUDSPEAKER, least=1),
        }
    ),
}


def validate_channels(content: bytes, name: str) -> list[Finding]:
    """Return the findings of a channel list: schema errors, or else channels out of order. Raises
    InputError without valid JSON."""
    document = parse(content, name)
    report = Report("CHANNELS")
    kind = document.get("format") if isinstance(document, dict) else None
    # An unknown format is compared with the first kind, whose rule of "format" then fails.
    first = next(iter(_KINDS.values()))
    check(_KINDS.get(kind, first) if isinstance(kind, str) else first, document, report)
    if not report.has_errors:
        for k, channel in enumerate(document["channels"]):
            if channel["channel"] != k:
                message = f"{channel['channel']} is not the channel's place in the sound, {k}"
                report.error("ORDER", ((None, "channels"), k), message)
    return report.findings


def channel_facts(path: Path) -> dict[str, Any]:
    """Device and body, or layout, rate and channel count of a valid file for ``hfx info``."""
    document = parse(read_bytes(path), str(path))
    origin = {key: document[key] for key in ("device", "body", "layout") if key in document}
    return {**origin, "rate_hz": document["rate_hz"], "channels": len(document["channels"])}
