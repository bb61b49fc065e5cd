# SPDX-License-Identifier: GPL-3.0-or-later
"""Reader of glTF 2.0 binary files: container, JSON, and the members used by HFX.

Khronos' validator checks all further rules of glTF; tests run this validator on HFX's files.
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
    """Return the JSON document of a GLB file; InputError for a file with errors."""
    refuse_errors(validate(content, name), name)
    document: dict[str, Any] = parse(_json_chunk(content, Report("GLB")), name)
    return document


def model_hashes(content: bytes, name: str) -> dict[str, str]:
    """Content hashes of HFX body models stored as meshes, by model id.

    Raises InputError for a file with errors.
    """
    extras = (mesh.get("extras") for mesh in read_json(content, name).get("meshes", []))
    pairs = (
        (item.get("hfx_model"), item.get("hfx_content_hash"))
        for item in extras
        if isinstance(item, dict)  # extras of other programs may have any type
    )
    return {id: sum for id, sum in pairs if isinstance(id, str) and isinstance(sum, str)}


def facts(path: Path) -> dict[str, Any]:
    """Mesh names, node and animation counts, extensions for ``hfx info``; InputError if invalid."""
    document = read_json(read_data(path), str(path))
    return {
        "meshes": [str(mesh.get("name", "")) for mesh in document.get("meshes", [])],
        "nodes": len(document.get("nodes", [])),
        "animations": len(document.get("animations", [])),
        "extensions": [str(extension) for extension in document.get("extensionsUsed", [])],
    }


def validate(content: bytes, name: str) -> list[Finding]:
    """Return the findings about the container and the members used by HFX.

    Raises InputError for unreadable JSON.
    """
    report = Report("GLB")
    text = _json_chunk(content, report)
    if report.has_errors:
        return report.findings
    document = parse(text, name)
    asset = document.get("asset") if isinstance(document, dict) else None
    if not isinstance(asset, dict) or asset.get("version") != "2.0":
        report.error("ASSET", (None, "asset"), "it has no asset of version 2.0")
        return report.findings
    for key in _LISTS:
        items = document.get(key, [])
        if not isinstance(items, list) or not all(isinstance(item, dict) for item in items):
            report.error("TYPE", (None, key), "expected a list of objects")
    _check_extensions(document, report)
    return report.findings


def _json_chunk(content: bytes, report: Report) -> bytes:
    """Bytes of the first chunk, of JSON; reports faults of the container. Empty if absent."""
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


def _check_extensions(document: dict[str, Any], report: Report) -> None:
    """Report extensions that are no list of texts or undeclared; warn about required extensions."""
    lists = {key: document.get(key, []) for key in ("extensionsUsed", "extensionsRequired")}
    for key, names in lists.items():
        if not isinstance(names, list) or not all(
            isinstance(extension_name, str) for extension_name in names
        ):
            report.error("TYPE", (None, key), "expected a list of texts")
            return
    extensions = document.get("extensions")
    for name in extensions if isinstance(extensions, dict) else ():
        if name not in lists["extensionsUsed"]:
            report.error("EXTENSION", (None, "extensions"), f"{name} is not in extensionsUsed")
    for name in lists["extensionsRequired"]:
        report.warn("EXTENSION-REQUIRED", None, f"only readers that know {name} can open it")
