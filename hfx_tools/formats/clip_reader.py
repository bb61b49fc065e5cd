# SPDX-License-Identifier: GPL-3.0-or-later
"""Reader of a clip's container: its sections of records, and their texts."""

from __future__ import annotations

import zlib
from typing import Final

import numpy as np

from hfx_blender.errors import InputError
from hfx_blender.formats.clip.container import (
    ALIGNED,
    CHECKED_FROM,
    HEAD,
    MAGIC,
    RECORDS,
    SECTION,
    VERSION,
    Records,
    Sections,
)

_MOST_SECTIONS: Final = 64


def decoded(content: bytes, name: str) -> dict[str, Records]:
    """Decode the sections of a clip: missing sections are empty, unknown sections dropped. Contents
    are not validated. Raises InputError for another file, a newer version, truncated or damaged
    content, and misplaced sections."""
    if content[: len(MAGIC)] != MAGIC:
        raise InputError(f"{name}: is no game clip (its first 8 bytes are not 'HFXCLIP').")
    if len(content) < HEAD.size:
        raise InputError(f"{name}: is cut off: it has {len(content)} bytes.")
    _, version, size, checksum, count = HEAD.unpack_from(content)
    if not 1 <= version <= VERSION:
        raise InputError(
            f"{name}: 'version' is {version}, allowed is up to {VERSION}: a newer player reads it."
        )
    if size != len(content):
        raise InputError(f"{name}: 'size' is {size}, but the file has {len(content)} bytes.")
    # The size is checked first: a truncated file gets a clearer message than a wrong checksum.
    if zlib.crc32(memoryview(content)[CHECKED_FROM:]) != checksum:
        raise InputError(f"{name}: is damaged: its checksum differs.")
    if count > _MOST_SECTIONS or HEAD.size + SECTION.size * count > size:
        raise InputError(f"{name}: 'sections' is {count}, which do not fit, allowed are 64.")
    # A section of no records is not stored.
    sections = {section_name: np.zeros(0, kind) for section_name, kind in RECORDS.items()}
    names: set[str] = set()
    # Sections of later versions are skipped, so that old players read new clips.
    for k in range(count):
        key, first, length, reserved = SECTION.unpack_from(content, HEAD.size + SECTION.size * k)
        section = key.decode("latin-1")
        if section in names:
            raise InputError(f"{name}: the section {section!r} occurs twice.")
        if reserved:
            raise InputError(
                f"{name}: 'reserved' of section {section!r} is {reserved}, allowed is 0."
            )
        names.add(section)
        if section not in RECORDS:
            continue
        kind = RECORDS[section]
        if first % ALIGNED or first + length > size or length % kind.itemsize:
            raise InputError(
                f"{name}: the section '{section}' has {length} bytes from byte {first}, allowed "
                f"is a multiple of {kind.itemsize} bytes within {size}, from a multiple of 8."
            )
        # A view of the file's bytes without a copy, aligned by the check above.
        sections[section] = np.frombuffer(content, kind, length // kind.itemsize, first)
    return sections


def texts_at(sections: Sections, places: Records) -> list[str]:
    """Texts at byte offsets (n,) of the section ``TEXT`` of a valid clip."""
    content = sections["TEXT"].tobytes()
    return [content[k : content.index(b"\0", k)].decode() for k in places.tolist()]
