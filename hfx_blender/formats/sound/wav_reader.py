# SPDX-License-Identifier: GPL-3.0-or-later
"""Structure of WAV files, and checks of their sizes."""

from __future__ import annotations

import struct
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np

from ...files.findings import Finding, Report
from ...files.strict_json import mapped

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
    is_float: bool
    frames: int


def validate(content: bytes, name: str) -> list[Finding]:
    """Return the findings of a file."""
    return inspect(content)[1]


def facts(path: Path) -> dict[str, Any]:
    """Channels, rate, sample type and duration of a valid file for ``hfx info``."""
    form, _ = inspect(mapped(path))
    assert form is not None
    return {
        "channels": form.channels,
        "rate_hz": form.rate_hz,
        "samples": f"{form.bits} bit {'float' if form.is_float else 'integer'}",
        "seconds": round(form.frames / form.rate_hz, 6),
    }


def inspect(content: bytes) -> tuple[WavForm | None, list[Finding]]:
    """Return the storage format of a file (None without fmt or data chunk) and its findings."""
    report = Report("WAV")
    if content[:4] != b"RIFF" or content[8:12] != b"WAVE":
        report.error("RIFF", None, "it does not begin with RIFF and WAVE")
        return None, report.findings
    (size,) = struct.unpack_from("<I", content, 4)
    if size + 8 != len(content):
        report.error("SIZE", None, f"it says {size + 8} bytes, there are {len(content)}")
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
        at += 8 + length + length % 2
    for kind in (b"fmt ", b"data"):
        if kind not in chunks or (kind == b"fmt " and chunks[kind][1] < 16):
            report.error("CHUNK", None, f"it has no chunk '{kind.decode()}'")
            return None, report.findings
    return _form(content, chunks, report), report.findings


def _form(content: bytes, chunks: dict[bytes, tuple[int, int]], report: Report) -> WavForm:
    """Parse the fmt chunk and report contradictory sizes."""
    start, length = chunks[b"fmt "]
    tag, channels, rate, byte_rate, frame, bits = struct.unpack_from("<HHIIHH", content, start)
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
    return WavForm(channels, rate, bits, tag == _FLOAT, frames)


def _is_finite(content: bytes, begin: int, length: int, width: int) -> bool:
    """Test floating-point samples of ``width`` bytes for finite values, block by block."""
    end = begin + length - length % width
    parts = (content[at : min(at + _BLOCK_BYTES, end)] for at in range(begin, end, _BLOCK_BYTES))
    return all(np.isfinite(np.frombuffer(part, f"<f{width}")).all() for part in parts)
