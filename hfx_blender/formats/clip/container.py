# SPDX-License-Identifier: GPL-3.0-or-later
"""Container of a clip: types of its records, and writing, as in ``docs/formats/clip.md``."""

import csv
import struct
import zlib
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from ...files import limits
from ...files.limits import TooLargeError
from ...files.strict_json import clean
from ..registry import FORMATS

SUFFIX: Final = FORMATS["clip"].suffix
VERSION: Final = 1
NONE: Final = 0xFFFFFFFF
MOST_TEXT: Final = 1000
"""Largest length of a text, bytes."""

MAGIC: Final = b"HFXCLIP\n"
HEAD: Final = struct.Struct("<8sIIII")
SECTION: Final = struct.Struct("<4sIII")
_MOST_BYTES: Final = 2**31 - 1
_SIZE_AT: Final = 12
CHECKED_FROM: Final = 20
ALIGNED: Final = 8

Records = npt.NDArray[Any]
Sections = Mapping[str, Records]


def _records() -> dict[str, np.dtype[Any]]:
    """Little-endian record types of ``records.csv``; a field without a name is the whole record."""
    fields: dict[str, list[Any]] = {}
    with Path(__file__).with_name("records.csv").open(encoding="utf-8", newline="") as file:
        for row in csv.DictReader(file):
            shape = (int(row["count"]),) if row["count"] else ()
            fields.setdefault(row["section"], []).append((row["field"], "<" + row["type"], shape))
    return {
        section: np.dtype(kinds if kinds[0][0] else kinds[0][1])
        for section, kinds in fields.items()
    }


RECORDS: Final = _records()  # record type of each section, in the order of the file


class Texts:
    """Collector of a clip's texts, each stored once."""

    def __init__(self) -> None:
        # Offset 0 is the empty text, so zeros in a record are a valid reference.
        self._bytes = bytearray(b"\0")
        self._places: dict[str, int] = {"": 0}

    def add(self, text: str) -> int:
        """Add a text once; returns its byte offset in ``TEXT`` (0: empty). Unwritable characters
        and zero bytes are replaced; UTF-8 beyond 1000 bytes is cut off."""
        # A cut within a character leaves bytes that "ignore" drops.
        text = clean(text).replace("\0", " ").encode()[:MOST_TEXT].decode("utf-8", "ignore")
        if text not in self._places:
            self._places[text] = len(self._bytes)
            self._bytes += text.encode() + b"\0"
        return self._places[text]

    @property
    def records(self) -> Records:
        """Section ``TEXT``, uint8: UTF-8 texts, a zero byte before and after each."""
        return np.frombuffer(bytes(self._bytes), np.uint8)


def records(section: str, rows: Sequence[tuple[Any, ...]]) -> Records:
    """Array (n,) of the record type of a section, from tuples in field order; may be empty."""
    return np.array(list(rows), RECORDS[section])


def encoded(sections: Sections, name: str) -> bytes:
    """Encode sections as the bytes of a clip, in the order of ``RECORDS``, each at a multiple of 8.
    Empty sections are omitted. Raises TooLargeError, with ``name``, beyond 2**31 - 1 bytes."""
    filled = [
        (record, sections[record])
        for record in RECORDS
        if record in sections and len(sections[record])
    ]
    # Contents start at multiples of 8 bytes, so readers may map records of doubles in place.
    at = HEAD.size + SECTION.size * len(filled)
    table = b""
    parts: list[bytes] = []
    for section, section_records in filled:
        gap = -at % ALIGNED
        content = np.ascontiguousarray(section_records, RECORDS[section]).tobytes()
        table += SECTION.pack(section.encode(), at + gap, len(content), 0)
        parts += [bytes(gap), content]
        at += gap + len(content)
    if at > _MOST_BYTES:
        raise TooLargeError(f"{name}: a clip of {at:,} bytes, allowed are {_MOST_BYTES:,}.")
    return with_checksum(HEAD.pack(MAGIC, VERSION, at, 0, len(filled)) + table + b"".join(parts))


def with_checksum(content: bytes) -> bytes:
    """Copy of a clip's bytes with its own length and CRC-32 (of bytes 20 on) set in the head."""
    content = content[:_SIZE_AT] + struct.pack("<I", len(content)) + content[_SIZE_AT + 4 :]
    checksum = struct.pack("<I", zlib.crc32(content[CHECKED_FROM:]))
    return content[: CHECKED_FROM - 4] + checksum + content[CHECKED_FROM:]


def refuse_long(sections: Sections, name: str) -> None:
    """Raise TooLargeError for a clip longer than :data:`.limits.SECONDS`; returns nothing."""
    at = sections["TIME"][0]
    limits.SECONDS.check(float(at["rows"] / at["rate_hz"]), name, "its rows last")
