# SPDX-License-Identifier: GPL-3.0-or-later
"""Rules of glTF 2.0 binary files: the container, references, bounds of accessors and buffers."""

from __future__ import annotations

import base64
import binascii
import struct
from pathlib import Path
from typing import Any, Final
from urllib.parse import unquote

import numpy as np
import numpy.typing as npt

from ...errors import InputError
from ...files import limits
from ...files.findings import Finding, Report, refuse_errors
from ...files.strict_json import MAX_BYTES, Place, mapped, parse, read_bytes
from .glb import BINARY_CHUNK, JSON_CHUNK

_COMPONENTS: Final = {5120: 1, 5121: 1, 5122: 2, 5123: 2, 5125: 4, 5126: 4}
_TYPES: Final = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4, "MAT2": 4, "MAT3": 9, "MAT4": 16}
_INDEX_KINDS: Final = {5121: "u1", 5123: "<u2", 5125: "<u4"}
_LISTS: Final = (
    *("nodes", "meshes", "skins", "accessors"),
    *("bufferViews", "buffers", "scenes", "animations"),
)
_MOST_BYTES: Final = 1 << 30
_SHOWN: Final = 60  # characters of a URI that a message repeats


def read_json(content: bytes, name: str) -> dict[str, Any]:
    """The JSON part of a GLB file; ``name`` as for :func:`validate`.

    Raises
    ------
    InputError
        It is no valid GLB file.
    """
    refuse_errors(validate(content, name), name)
    found: dict[str, Any] = parse(_chunks(content, Report("GLB"))[JSON_CHUNK], name)
    return found


def facts(path: Path) -> dict[str, Any]:
    """Short description of a valid file."""
    found = read_json(read_bytes(path, _MOST_BYTES), str(path))
    return {
        "meshes": [str(each.get("name", "")) for each in found.get("meshes", [])],
        "nodes": len(found.get("nodes", [])),
        "animations": len(found.get("animations", [])),
        "extensions": [str(each) for each in found.get("extensionsUsed", [])],
    }


def validate(content: bytes, name: str) -> list[Finding]:
    """Faults of a GLB file: the container, the references, the bounds of its accessors.

    Parameters
    ----------
    content : bytes
    name : str
        Its path; buffers in files of their own lie beside it or in folders below.

    Raises
    ------
    InputError
        Its JSON cannot be read.
    """
    report = Report("GLB")
    chunks = _chunks(content, report)
    if JSON_CHUNK not in chunks or report.has_errors:
        report.error("JSON-CHUNK", None, "it has no JSON chunk")
        return report.findings
    found = parse(chunks[JSON_CHUNK], name)
    if not isinstance(found, dict) or found.get("asset", {}) == {}:
        report.error("ASSET", None, "it has no asset")
        return report.findings
    if not isinstance(found["asset"], dict) or found["asset"].get("version") != "2.0":
        report.error("ASSET", (None, "asset"), "the version is not 2.0")
    lists: dict[str, list[Any]] = {}
    for key in _LISTS:
        items = found.get(key, [])
        if not isinstance(items, list) or not all(isinstance(each, dict) for each in items):
            report.error("TYPE", (None, key), "expected a list of objects")
            return report.findings
        lists[key] = items
    buffers = _Buffers(lists["buffers"], chunks.get(BINARY_CHUNK, b""), Path(name).parent, report)
    _Rules(found, lists, buffers, report).check()
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


class _Buffers:
    """Content of the buffers: the binary chunk, ``data:`` URIs, files beside the GLB."""

    def __init__(
        self, buffers: list[dict[str, Any]], binary: bytes, folder: Path, report: Report
    ) -> None:
        self._report = report
        self._folder = folder
        self.contents: list[bytes | None] = [  # None: there is none to see
            self._content(k, buffer, binary) for k, buffer in enumerate(buffers)
        ]

    def _content(self, k: int, buffer: dict[str, Any], binary: bytes) -> bytes | None:
        place = ((None, "buffers"), k)
        size: Any = buffer.get("byteLength")
        if not _is_count(size):
            self._report.error("BUFFER", place, "it has no byteLength")
            return None
        if "uri" in buffer:
            content = self._named(buffer["uri"], place)
            if content is not None and len(content) < size:
                message = f"byteLength is {size}, its uri has {len(content)}"
                self._report.error("BUFFER", place, message)
            return content
        if k > 0:
            return None  # an extension's
        if not size <= len(binary) <= size + 3:
            message = f"byteLength is {size}, the binary chunk has {len(binary)}"
            self._report.error("BUFFER", place, message)
        return binary

    def _named(self, uri: Any, place: Place) -> bytes | None:
        """Content that a URI names; None: it cannot be read, which is told."""
        if not isinstance(uri, str):
            self._report.error("BUFFER", place, "its uri is no text")
            return None
        if uri.startswith("data:"):
            try:
                return base64.b64decode(uri.partition(";base64,")[2], validate=True)
            except (binascii.Error, ValueError):
                self._report.error("BUFFER", place, "its data: URI is no base64")
                return None
        path = Path(unquote(uri))
        shown = repr(uri[:_SHOWN])
        if ":" in uri or path.is_absolute() or ".." in path.parts:
            # A stranger's file does not choose what else is read.
            self._report.warn("BUFFER-OUTSIDE", place, f"{shown} is not beside the file: not read")
            return None
        try:
            if (self._folder / path).is_file():
                return mapped(self._folder / path)
            reason = "is not there"
        except (InputError, OSError, ValueError):
            reason = "cannot be read"
        self._report.error("BUFFER", place, f"{shown} {reason}")
        return None


