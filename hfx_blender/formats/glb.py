# SPDX-License-Identifier: GPL-3.0-or-later
"""glTF 2.0 binary files (GLB): the container, and body meshes.

Blender's and our spaces have Z up and a body that faces -Y; glTF has Y up and +Z forward:
(x, y, z) becomes (x, z, -y).
"""

from __future__ import annotations

import json
import struct
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from .. import file_limits
from ..atomic_files import atomic_file
from ..engine.body.model import PerceptualModel
from .checking import MAX_BYTES, Finding, Place, Report, clean, parse, refuse_errors

SUFFIX: Final = ".glb"
HJIF_MEDIA_TYPE: Final = "haptics/hjif"
"""Media type of HJIF, of ISO/IEC 23090-31."""

TO_GLTF: Final = np.array([[1.0, 0, 0], [0, 0, 1.0], [0, -1.0, 0]])
"""Rotation from our space to glTF's."""

_JSON, _BIN = 0x4E4F534A, 0x004E4942
_FLOAT, _UINT, _USHORT = 5126, 5125, 5123
_COMPONENTS: Final = {5120: 1, 5121: 1, 5122: 2, 5123: 2, 5125: 4, 5126: 4}
_TYPES: Final = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4, "MAT2": 4, "MAT3": 9, "MAT4": 16}
_INDEX_KINDS: Final = {5121: "u1", 5123: "<u2", 5125: "<u4"}
_LISTS: Final = (
    *("nodes", "meshes", "skins", "accessors"),
    *("bufferViews", "buffers", "scenes", "animations"),
)
_ARRAY_BUFFER, _ELEMENT_BUFFER = 34962, 34963


class Document:
    """glTF document under construction: its JSON, and one buffer."""

    def __init__(self) -> None:
        self.json: dict[str, Any] = {"asset": {"version": "2.0", "generator": "HFX"}}
        self._bytes = bytearray()

    def append(self, kind: str, item: Mapping[str, Any]) -> int:
        """Add a node, mesh, ...; its index."""
        items: list[Mapping[str, Any]] = self.json.setdefault(kind, [])
        items.append(item)
        return len(items) - 1

    def accessor(
        self, array: npt.NDArray[Any], *, is_index: bool = False, is_vertex: bool = False
    ) -> int:
        """Add numbers, (n,) or (n, 2 to 4 or 16); the accessor's index.

        ``is_index`` are the corners of triangles, ``is_vertex`` what a mesh has a vertex. Other
        whole numbers are of 16 bits, as joints are.
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
        """The document as a GLB file."""
        if self._bytes:
            self.json["buffers"] = [{"byteLength": len(self._bytes)}]
        text = json.dumps(self.json, ensure_ascii=False, separators=(",", ":")).encode()
        chunks = _chunk(_JSON, text, b" ")
        if self._bytes:
            chunks += _chunk(_BIN, bytes(self._bytes), b"\0")
        return struct.pack("<4sII", b"glTF", 2, 12 + len(chunks)) + chunks


def _chunk(kind: int, content: bytes, filler: bytes) -> bytes:
    content += filler * (-len(content) % 4)
    return struct.pack("<II", len(content), kind) + content


def write_model(model: PerceptualModel, path: Path, hjif_uri: str | None = None) -> None:
    """Write a perceptual model as a mesh in its rest pose; vertex ids stay the same.

    ``hjif_uri`` is that of the HJIF file whose channels have its vertices.

    Raises
    ------
    OutputError
        The file cannot be written; nothing is left of it then.
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
    """Add extensions of the whole file: used, never required."""
    document.json["extensions"] = dict(extensions)
    document.json["extensionsUsed"] = sorted(extensions)


def hjif_media(uri: str) -> dict[str, Any]:
    """Content of MPEG_media (ISO/IEC 23090-14) that names an HJIF file."""
    alternative = {"mimeType": HJIF_MEDIA_TYPE, "uri": uri}
    return {"media": [{"name": uri, "alternatives": [alternative]}]}


def add_model(document: Document, model: PerceptualModel) -> int:
    """Add a perceptual model as a mesh; its index."""
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
    lengths = np.linalg.norm(vectors, axis=1, keepdims=True)
    return np.where(lengths > 0.0, vectors / np.where(lengths > 0.0, lengths, 1.0), [0, 1.0, 0])


def read_json(content: bytes, name: str) -> dict[str, Any]:
    """The JSON part of a GLB file.

    Raises
    ------
    InputError
        It is no valid GLB file.
    """
    report = Report("GLB")
    refuse_errors(validate(content, name), name)
    found: dict[str, Any] = parse(_chunks(content, report)[_JSON], name)
    return found


def validate(content: bytes, name: str) -> list[Finding]:
    """Faults of a GLB file: the container, the references, the bounds of its accessors.

    Raises
    ------
    InputError
        Its JSON cannot be read.
    """
    report = Report("GLB")
    chunks = _chunks(content, report)
    if _JSON not in chunks or report.has_errors:
        report.error("JSON-CHUNK", None, "it has no JSON chunk")
        return report.findings
    found = parse(chunks[_JSON], name)
    if not isinstance(found, dict) or found.get("asset", {}) == {}:
        report.error("ASSET", None, "it has no asset")
        return report.findings
    _check_document(found, chunks.get(_BIN, b""), report)
    return report.findings


