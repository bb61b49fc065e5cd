# SPDX-License-Identifier: GPL-3.0-or-later
"""Damaged clips: changed bytes under a correct checksum."""

from __future__ import annotations

import struct
from collections.abc import Iterator

import numpy as np

from hfx_blender.formats.clip.container import with_checksum

_STRANGE = (0, 1, 2, 5, 0x7F, 0x80, 0xFF, 0xFFFF, 0x7FFFFFFF, 0x80000000, 0xFFFFFFFF, 0x7FC00000,
            0x7F800000, 0xFF800000, 0x3F800000)  # fmt: skip


def damaged(content: bytes, random: np.random.Generator) -> Iterator[bytes]:
    """Yield damaged clips forever: numbers replaced, bytes changed, parts cut."""
    while True:
        actual = bytearray(content)
        for _ in range(random.integers(1, 4)):
            way = random.integers(0, 4)
            if way == 0 and len(actual) > 40:
                del actual[random.integers(24, len(actual)) :]
            elif way == 1:
                actual[random.integers(20, len(actual))] = random.integers(0, 256)
            else:
                at = int(random.integers(5, max(len(actual) // 4, 6))) * 4
                number = _STRANGE[random.integers(0, len(_STRANGE))]
                if random.random() < 0.5 and at + 4 <= len(actual):
                    (old,) = struct.unpack_from("<I", actual, at)
                    number = (old + int(random.integers(-2, 3))) % 2**32
                if at + 4 <= len(actual):
                    struct.pack_into("<I", actual, at, number)
        yield with_checksum(bytes(actual))
