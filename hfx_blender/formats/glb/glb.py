# SPDX-License-Identifier: GPL-3.0-or-later
"""glTF 2.0 binary files (GLB): writer of body meshes and moving nodes, reader of the JSON.

HFX and Blender have Z up and a body facing -Y; glTF has Y up and +Z forward: (x, y, z) becomes (x,
z, -y).
"""

import json
import struct
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from ...engine.arrays import F64, Bool
from ...engine.body.model import PerceptualModel
from ...files.atomic import atomic_file
from ...files.findings import Finding, Report, refuse_errors
from ...files.strict_json import clean, parse
from ..registry import FORMATS

SUFFIX: Final = FORMATS["glb"].suffix
TO_GLTF: Final = np.array([[1.0, 0, 0], [0, 0, 1.0], [0, -1.0, 0]])
"""Rotation from our space to glTF's, (3, 3)."""

_JSON_CHUNK: Final = 0x4E4F534A
_BINARY_CHUNK: Final = 0x004E4942
_FLOAT, _UINT, _USHORT = 5126, 5125, 5123
_ARRAY_BUFFER, _ELEMENT_BUFFER = 34962, 34963


class Document:
    """glTF document under construction: JSON and one buffer."""

    def __init__(self) -> None:
        self.json: dict[str, Any] = {"asset": {"version": "2.0", "generator": "HFX"}}
        self._bytes = bytearray()

    def append(self, kind: str, item: Mapping[str, Any]) -> int:
        """Append an item to the list ``kind`` (nodes, meshes, ...) and return the item's index."""
        items: list[Mapping[str, Any]] = self.json.setdefault(kind, [])
        items.append(item)
        return len(items) - 1

    def accessor(
        self, array: npt.NDArray[Any], *, is_index: bool = False, is_vertex: bool = False
    ) -> int:
        """Append numbers, (n,) or (n, 2 to 4 or 16), and return the accessor's index. ``is_index``:
        corners of triangles, 32 bits. ``is_vertex``: attribute of a mesh. Unsigned 16-bit numbers
        (joints) stay so; the rest becomes float32."""
        is_joint = not is_index and array.dtype == np.uint16
        kind = np.dtype("<u4" if is_index else "<u2" if is_joint else "<f4")
        data = np.ascontiguousarray(array, kind)
        shape = {1: "SCALAR", 2: "VEC2", 3: "VEC3", 4: "VEC4", 16: "MAT4"}[
            1 if data.ndim == 1 else data.shape[1]
        ]
        # Rows of all types are multiples of 4 bytes (joints are four of 2 bytes), so every view
        # starts aligned.
        view = {"buffer": 0, "byteOffset": len(self._bytes), "byteLength": data.nbytes}
        if is_index or is_vertex:
            view["target"] = _ELEMENT_BUFFER if is_index else _ARRAY_BUFFER
        self._bytes += data.tobytes()
        # Validators require bounds of positions and times; they are given for all
        # accessors.
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

    def texture(self, content: bytes) -> int:
        """Append a texture of a PNG picture and return the texture's index."""
        view = {"buffer": 0, "byteOffset": len(self._bytes), "byteLength": len(content)}
        self._bytes += content + b"\0" * (-len(content) % 4)  # all views start aligned
        image = {"bufferView": self.append("bufferViews", view), "mimeType": "image/png"}
        return self.append("textures", {"source": self.append("images", image)})

    def encoded(self) -> bytes:
        """Encode the document as a GLB file; a buffer without bytes is omitted."""
        if self._bytes:
            self.json["buffers"] = [{"byteLength": len(self._bytes)}]
        text = json.dumps(self.json, ensure_ascii=False, separators=(",", ":")).encode()
        chunks = _chunk(_JSON_CHUNK, text, b" ")
        if self._bytes:
            chunks += _chunk(_BINARY_CHUNK, bytes(self._bytes), b"\0")
        return struct.pack("<4sII", b"glTF", 2, 12 + len(chunks)) + chunks


def _chunk(kind: int, content: bytes, filler: bytes) -> bytes:
    """Encode a chunk of type ``kind``, filled up with ``filler`` to a multiple of 4 bytes."""
    content += filler * (-len(content) % 4)
    return struct.pack("<II", len(content), kind) + content


def write_model(model: PerceptualModel, path: Path, hjif_uri: str | None = None) -> None:
    """Write a perceptual model as a mesh in rest pose, with unchanged vertex ids. ``hjif_uri``
    names the HJIF file with channels for the vertices. Raises OutputError for an unwritable file;
    no partial file remains."""
    document = Document()
    node = {"mesh": add_model(document, model), "name": clean(model.id)}
    document.json["scenes"] = [{"nodes": [document.append("nodes", node)]}]
    document.json["scene"] = 0
    if hjif_uri is not None:
        add_extensions(document, {"MPEG_media": hjif_media(hjif_uri)})
    with atomic_file(path) as file:
        file.write(document.encoded())