def _chunks(content: bytes, report: Report) -> dict[int, bytes]:
    if len(content) < 20 or len(content) > 8 * MAX_BYTES:
        report.error("SIZE", None, f"{len(content)} bytes")
        return {}
    magic, version, size = struct.unpack_from("<4sII", content)
    if magic != b"glTF" or version != 2:
        report.error("HEADER", None, "it does not begin with glTF and the version 2")
        return {}
    if size != len(content):
        report.error("SIZE", None, f"it says {size} bytes, there are {len(content)}")
    chunks: dict[int, bytes] = {}
    at = 12
    while at + 8 <= len(content):
        length, kind = struct.unpack_from("<II", content, at)
        if length % 4 or at + 8 + length > len(content):
            report.error("CHUNK", None, f"a chunk of {length} bytes does not fit")
            break
        chunks.setdefault(kind, content[at + 8 : at + 8 + length])
        at += 8 + length
    return chunks


def _check_document(found: dict[str, Any], binary: bytes, report: Report) -> None:
    bin_bytes = len(binary)
    if not isinstance(found["asset"], dict) or found["asset"].get("version") != "2.0":
        report.error("ASSET", (None, "asset"), "the version is not 2.0")
    lists: dict[str, list[Any]] = {}
    for key in _LISTS:
        items = found.get(key, [])
        if not isinstance(items, list) or not all(isinstance(each, dict) for each in items):
            report.error("TYPE", (None, key), "expected a list of objects")
            return
        lists[key] = items
    used, required = found.get("extensionsUsed", []), found.get("extensionsRequired", [])
    for key in found.get("extensions", {}) if isinstance(found.get("extensions"), dict) else ():
        if key not in used:
            report.error("EXTENSION", (None, "extensions"), f"{key} is not in extensionsUsed")
    for each in required if isinstance(required, list) else ():
        report.warn("EXTENSION-REQUIRED", None, f"only readers that know {each} can open it")

    def refers(value: Any, kind: str, place: Any) -> bool:
        is_index = isinstance(value, int) and not isinstance(value, bool)
        if is_index and 0 <= value < len(lists[kind]):
            return True
        report.error("REFERENCE", place, f"{value!r} is none of the {kind}"[:100])
        return False

    for k, buffer in enumerate(lists["buffers"]):
        size = buffer.get("byteLength")
        if not isinstance(size, int) or size < 0:
            report.error("BUFFER", ((None, "buffers"), k), "it has no byteLength")
        elif k == 0 and "uri" not in buffer and not size <= bin_bytes <= size + 3:
            message = f"byteLength is {size}, the binary chunk has {bin_bytes}"
            report.error("BUFFER", ((None, "buffers"), k), message)
    for k, view in enumerate(lists["bufferViews"]):
        place = ((None, "bufferViews"), k)
        start, length = view.get("byteOffset", 0), view.get("byteLength")
        if not _is_count(start) or not _is_count(length):
            report.error("VIEW", place, "its offset or length is no whole number")
        elif refers(view.get("buffer"), "buffers", place):
            total = lists["buffers"][view["buffer"]].get("byteLength")
            if isinstance(total, int) and start + length > total:
                report.error("VIEW", place, "it reaches beyond its buffer")
        stride = view.get("byteStride", 4)
        if not _is_count(stride) or not 4 <= stride <= 252 or stride % 4:
            report.error("VIEW", place, "its byteStride is none of 4, 8, ... 252")
    for k, skin in enumerate(lists["skins"]):
        place = ((None, "skins"), k)
        joints = _items(skin, "joints")
        if not joints:
            report.error("SKIN", place, "it has no joints")
        for joint in joints:
            refers(joint, "nodes", place)
        if "inverseBindMatrices" in skin and refers(
            skin["inverseBindMatrices"], "accessors", place
        ):
            bind = lists["accessors"][skin["inverseBindMatrices"]]
            count = bind.get("count")
            if bind.get("type") != "MAT4" or not _is_count(count) or count < len(joints):
                report.error("SKIN", place, "its inverse bind matrices are not one a joint")
    for k, accessor in enumerate(lists["accessors"]):
        _check_accessor(accessor, lists, ((None, "accessors"), k), refers, report)
    for k, mesh in enumerate(lists["meshes"]):
        place = ((None, "meshes"), k)
        primitives = mesh.get("primitives")
        for primitive in primitives if isinstance(primitives, list) else ():
            attributes = primitive.get("attributes") if isinstance(primitive, dict) else None
            attributes = attributes if isinstance(attributes, dict) else {}
            fits = [refers(value, "accessors", place) for value in attributes.values()]
            if not isinstance(primitive, dict) or "indices" not in primitive:
                continue
            if refers(primitive["indices"], "accessors", place) and fits and all(fits):
                counts = [lists["accessors"][each].get("count") for each in attributes.values()]
                highest = _highest(lists["accessors"][primitive["indices"]], lists, binary)
                if any(_is_count(each) and highest >= each for each in counts):
                    report.error("INDEX", place, f"a triangle has the vertex {highest}: too few")
    parents: dict[int, int] = {}
    for k, node in enumerate(lists["nodes"]):
        place = ((None, "nodes"), k)
        for key, kind in (("mesh", "meshes"), ("skin", "skins")):
            if key in node:
                refers(node[key], kind, place)
        for child in _items(node, "children"):
            if refers(child, "nodes", place) and parents.setdefault(child, k) != k:
                report.error("NODE-TREE", ((None, "nodes"), child), "it has two parents")
    if _is_round(parents):
        report.error("NODE-TREE", (None, "nodes"), "a node is below itself")
    if "scene" in found:
        refers(found["scene"], "scenes", (None, "scene"))
    for k, scene in enumerate(lists["scenes"]):
        for node in _items(scene, "nodes"):
            refers(node, "nodes", ((None, "scenes"), k))
    for k, animation in enumerate(lists["animations"]):
        place = ((None, "animations"), k)
        samplers = [each for each in _items(animation, "samplers") if isinstance(each, dict)]
        for sampler in samplers:
            refers(sampler.get("input"), "accessors", place)
            refers(sampler.get("output"), "accessors", place)
        for channel in _items(animation, "channels"):
            target = channel.get("target") if isinstance(channel, dict) else None
            if isinstance(target, dict) and "node" in target:
                refers(target["node"], "nodes", place)


