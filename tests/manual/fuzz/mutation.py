# SPDX-License-Identifier: GPL-3.0-or-later
"""Changed copies of files: changed bytes, or changed contents in a still readable file."""

from __future__ import annotations

import copy
import io
import json
import random
import struct
import zipfile
import zlib
from collections.abc import Callable

TOKENS = (
    b"null", b"true", b"-1", b"1e308", b"1e-308", b"1e999", b"NaN", b"[]", b"{}", b'""', b"0",
    b"4294967296", b"99999999999999999999", b'"\\ud800"', b"[[[[", b"1.5", b"-0", b'"Reference"',
    b'"Composite"', b'"id":7', b'"Curve"', b"\xff\xfe", b"\x00" * 8,
)  # fmt: skip
VALUES: tuple[object, ...] = (
    None, True, -1, 0, 1, 2, 1.5, 1e308, -1e308, 5e-324, 2**31, 2**64, "", "x", "\ud800", [], {},
    [[]], {"a": 1}, "Reference", "Composite", 7, 1000, 50_000, 10_000, float("nan"), 10**400,
    "NaN", "-Infinity", "1e999", "1e300", "0.5", "1_0", "\u0661", ["0"], [None], [[0]], {"": None},
)  # fmt: skip
_COUNTS = (b"\xff" * 4, b"\xff\xff\xff\x7f", b"\0\0\0\x80", b"\0" * 4, b"\1\0\0\0", b"\0\0\1\0")
_PNG = b"\x89PNG\r\n\x1a\n"
_GLB_HEAD = struct.Struct("<4sIIII")

ByteMutator = Callable[[bytes], bytes]


def mutated(data: bytes, rng: random.Random, of_bytes: ByteMutator) -> bytes:
    """A changed copy: half of the time of the content behind the file's packing."""
    if rng.random() < 0.5:
        for inside in (_of_tree, _of_archive, _of_glb, _of_png):
            result = inside(data, rng, of_bytes)
            if result is not None:
                return result
    return of_bytes(data)


def _of_tree(data: bytes, rng: random.Random, of_bytes: ByteMutator) -> bytes | None:
    """JSON, or a line of JSON Lines, changed as a tree."""
    if data[:1] not in (b"{", b"["):
        return None
    lines = data.splitlines()
    at = rng.randrange(len(lines)) if b"\n{" in data else None
    try:
        tree = json.loads(data if at is None else lines[at])
    except (ValueError, RecursionError):
        return None
    if not isinstance(tree, dict | list):
        return None
    for _ in range(rng.choice((1, 1, 1, 2, 4))):
        (graft if rng.random() < 0.3 else change_tree)(tree, rng)
    try:
        content = json.dumps(tree).encode()
    except (ValueError, RecursionError):  # a part was put into itself
        return None
    if rng.random() < 0.1:
        content = _other_text(content, rng)
    if at is None:
        return content
    lines[at] = content
    return b"\n".join(lines) + b"\n"


def _of_archive(data: bytes, rng: random.Random, of_bytes: ByteMutator) -> bytes | None:
    """A ZIP with a changed member, and correct checksums."""
    if data[:2] != b"PK":
        return None
    packed = io.BytesIO()
    try:
        with zipfile.ZipFile(io.BytesIO(data)) as archive:
            members = {item: archive.read(item)[: 64 << 10] for item in archive.namelist()[:20]}
        name = rng.choice(list(members))
        inner = _of_tree(members[name], rng, of_bytes) or _of_png(members[name], rng, of_bytes)
        is_tree = inner is not None and rng.random() < 0.7
        members[name] = inner if is_tree and inner is not None else of_bytes(members[name])
        if rng.random() < 0.1:
            members[rng.choice(list(members))] = members.pop(name)
        with zipfile.ZipFile(packed, "w", rng.choice((0, 8))) as archive:
            for item, content in members.items():
                archive.writestr(item, content)
    except (OSError, ValueError, IndexError, zipfile.BadZipFile, NotImplementedError, zlib.error):
        return None
    except (RuntimeError, EOFError, struct.error, UnicodeError):  # encrypted, cut, odd names
        return None
    return packed.getvalue()


def _of_glb(data: bytes, rng: random.Random, of_bytes: ByteMutator) -> bytes | None:
    """A GLB with changed JSON, and correct lengths."""
    if data[:4] != b"glTF" or len(data) < _GLB_HEAD.size:
        return None
    magic, version, _, length, kind = _GLB_HEAD.unpack_from(data)
    content = _of_tree(data[_GLB_HEAD.size : _GLB_HEAD.size + length].rstrip(), rng, of_bytes)
    if content is None:
        return None
    content += b" " * (-len(content) % 4)
    rest = data[_GLB_HEAD.size + length :]
    total = _GLB_HEAD.size + len(content) + len(rest)
    return _GLB_HEAD.pack(magic, version, total, len(content), kind) + content + rest


def _of_png(data: bytes, rng: random.Random, of_bytes: ByteMutator) -> bytes | None:
    """A PNG with a changed part, correct checksums, and repacked rows."""
    if data[:8] != _PNG:
        return None
    parts: list[tuple[bytes, bytes]] = []
    position = 8
    while position + 12 <= len(data) and len(parts) < 20:
        (size,) = struct.unpack_from(">I", data, position)
        parts.append((data[position + 4 : position + 8], data[position + 8 : position + 8 + size]))
        position += 12 + size
    if not parts:
        return None
    k = rng.randrange(len(parts))
    name, content = parts[k]
    if name == b"IDAT" and rng.random() < 0.8:
        try:
            content = zlib.compress(of_bytes(zlib.decompressobj().decompress(content, 1 << 16)), 1)
        except zlib.error:
            return None
    else:
        content = of_bytes(content)
        content = content[:13].ljust(13, b"\0") if name == b"IHDR" else content
    parts[k] = (name, content)
    return _PNG + b"".join(png_part(*part) for part in parts)