def add_extensions(document: Document, extensions: Mapping[str, Any]) -> None:
    """Set the extensions of the whole file, declared as used but not required."""
    document.json["extensions"] = dict(extensions)
    document.json["extensionsUsed"] = sorted(extensions)


def hjif_media(uri: str) -> dict[str, Any]:
    """JSON of the extension MPEG_media (ISO/IEC 23090-14): one medium, the file ``uri``.
    Media types of HJIF and HMPG (IANA) are their suffixes."""
    alternative = {"mimeType": f"haptics/{uri.rpartition('.')[2]}", "uri": uri}
    return {"media": [{"name": uri, "alternatives": [alternative]}]}


def add_model(document: Document, model: PerceptualModel) -> int:
    """Add a perceptual model as a mesh in rest pose and glTF axes; returns the mesh's index."""
    normals = model.normals @ TO_GLTF.T
    lengths = np.linalg.norm(normals, axis=1, keepdims=True)
    # glTF demands unit normals, and a vertex without triangles has a zero vector: up.
    normals = np.where(lengths > 0.0, normals / np.where(lengths > 0.0, lengths, 1.0), [0, 1.0, 0])
    attributes = {
        "POSITION": document.accessor(model.vertices @ TO_GLTF.T, is_vertex=True),
        "NORMAL": document.accessor(normals, is_vertex=True),
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


_TURN: Final = np.eye(4)
_TURN[:3, :3] = TO_GLTF


def to_gltf(matrices: F64) -> F64:
    """Matrices (T, 4, 4) from a local space to our world, turned to glTF's world."""
    return np.asarray(_TURN @ matrices)


def turned(matrices: F64) -> F64:
    """Transforms (T, 4, 4) within our space as transforms within glTF's space."""
    return np.asarray(_TURN @ matrices @ _TURN.T)


def move(document: Document, node: dict[str, Any], times_s: F64, placed: F64) -> Bool:
    """Append a node with matrices (T, 4, 4) at times, linear between; returns shear, (T,) bool.

    ``node`` gets the transform in place, and keyframes in the scene's only animation, only for
    changing components. The matrix of a node at rest stays exact, and is never reported as sheared.
    """
    translations, rotations, scales, is_sheared = decomposed(placed)
    columns = {"translation": translations, "rotation": rotations, "scale": scales}
    # Only components with changes above rounding get keyframes: importers treat the rest as
    # constant.
    moving = {}
    for path, column in columns.items():
        # About the precision of the 32-bit floats stored.
        rounding = 1e-7 * max(1.0, float(np.abs(column).max()))
        if (np.ptp(column, axis=0) > rounding).any():
            moving[path] = column
    if not moving:
        node["matrix"] = placed[0].T.ravel().tolist()  # column by column
        document.append("nodes", node)
        return np.zeros_like(is_sheared)
    node |= {path: column[0].tolist() for path, column in columns.items()}
    index = document.append("nodes", node)
    values = np.hstack(list(moving.values()))
    # Keyframes within constant stretches are redundant; the ends of stretches are kept.
    keep = np.ones(len(times_s), np.bool_)
    keep[1:-1] = (values[1:-1] != values[:-2]).any(axis=1) | (values[1:-1] != values[2:]).any(
        axis=1
    )
    if "animations" not in document.json:
        document.append("animations", {"name": "Scene", "samplers": [], "channels": []})
    animation = document.json["animations"][0]
    clock = document.accessor(times_s[keep])
    for path, column in moving.items():
        output = document.accessor(column[keep])
        sampler = {"input": clock, "output": output, "interpolation": "LINEAR"}
        animation["samplers"].append(sampler)
        target = {"node": index, "path": path}
        animation["channels"].append({"sampler": len(animation["samplers"]) - 1, "target": target})
    return is_sheared


def decomposed(matrices: F64) -> tuple[F64, F64, F64, Bool]:
    """Translations (T, 3), quaternions x y z w (T, 4), scales (T, 3) and shear (T,) of matrices.
    Successive quaternions are on the same half sphere, so interpolation does not jump. Of a
    mirrored matrix the x scale is negative. Shear is True beyond 1e-4."""
    linear = matrices[:, :3, :3]
    scales = np.linalg.norm(linear, axis=1)
    scales[np.linalg.det(linear) < 0.0, 0] *= -1.0
    axes = linear / np.where(scales == 0.0, 1.0, scales)[:, None, :]
    products = axes.transpose(0, 2, 1) @ axes
    is_sheared = np.abs(products - np.eye(3)).max(axis=(1, 2)) > 1e-4
    left, _, right = np.linalg.svd(axes)  # the nearest rotation
    rotations = _quaternions(left @ right)
    # A quaternion and its negative are one rotation: each flip turns all that follow.
    flips = np.cumprod(np.where((rotations[1:] * rotations[:-1]).sum(axis=1) < 0.0, -1.0, 1.0))
    rotations[1:] *= flips[:, None]
    return matrices[:, :3, 3], rotations, scales, is_sheared


def _quaternions(rotations: F64) -> F64:
    """Quaternions x, y, z, w (T, 4) of rotation matrices (T, 3, 3), w not negative. Largest
    eigenvector of a symmetric matrix (Bar-Itzhack, "New method for extracting the quaternion from a
    rotation matrix", 2000), stable for any rotation."""
    m = rotations
    xx, yy, zz = (m[:, k, k] for k in range(3))
    k = np.zeros((len(m), 4, 4))  # symmetric; eigh reads the lower triangle only
    k[:, 1, 0] = m[:, 1, 0] + m[:, 0, 1]
    k[:, 2, 0] = m[:, 2, 0] + m[:, 0, 2]
    k[:, 2, 1] = m[:, 2, 1] + m[:, 1, 2]
    k[:, 3, 0] = m[:, 2, 1] - m[:, 1, 2]
    k[:, 3, 1] = m[:, 0, 2] - m[:, 2, 0]
    k[:, 3, 2] = m[:, 1, 0] - m[:, 0, 1]
    diagonal = (xx - yy - zz, yy - xx - zz, zz - xx - yy, xx + yy + zz)
    k[:, range(4), range(4)] = np.stack(diagonal, axis=1)
    _, vectors = np.linalg.eigh(k)
    # Eigenvalues ascend, so the last vector has the largest.
    quaternions: F64 = vectors[:, :, -1]
    return quaternions * np.where(quaternions[:, 3:] < 0.0, -1.0, 1.0)


def read_json(content: bytes, name: str) -> dict[str, Any]:
    """Return the JSON document of a GLB file; InputError for a file with errors."""
    findings, document = inspected(content, name)
    refuse_errors(findings, name)
    return document


def model_hashes(content: bytes, name: str) -> dict[str, str]:
    """Content hashes of HFX body models stored as meshes, by model id. Raises InputError for a file
    with errors."""
    extras = (mesh.get("extras") for mesh in read_json(content, name).get("meshes", []))
    pairs = (
        (item.get("hfx_model"), item.get("hfx_content_hash"))
        for item in extras
        if isinstance(item, dict)  # extras of other programs may have any type
    )
    return {id: sum for id, sum in pairs if isinstance(id, str) and isinstance(sum, str)}


def inspected(content: bytes, name: str) -> tuple[list[Finding], dict[str, Any]]:
    """Return the findings about the container and the lists of objects, and the JSON document,
    empty with errors of the container or the version. Raises InputError for unreadable JSON."""
    report = Report("GLB")
    text = _json_chunk(content, report)
    if report.has_errors:
        return report.findings, {}
    document = parse(text, name)
    asset = document.get("asset") if isinstance(document, dict) else None
    if not isinstance(asset, dict) or asset.get("version") != "2.0":
        report.error("ASSET", (None, "asset"), "it has no asset of version 2.0")
        return report.findings, {}
    for key in ("meshes", "nodes", "animations"):
        items = document.get(key, [])
        if not isinstance(items, list) or not all(isinstance(item, dict) for item in items):
            report.error("TYPE", (None, key), "expected a list of objects")
    return report.findings, document


def _json_chunk(content: bytes, report: Report) -> bytes:
    """Bytes of the first chunk, of JSON; empty without one. Reports a file below 20 bytes, another
    magic or version, a wrong size, and chunks that do not fit."""
    if len(content) < 20:
        report.error("SIZE", None, f"{len(content)} bytes")
        return b""
    magic, version, size = struct.unpack_from("<4sII", content)
    if magic != b"glTF" or version != 2:
        report.error("HEADER", None, "it does not begin with glTF and the version 2")
        return b""
    if size != len(content):
        report.error("SIZE", None, f"it says {size} bytes, there are {len(content)}")
    # Chunks follow the head of 12 bytes: length, type, content, filled up to 4 bytes.
    text, at = b"", 12
    while at < len(content):
        # The odd length 1 reports a chunk whose head is cut off.
        length, kind = struct.unpack_from("<II", content, at) if at + 8 <= len(content) else (1, 0)
        if length % 4 or at + 8 + length > len(content):
            report.error("CHUNK", None, f"a chunk at byte {at} does not fit")
            break
        if at == 12 and kind == _JSON_CHUNK:
            text = content[20 : 20 + length]
        at += 8 + length
    if not text:
        report.error("JSON-CHUNK", None, "its first chunk is not JSON")
    return text