class _Rules:
    """Rules of one document, whose ``lists`` are lists of objects."""

    def __init__(
        self,
        found: dict[str, Any],
        lists: dict[str, list[Any]],
        buffers: _Buffers,
        report: Report,
    ) -> None:
        self._found = found
        self._lists = lists
        self._buffers = buffers
        self._report = report

    def check(self) -> None:
        """Report every fault."""
        self._check_extensions()
        for kind, rule in (
            ("bufferViews", self._check_view),
            ("skins", self._check_skin),
            ("accessors", self._check_accessor),
            ("meshes", self._check_mesh),
            ("animations", self._check_animation),
        ):
            for k, item in enumerate(self._lists[kind]):
                rule(item, ((None, kind), k))
        self._check_nodes()

    def _refers(self, value: Any, kind: str, place: Place) -> bool:
        is_index = isinstance(value, int) and not isinstance(value, bool)
        if is_index and 0 <= value < len(self._lists[kind]):
            return True
        self._report.error("REFERENCE", place, f"{value!r} is none of the {kind}"[:100])
        return False

    def _check_extensions(self) -> None:
        extensions = self._found.get("extensions")
        used = self._found.get("extensionsUsed", [])
        required = self._found.get("extensionsRequired", [])
        for key in extensions if isinstance(extensions, dict) else ():
            if not isinstance(used, list) or key not in used:
                message = f"{key} is not in extensionsUsed"
                self._report.error("EXTENSION", (None, "extensions"), message)
        for each in required if isinstance(required, list) else ():
            message = f"only readers that know {each} can open it"
            self._report.warn("EXTENSION-REQUIRED", None, message)

    def _check_view(self, view: dict[str, Any], place: Place) -> None:
        start, length = view.get("byteOffset", 0), view.get("byteLength")
        if not _is_count(start) or not _is_count(length):
            self._report.error("VIEW", place, "its offset or length is no whole number")
        elif self._refers(view.get("buffer"), "buffers", place):
            total = self._lists["buffers"][view["buffer"]].get("byteLength")
            if isinstance(total, int) and start + length > total:
                self._report.error("VIEW", place, "it reaches beyond its buffer")
        stride = view.get("byteStride", 4)
        if not _is_count(stride) or not 4 <= stride <= 252 or stride % 4:
            self._report.error("VIEW", place, "its byteStride is none of 4, 8, ... 252")

    def _check_skin(self, skin: dict[str, Any], place: Place) -> None:
        joints = _items(skin, "joints")
        if not joints:
            self._report.error("SKIN", place, "it has no joints")
        for joint in joints:
            self._refers(joint, "nodes", place)
        if "inverseBindMatrices" in skin and self._refers(
            skin["inverseBindMatrices"], "accessors", place
        ):
            bind = self._lists["accessors"][skin["inverseBindMatrices"]]
            count = bind.get("count")
            if bind.get("type") != "MAT4" or not _is_count(count) or count < len(joints):
                self._report.error("SKIN", place, "its inverse bind matrices are not one a joint")

    def _check_accessor(self, accessor: dict[str, Any], place: Place) -> None:
        """Check an accessor's numbers, where they lie, and those that a sparse one replaces."""
        kind: Any = accessor.get("componentType")
        count: Any = accessor.get("count")
        width = _COMPONENTS.get(kind, 0) if type(kind) is int else 0
        item = width * _TYPES.get(str(accessor.get("type")), 0)
        if not item or not _is_count(count) or count < 1:
            self._report.error("ACCESSOR", place, "its component type, type or count is wrong")
            return
        if "bufferView" in accessor:
            self._check_place(accessor, count, item, place)
        elif count * item > limits.MEMORY.allowed:  # zeros, of which the file holds none
            self._report.error(
                "ACCESSOR", place, f"{count} items of {item} bytes, none in the file"
            )
        if "sparse" not in accessor:
            return
        sparse = accessor["sparse"] if isinstance(accessor["sparse"], dict) else {}
        replaced: Any = sparse.get("count")
        indices: Any = sparse.get("indices")
        values: Any = sparse.get("values")
        index_kind: Any = indices.get("componentType") if isinstance(indices, dict) else None
        is_sound = _is_count(replaced) and 1 <= replaced <= count and isinstance(values, dict)
        if not is_sound or type(index_kind) is not int or index_kind not in _INDEX_KINDS:
            message = "its 'sparse' has a wrong count, indices or values"
            self._report.error("ACCESSOR", place, message)
            return
        self._check_place(indices, replaced, _COMPONENTS[index_kind], place)
        self._check_place(values, replaced, item, place)

    def _check_place(self, of: dict[str, Any], items: int, size: int, place: Place) -> None:
        """Check that so many items of so many bytes lie within a view."""
        if not self._refers(of.get("bufferView"), "bufferViews", place):
            return
        view = self._lists["bufferViews"][of["bufferView"]]
        start: Any = of.get("byteOffset", 0)
        stride: Any = view.get("byteStride", size)
        length: Any = view.get("byteLength")
        if not _is_count(start) or not _is_count(stride) or not _is_count(length):
            self._report.error("ACCESSOR", place, "its offset is no whole number")
        elif start + (items - 1) * stride + size > length:
            self._report.error("ACCESSOR", place, "it reaches beyond its view")

    def _check_mesh(self, mesh: dict[str, Any], place: Place) -> None:
        for primitive in _items(mesh, "primitives"):
            attributes = primitive.get("attributes") if isinstance(primitive, dict) else None
            attributes = attributes if isinstance(attributes, dict) else {}
            fits = [self._refers(value, "accessors", place) for value in attributes.values()]
            if not isinstance(primitive, dict) or "indices" not in primitive:
                continue
            if self._refers(primitive["indices"], "accessors", place) and fits and all(fits):
                accessors = self._lists["accessors"]
                counts = [accessors[each].get("count") for each in attributes.values()]
                highest = self._highest(accessors[primitive["indices"]])
                if any(_is_count(each) and highest >= each for each in counts):
                    message = f"a triangle has the vertex {highest}: too few"
                    self._report.error("INDEX", place, message)

    def _highest(self, accessor: dict[str, Any]) -> int:
        """Highest index in an accessor; -1 where there is none to see."""
        kind: Any = accessor.get("componentType")
        found = self._whole_numbers(accessor, accessor.get("count"), kind)
        sparse = accessor.get("sparse")
        if isinstance(sparse, dict):
            at, values = sparse.get("indices"), sparse.get("values")
            if not isinstance(at, dict) or not isinstance(values, dict):
                return -1
            new = self._whole_numbers(values, sparse.get("count"), kind)
            places = self._whole_numbers(at, sparse.get("count"), at.get("componentType"))
            if new is not None and found is None:
                found = new
            elif new is not None and found is not None and places is not None:
                found = found.copy()
                found[places[places < len(found)]] = new[places < len(found)]
        return -1 if found is None else int(found.max())

    def _whole_numbers(
        self, of: dict[str, Any], count: Any, kind: Any
    ) -> npt.NDArray[np.integer[Any]] | None:
        """Whole numbers (count,) at a place; None where there are none to see."""
        view: Any = of.get("bufferView")
        if type(kind) is not int or kind not in _INDEX_KINDS or not _is_count(view):
            return None
        if view >= len(self._lists["bufferViews"]):
            return None
        buffer: Any = self._lists["bufferViews"][view].get("buffer")
        if not _is_count(buffer) or buffer >= len(self._buffers.contents):
            return None
        content = self._buffers.contents[buffer]
        starts = self._lists["bufferViews"][view].get("byteOffset", 0), of.get("byteOffset", 0)
        if content is None or not all(map(_is_count, (*starts, count))) or not count:
            return None
        if sum(starts) + count * _COMPONENTS[kind] > len(content):
            return None  # told of its view
        return np.frombuffer(content, _INDEX_KINDS[kind], count, sum(starts))

    def _check_nodes(self) -> None:
        parents: dict[int, int] = {}
        for k, node in enumerate(self._lists["nodes"]):
            place = ((None, "nodes"), k)
            for key, kind in (("mesh", "meshes"), ("skin", "skins")):
                if key in node:
                    self._refers(node[key], kind, place)
            for child in _items(node, "children"):
                if self._refers(child, "nodes", place) and parents.setdefault(child, k) != k:
                    child_place = ((None, "nodes"), child)
                    self._report.error("NODE-TREE", child_place, "it has two parents")
        if _is_round(parents):
            self._report.error("NODE-TREE", (None, "nodes"), "a node is below itself")
        if "scene" in self._found:
            self._refers(self._found["scene"], "scenes", (None, "scene"))
        for k, scene in enumerate(self._lists["scenes"]):
            for node in _items(scene, "nodes"):
                self._refers(node, "nodes", ((None, "scenes"), k))

    def _check_animation(self, animation: dict[str, Any], place: Place) -> None:
        for sampler in _items(animation, "samplers"):
            if isinstance(sampler, dict):
                self._refers(sampler.get("input"), "accessors", place)
                self._refers(sampler.get("output"), "accessors", place)
        for channel in _items(animation, "channels"):
            target = channel.get("target") if isinstance(channel, dict) else None
            if isinstance(target, dict) and "node" in target:
                self._refers(target["node"], "nodes", place)


def _is_count(value: Any) -> bool:
    return type(value) is int and value >= 0


def _items(of: dict[str, Any], key: str) -> list[Any]:
    found = of.get(key)
    return found if isinstance(found, list) else []


def _is_round(parents: dict[int, int]) -> bool:
    """Test that a node is its own ancestor."""
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