def png_part(name: bytes, content: bytes) -> bytes:
    """A part of a PNG with size and checksum."""
    total = zlib.crc32(name + content)
    return struct.pack(">I", len(content)) + name + content + struct.pack(">I", total)


def change_tree(tree: object, rng: random.Random) -> None:
    """Change a random node of a tree: replace, remove, double or swap a member."""
    at = tree
    for _ in range(rng.randrange(1, 14)):
        inner = (
            list(at.values()) if isinstance(at, dict) else list(at) if isinstance(at, list) else []
        )
        inner = [item for item in inner if isinstance(item, dict | list) and item]
        if not inner or rng.random() < 0.1:
            break
        at = rng.choice(inner)
    if isinstance(at, dict) and at:
        _change_object(at, rng)
    elif isinstance(at, list) and at:
        _change_list(at, rng)


def _value(rng: random.Random) -> object:
    return copy.deepcopy(rng.choice(VALUES))


def graft(tree: object, rng: random.Random) -> None:
    """Put a member of one object into a second object, unchanged or with another value."""
    objects: list[dict[str, object]] = []
    waiting = [tree]
    for _ in range(2000):  # a part may be within itself
        if not waiting:
            break
        at = waiting.pop(rng.randrange(len(waiting)))
        if isinstance(at, dict):
            objects.append(at)
        if isinstance(at, dict | list):
            waiting += at.values() if isinstance(at, dict) else at
    given, taken = ([item for item in objects if item or k] for k in range(2))
    if given and taken:
        key, value = rng.choice(list(rng.choice(given).items()))
        is_same = rng.random() < 0.4 and not isinstance(value, dict | list)
        rng.choice(taken)[key] = value if is_same else _value(rng)


def _other_text(content: bytes, rng: random.Random) -> bytes:
    """JSON with a key twice, nested deeply, in another encoding, or cut off."""
    kind = rng.randrange(5)
    if kind == 0:
        at = content.find(b'"', rng.randrange(len(content)))
        key = content[at : content.find(b":", at) + 1]
        return content.replace(b"{", b"{" + key + b"0,", 1) if key else content
    if kind == 1:
        depth = rng.choice((20, 500, 1100, 50_000))
        inside = rng.choice((b"[", b'{"a":'))
        at = content.find(b":", rng.randrange(len(content))) + 1
        return content[:at] + inside * depth + content[at:]
    if kind == 2:
        return content.decode().encode(rng.choice(("utf-16", "utf-16-be", "utf-32", "utf-8-sig")))
    if kind == 3:
        return content.replace(b"a", rng.choice((b"\xe9", b"\xed\xa0\x80", b"\xff", b"\0")), 1)
    return content[: rng.randrange(len(content))]


def _change_object(at: dict[str, object], rng: random.Random) -> None:
    key = rng.choice(list(at))
    kind = rng.randrange(4)
    old = at[key]
    if kind == 0:
        at[key] = _value(rng)
    elif kind == 1:
        del at[key]
    elif kind == 2:
        at[rng.choice(list(at))] = old
    elif isinstance(old, int | float) and not isinstance(old, bool) and abs(old) < 1e300:
        at[key] = old * rng.choice((-1, 0, 0.5, 2, 1000, 1e9)) + rng.choice((0, 0, 1, -1))


def _change_list(at: list[object], rng: random.Random) -> None:
    k = rng.randrange(len(at))
    kind = rng.randrange(4)
    if kind == 0:
        at[k] = _value(rng)
    elif kind == 1:
        del at[k]
    elif kind == 2:
        at.extend(at[k : k + 1] * rng.choice((1, 2, 40)))
    else:
        second = rng.randrange(len(at))
        at[k], at[second] = at[second], at[k]


def changed_bytes(data: bytes, other: bytes, rng: random.Random) -> bytes:
    """Bits, tokens, cuts and copies: changes without a fuzzing engine."""
    result = bytearray(data)
    for _ in range(rng.choice((1, 1, 2, 4, 16))):
        at = rng.randrange(len(result) + 1)
        kind = rng.randrange(9)
        if kind == 0 and result:
            result[at % len(result)] ^= 1 << rng.randrange(8)
        elif kind == 1:
            result[at:at] = rng.choice(TOKENS)
        elif kind == 2:
            del result[at : at + rng.choice((1, 2, 8, 64, 512))]
        elif kind == 3 and other:
            start = rng.randrange(len(other))
            result[at:at] = other[start : start + rng.choice((4, 32, 256))]
        elif kind == 4 and result:
            result[at : at + 4] = rng.randrange(2**32).to_bytes(4, "little")
        elif kind == 5:
            result[at : at + rng.choice((1, 3, 8))] = rng.choice(TOKENS)
        elif kind == 6 and result:
            result[at:at] = result[at : at + 64] * rng.choice((1, 2, 20))
        elif kind == 7 and result:
            result[at : at + 4] = rng.choice(_COUNTS)
        elif kind == 8 and rng.random() < 0.2:
            del result[at:]
    return bytes(result)
