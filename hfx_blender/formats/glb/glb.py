# SPDX-License-Identifier: GPL-3.0-or-later
"""glTF 2.0 binary files (GLB), writer: the container, and body meshes.

Blender's space and ours have Z up and a body facing -Y; glTF has Y up and +Z forward: (x, y, z)
becomes (x, z, -y).
"""

from __future__ import annotations

import json
import struct
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from ...engine.body.model import PerceptualModel
from ...files.atomic import atomic_file
from ...files.strict_json import clean
from ..registry import FORMATS

SUFFIX: Final = FORMATS["glb"].suffix
HJIF_MEDIA_TYPE: Final = "haptics/hjif"
"""Media type of HJIF (ISO/IEC 23090-31)."""

TO_GLTF: Final = np.array([[1.0, 0, 0], [0, 0, 1.0], [0, -1.0, 0]])
"""Rotation from our space to glTF's, (3, 3)."""

JSON_CHUNK: Final = 0x4E4F534A
BINARY_CHUNK: Final = 0x004E4942
_FLOAT, _UINT, _USHORT = 5126, 5125, 5123
_ARRAY_BUFFER, _ELEMENT_BUFFER = 34962, 34963


class Document:
    """glTF document under construction: JSON and one buffer."""

    def __init__(self) -> None:
        self.json: dict[str, Any] = {"asset": {"version": "2.0", "generator": "HFX"}}
        self._bytes = bytearray()

    def append(self, kind: str, item: Mapping[str, Any]) -> int:
        """Append a node, mesh, ... and return its index."""
        items: list[Mapping[str, Any]] = self.json.setdefault(kind, [])
        items.append(item)
        return len(items) - 1

    def accessor(
        self, array: npt.NDArray[Any], *, is_index: bool = False, is_vertex: bool = False
    ) -> int:
        """Append numbers, (n,) or (n, 2 to 4 or 16), and return the accessor's index.

        ``is_index``: corners of triangles, 32 bits. ``is_vertex``: attribute of a mesh. Unsigned
        16-bit numbers (joints) stay so; all others become float32.
        """
        is_joint = not is_index and array.dtype == np.uint16
        kind = np.dtype("<u4" if is_index else "<u2" if is_joint else "<f4")
        data = np.ascontiguousarray(array, kind)
        shape = {1: "SCALAR", 2: "VEC2", 3: "VEC3", 4: "VEC4", 16: "MAT4"}[
            1 if data.ndim == 1 else data.shape[1]
        ]
        view = {
            "buffer": 0,
            "byteOffset": len(self._bytes),
            "byteLength": data.nbytes,
        }
        if is_index or is_vertex:
            view["target"] = _ELEMENT_BUFFER if is_index else _ARRAY_BUFFER
        self._bytes += data.tobytes()
        columns = data.reshape(len(data), -1)
        return self.append(
            "accessors",
            {
                "bufferView": self.append("bufferViews", view),
                "componentType": _UINT if is_index else _USHORT if is_joint else _FLOAT,
                "count": len(data),
                "type": shape,
                "min": columns.min(axis=0).tolist(),
                "max": columns.max(axis=0).tolist(),
            },
        )

    def encoded(self) -> bytes:
        """Encode the document as a GLB file."""
        if self._bytes:
            self.json["buffers"] = [{"byteLength": len(self._bytes)}]
        text = json.dumps(self.json, ensure_ascii=False, separators=(",", ":")).encode()
        chunks = _chunk(JSON_CHUNK, text, b" ")
        if self._bytes:
            chunks += _chunk(BINARY_CHUNK, bytes(self._bytes), b"\0")
        return struct.pack("<4sII", b"glTF", 2, 12 + len(chunks)) + chunks


def _chunk(kind: int, content: bytes, filler: bytes) -> bytes:
    """Encode a chunk, filled up to a multiple of 4 bytes."""
    content += filler * (-len(content) % 4)
    return struct.pack("<II", len(content), kind) + content


def write_model(model: PerceptualModel, path: Path, hjif_uri: str | None = None) -> None:
    """Write a perceptual model as a mesh in rest pose, with unchanged vertex ids.

    ``hjif_uri`` names the HJIF file whose channels refer to the vertices. Raises OutputError for an
    unwritable file, of which no part remains.
    """
    document = Document()
    node = {"mesh": add_model(document, model), "name": clean(model.id)}
    document.json["scenes"] = [{"nodes": [document.append("nodes", node)]}]
    document.json["scene"] = 0
    if hjif_uri is not None:
        add_extensions(document, {"MPEG_media": hjif_media(hjif_uri)})
    with atomic_file(path) as file:
        file.write(document.encoded())


def add_extensions(document: Document, extensions: Mapping[str, Any]) -> None:
    """Add extensions of the whole file, as used but not required."""
    document.json["extensions"] = dict(extensions)
    document.json["extensionsUsed"] = sorted(extensions)


def hjif_media(uri: str) -> dict[str, Any]:
    """Content of MPEG_media (ISO/IEC 23090-14) for an HJIF file."""
    alternative = {"mimeType": HJIF_MEDIA_TYPE, "uri": uri}
    return {"media": [{"name": uri, "alternatives": [alternative]}]}


def add_model(document: Document, model: PerceptualModel) -> int:
    """Add a perceptual model as a mesh, and return its index."""
    attributes = {
        "POSITION": document.accessor(model.vertices @ TO_GLTF.T, is_vertex=True),
        "NORMAL": document.accessor(_unit(model.normals @ TO_GLTF.T), is_vertex=True),
    }
    indices = document.accessor(model.triangles.ravel(), is_index=True)
    return document.append(
        "meshes",
        {
            "name": clean(model.id),
            "primitives": [{"attributes": attributes, "indices": indices}],
            "extras": {
                "hfx_model": model.id,
                "hfx_content_hash": model.content_hash,
                "modality": model.modality,
            },
        },
    )


def _unit(vectors: npt.NDArray[Any]) -> npt.NDArray[Any]:
    """Normalize vectors (N, 3); (0, 1, 0) for zero vectors."""
    lengths = np.linalg.norm(vectors, axis=1, keepdims=True)
    return np.where(lengths > 0.0, vectors / np.where(lengths > 0.0, lengths, 1.0), [0, 1.0, 0])