def _is_count(value: Any) -> bool:
    return type(value) is int and value >= 0


def _check_accessor(
    accessor: dict[str, Any],
    lists: dict[str, list[Any]],
    place: Place,
    refers: Callable[[Any, str, Any], bool],
    report: Report,
) -> None:
    """Check an accessor's numbers, where they lie, and those that a sparse one replaces."""
    kind: Any = accessor.get("componentType")
    count: Any = accessor.get("count")
    width = _COMPONENTS.get(kind, 0) if type(kind) is int else 0
    item = width * _TYPES.get(str(accessor.get("type")), 0)
    if not item or not _is_count(count) or count < 1:
        report.error("ACCESSOR", place, "its component type, type or count is wrong")
        return

    def check_view(of: dict[str, Any], items: int, size: int) -> None:
        if not refers(of.get("bufferView"), "bufferViews", place):
            return
        view = lists["bufferViews"][of["bufferView"]]
        start: Any = of.get("byteOffset", 0)
        stride: Any = view.get("byteStride", size)
        length: Any = view.get("byteLength")
        if not _is_count(start) or not _is_count(stride) or not _is_count(length):
            report.error("ACCESSOR", place, "its offset is no whole number")
        elif start + (items - 1) * stride + size > length:
            report.error("ACCESSOR", place, "it reaches beyond its view")

    if "bufferView" in accessor:
        check_view(accessor, count, item)
    elif count * item > file_limits.MEMORY.allowed:  # zeros, of which the file holds none
        report.error("ACCESSOR", place, f"{count} items of {item} bytes, none in the file")
    if "sparse" in accessor:
        sparse = accessor["sparse"] if isinstance(accessor["sparse"], dict) else {}
        replaced: Any = sparse.get("count")
        indices: Any = sparse.get("indices")
        values: Any = sparse.get("values")
        index_kind: Any = indices.get("componentType") if isinstance(indices, dict) else None
        is_sound = _is_count(replaced) and 1 <= replaced <= count and isinstance(values, dict)
        if not is_sound or type(index_kind) is not int or index_kind not in _INDEX_KINDS:
            report.error("ACCESSOR", place, "its 'sparse' has a wrong count, indices or values")
            return
        check_view(indices, replaced, _COMPONENTS[index_kind])
        check_view(values, replaced, item)


def _highest(accessor: dict[str, Any], lists: dict[str, list[Any]], binary: bytes) -> int:
    """Highest index in an accessor of the file's own buffer; -1 where there is none to see."""
    kind: Any = accessor.get("componentType")
    view: Any = accessor.get("bufferView")
    if type(kind) is not int or kind not in _INDEX_KINDS or not _is_count(view):
        return -1
    if view >= len(lists["bufferViews"]) or lists["bufferViews"][view].get("buffer") != 0:
        return -1
    starts = lists["bufferViews"][view].get("byteOffset", 0), accessor.get("byteOffset", 0)
    count: Any = accessor.get("count")
    if not all(map(_is_count, (*starts, count))) or not count or "uri" in lists["buffers"][0]:
        return -1
    if sum(starts) + count * _COMPONENTS[kind] > len(binary):
        return -1  # told of its view
    return int(np.frombuffer(binary, _INDEX_KINDS[kind], count, sum(starts)).max())


def _items(of: dict[str, Any], key: str) -> list[Any]:
    found = of.get(key)
    return found if isinstance(found, list) else []


def _is_round(parents: dict[int, int]) -> bool:
    """Whether somebody is their own ancestor."""
    good: set[int] = set()
    for first in parents:
        way: set[int] = set()
        at = first
        while at in parents and at not in good and at not in way:
            way.add(at)
            at = parents[at]
        if at in way:
            return True
        good |= way
    return False
