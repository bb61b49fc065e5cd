# SPDX-License-Identifier: GPL-3.0-or-later
"""Reader of glTF 2.0 binary files: the container, its JSON, and what HFX takes from that.

Rules of everything else in a glTF file are those of Khronos' validator, which the tests run on all
that HFX writes.
"""

from __future__ import annotations

import struct
from pathlib import Path
from typing import Any, Final

from ...files.findings import Finding, Report, refuse_errors
from ...files.strict_json import parse, read_data
from .glb import JSON_CHUNK

_LISTS: Final = ("meshes", "nodes", "animations")


def read_json(content: bytes, name: str) -> dict[str, Any]:
    """The JSON part of a GLB file.

    Raises
    ------
    InputError
        It is no GLB file, or what HFX takes from it is not sound.
    """
    refuse_errors(validate(content, name), name)
    found: dict[str, Any] = parse(_json_chunk(content, Report("GLB")), name)
    return found


def model_hashes(content: bytes, name: str) -> dict[str, str]:
    """Content hashes of the body models of HFX that a file has as meshes, by model id.

    Raises
    ------
    InputError
        See :func:`read_json`.
    """
    extras = (mesh.get("extras") for mesh in read_json(content, name).get("meshes", []))
    pairs = (
        (item.get("hfx_model"), item.get("hfx_content_hash"))
        for item in extras
        if isinstance(item, dict)  # others write anything there
    )
    return {id: sum for id, sum in pairs if isinstance(id, str) and isinstance(sum, str)}


def facts(path: Path) -> dict[str, Any]:
    """Short description of a valid file."""
    found = read_json(read_data(path), str(path))
    return {
        "meshes": [str(mesh.get("name", "")) for mesh in found.get("meshes", [])],
        "nodes": len(found.get("nodes", [])),
        "animations": len(found.get("animations", [])),
        "extensions": [str(each) for each in found.get("extensionsUsed", [])],
    }


def validate(content: bytes, name: str) -> list[Finding]:
    """Faults of a GLB file: the container, and what HFX takes from its JSON.

    Raises
    ------
    InputError
        Its JSON cannot be read.
    """
    report = Report("GLB")
    text = _json_chunk(content, report)
    if report.has_errors:
        return report.findings
    found = parse(text, name)
    asset = found.get("asset") if isinstance(found, dict) else None
    if not isinstance(asset, dict) or asset.get("version") != "2.0":
        report.error("ASSET", (None, "asset"), "it has no asset of version 2.0")
        return report.findings
    for key in _LISTS:
        items = found.get(key, [])
        if not isinstance(items, list) or not all(isinstance(item, dict) for item in items):
            report.error("TYPE", (None, key), "expected a list of objects")
    _check_extensions(found, report)
    return report.findings


def _json_chunk(content: bytes, report: Report) -> bytes:
    """Text of the first chunk, which is JSON; empty after a fault of the container."""
    if len(content) < 20:
        report.error("SIZE", None, f"{len(content)} bytes")
        return b""
    magic, version, size = struct.unpack_from("<4sII", content)
    if magic != b"glTF" or version != 2:
        report.error("HEADER", None, "it does not begin with glTF and the version 2")
        return b""
    if size != len(content):
        report.error("SIZE", None, f"it says {size} bytes, there are {len(content)}")
    text, at = b"", 12
    while at < len(content):
        length, kind = struct.unpack_from("<II", content, at) if at + 8 <= len(content) else (1, 0)
        if length % 4 or at + 8 + length > len(content):
            report.error("CHUNK", None, f"a chunk at byte {at} does not fit")
            break
        if at == 12 and kind == JSON_CHUNK:
            text = content[20 : 20 + length]
        at += 8 + length
    if not text:
        report.error("JSON-CHUNK", None, "its first chunk is not JSON")
    return text


def _check_extensions(found: dict[str, Any], report: Report) -> None:
    lists = {key: found.get(key, []) for key in ("extensionsUsed", "extensionsRequired")}
    for key, names in lists.items():
        if not isinstance(names, list) or not all(isinstance(each, str) for each in names):
            report.error("TYPE", (None, key), "expected a list of texts")
            return
    extensions = found.get("extensions")
    for name in extensions if isinstance(extensions, dict) else ():
        if name not in lists["extensionsUsed"]:
            report.error("EXTENSION", (None, "extensions"), f"{name} is not in extensionsUsed")
    for name in lists["extensionsRequired"]:
        report.warn("EXTENSION-REQUIRED", None, f"only readers that know {name} can open it")
