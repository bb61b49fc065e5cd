# SPDX-License-Identifier: GPL-3.0-or-later
"""Rules of GLB files: the container, and the members used by HFX.

Checked are places of numbers in the file, references between members, order of an animation's
times, and extras of haptic volumes. Khronos' validator checks all further rules of glTF.
"""

from __future__ import annotations

import struct
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from hfx_blender.engine.modality import MODALITIES
from hfx_blender.files.findings import Finding, Report
from hfx_blender.files.json_shapes import Items, Number, Record, Shape, Text, check, strict
from hfx_blender.files.strict_json import Place
from hfx_blender.formats.glb import glb

_COMPONENTS: Final = {
    5120: "<i1",
    5121: "<u1",
    5122: "<i2",
    5123: "<u2",
    5125: "<u4",
    5126: "<f4",
}
_ITEMS: Final = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4, "MAT2": 4, "MAT3": 9, "MAT4": 16}
_COUNT: Final = Number(0, 2**53, is_whole=True)
_LISTS: Final[dict[str, Shape]] = {
    "buffers": Record({"byteLength": _COUNT}, unknown="ignore"),
    "bufferViews": Record(
        {"buffer": _COUNT, "byteLength": _COUNT},
        {"byteOffset": _COUNT, "byteStride": Number(4, 252, is_whole=True)},
        unknown="ignore",
    ),
    "accessors": Record(
        {
            "componentType": Number(choices=tuple(_COMPONENTS), is_whole=True),
            "count": Number(1, 2**53, is_whole=True),
            "type": Text(tuple(_ITEMS)),
        },
        {"bufferView": _COUNT, "byteOffset": _COUNT},
        unknown="ignore",
    ),
    "meshes": Record(
        {
            "primitives": Items(
                Record(
                    {"attributes": Record({}, {"POSITION": _COUNT}, unknown="ignore")},
                    {"indices": _COUNT},
                    unknown="ignore",
                ),
                least=1,
            )
        },
        unknown="ignore",
    ),
    "nodes": Record({}, {"mesh": _COUNT, "skin": _COUNT, "children": Items(_COUNT)}, "ignore"),
    "scenes": Record({}, {"nodes": Items(_COUNT)}, "ignore"),
    "animations": Record(
        {
            "samplers": Items(Record({"input": _COUNT, "output": _COUNT}, unknown="ignore"), 1),
            "channels": Items(
                Record(
                    {"sampler": _COUNT, "target": Record({}, {"node": _COUNT}, "ignore")},
                    unknown="ignore",
                ),
                1,
            ),
        },
        unknown="ignore",
    ),
}
"""Shapes of the items of a document's lists, of glTF 2.0's specification."""

_RANGE: Final = strict({"first": Number(), "lowest": Number(), "highest": Number()})
_VECTOR: Final = Items(Number(), 3, 3)
_VOLUME: Final = strict(
    {
        "hfx_effect": Text(),
        "modality": Text(tuple(MODALITIES)),
        "model": Text(),
        "shape": Text(("cuboid", "sphere", "cylinder", "capsule", "mesh", "surface")),
        "size_m": Items(Number(0.0), 3, 3),
        "level": _RANGE,
        "parameters": strict(
            {},
            {
                **{
                    parameter.name: _RANGE
                    for modality in MODALITIES.values()
                    for parameter in modality.controls
                },
                "neutral_c": Number(),
                "direction": _VECTOR,
            },
        ),
        "falloff": strict({"kind": Text(("none", "linear", "smooth")), "share": Number(0.0, 1.0)}),
        "clips": Items(strict({"name": Text(), "start_s": Number(), "end_s": Number()})),
    },
    {
        "contact_law": strict(
            {
                "stiffness_n_m": Number(0.0),
                "damping_n_s_m": Number(0.0),
                "friction": Number(0.0),
            }
        )
    },
)
"""Extras of a volume's node, as ``docs/formats/scene-volume.schema.json``."""


def validate(content: bytes, name: str) -> list[Finding]:
    """Return the findings of a file; InputError for unreadable JSON."""
    findings, document = glb.inspected(content, name)
    report = Report("GLB")
    lists = {key: document.get(key, []) for key in ("extensionsUsed", "extensionsRequired")}
    for key, names in lists.items():
        if not isinstance(names, list) or not all(isinstance(item, str) for item in names):
            report.error("TYPE", (None, key), "expected a list of texts")
            return findings + report.findings
    extensions = document.get("extensions")
    for extension in extensions if isinstance(extensions, dict) else ():
        if extension not in lists["extensionsUsed"]:
            report.error("EXTENSION", (None, "extensions"), f"{extension} is not in extensionsUsed")
    for extension in lists["extensionsRequired"]:
        message = f"only readers that know {extension} can open it"
        report.warn("EXTENSION-REQUIRED", None, message)
    if document and not findings:
        for key, shape in _LISTS.items():
            check(Items(shape), document.get(key, []), report, (None, key))
        if not report.has_errors:
            _check_content(document, _binary_chunk(content), report)
    return findings + report.findings


def _binary_chunk(content: bytes) -> bytes:
    """Bytes of the second chunk, empty without one; the container has no faults."""
    (length,) = struct.unpack_from("<I", content, 12)
    at = 20 + length
    if at + 8 > len(content):
        return b""
    (size,) = struct.unpack_from("<I", content, at)
    return content[at + 8 : at + 8 + size]


def _check_content(document: dict[str, Any], binary: bytes, report: Report) -> None:
    """Report numbers outside of the file, references to members that are not there, and faults of
    animations and volumes, of a document whose lists have no faults."""
    _check_references(document, report)
    sizes = [buffer["byteLength"] for buffer in document.get("buffers", [])]
    # A buffer with a URI is a file of its own; the chunk may be filled up by 3 bytes.
    if sizes and "uri" not in document["buffers"][0] and not 0 <= len(binary) - sizes[0] <= 3:
        message = f"is {sizes[0]}, the binary chunk has {len(binary)} bytes"
        report.error("BUFFER", (((None, "buffers"), 0), "byteLength"), message)
    for k, view in enumerate(document.get("bufferViews", [])):
        end = view.get("byteOffset", 0) + view["byteLength"]
        if view["buffer"] < len(sizes) and end > sizes[view["buffer"]]:
            message = f"ends at byte {end}, the buffer has {sizes[view['buffer']]} bytes"
            report.error("VIEW", ((None, "bufferViews"), k), message)
    views = document.get("bufferViews", [])
    for k, accessor in enumerate(document.get("accessors", [])):
        view_index = accessor.get("bufferView", len(views))
        if view_index < len(views) and "sparse" not in accessor:
            end, size = _end_of(accessor, views[view_index]), views[view_index]["byteLength"]
            if end > size:
                message = f"ends at byte {end} of its bufferView, which has {size} bytes"
                report.error("ACCESSOR", ((None, "accessors"), k), message)
    if not report.has_errors:
        _check_numbers(document, binary, report)
    for k, node in enumerate(document.get("nodes", [])):
        extras = node.get("extras")
        if isinstance(extras, dict) and "hfx_effect" in extras:
            check(_VOLUME, extras, report, (((None, "nodes"), k), "extras"))


def _check_references(document: dict[str, Any], report: Report) -> None:
    """Report each index of a member beyond the list that it refers to."""

    def refer(place: Place, index: int | None, target: str) -> None:
        count = len(document.get(target, []))
        if index is not None and index >= count:
            report.error("REFERENCE", place, f"is {index}, there are {count} {target}")

    for k, view in enumerate(document.get("bufferViews", [])):
        refer((((None, "bufferViews"), k), "buffer"), view["buffer"], "buffers")
    for k, accessor in enumerate(document.get("accessors", [])):
        here: Place = (((None, "accessors"), k), "bufferView")
        refer(here, accessor.get("bufferView"), "bufferViews")
    for k, mesh in enumerate(document.get("meshes", [])):
        for p, primitive in enumerate(mesh["primitives"]):
            at: Place = ((((None, "meshes"), k), "primitives"), p)
            refer((at, "POSITION"), primitive["attributes"].get("POSITION"), "accessors")
            refer((at, "indices"), primitive.get("indices"), "accessors")
    for k, node in enumerate(document.get("nodes", [])):
        for key, target in (("mesh", "meshes"), ("skin", "skins")):
            refer((((None, "nodes"), k), key), node.get(key), target)
        for child in node.get("children", []):
            refer((((None, "nodes"), k), "children"), child, "nodes")
    for k, scene in enumerate(document.get("scenes", [])):
        for root in scene.get("nodes", []):
            refer((((None, "scenes"), k), "nodes"), root, "nodes")
    for k, animation in enumerate(document.get("animations", [])):
        here = ((None, "animations"), k)
        for s, sampler in enumerate(animation["samplers"]):
            for key in ("input", "output"):
                refer((((here, "samplers"), s), key), sampler[key], "accessors")
        for c, channel in enumerate(animation["channels"]):
            place: Place = (((here, "channels"), c), "sampler")
            if channel["sampler"] >= len(animation["samplers"]):
                message = (
                    f"is {channel['sampler']}, there are {len(animation['samplers'])} samplers"
                )
                report.error("REFERENCE", place, message)
            refer((((here, "channels"), c), "target"), channel["target"].get("node"), "nodes")


def _check_numbers(document: dict[str, Any], binary: bytes, report: Report) -> None:
    """Report corners of triangles beyond the vertices of their primitive, and times of animations
    that do not ascend, of a document without other faults."""
    accessors = document.get("accessors", [])
    for k, mesh in enumerate(document.get("meshes", [])):
        for p, primitive in enumerate(mesh["primitives"]):
            position, indices = primitive["attributes"].get("POSITION"), primitive.get("indices")
            corners = None if indices is None else _numbers(document, indices, binary)
            if position is None or corners is None:
                continue
            highest, count = int(corners.max()), accessors[position]["count"]
            if highest >= count:
                message = f"name the vertex {highest}, allowed is 0 to {count - 1}"
                here = ((((None, "meshes"), k), "primitives"), p)
                report.error("INDEX", (here, "indices"), message)
    for k, animation in enumerate(document.get("animations", [])):
        for s, sampler in enumerate(animation["samplers"]):
            times = _numbers(document, sampler["input"], binary)
            if times is not None and not (np.diff(times) > 0.0).all():
                place: Place = (((((None, "animations"), k), "samplers"), s), "input")
                report.error("TIME-ORDER", place, "its times do not ascend")


def _numbers(document: dict[str, Any], index: int, binary: bytes) -> npt.NDArray[Any] | None:
    """Numbers of a scalar accessor, (n,); None if they are not all in the binary chunk."""
    accessor = document["accessors"][index]
    view_index = accessor.get("bufferView")
    if view_index is None or accessor["type"] != "SCALAR" or "sparse" in accessor:
        return None
    view = document["bufferViews"][view_index]
    kind = np.dtype(_COMPONENTS[accessor["componentType"]])
    if view["buffer"] or "uri" in document["buffers"][0] or view.get("byteStride"):
        return None
    first = view.get("byteOffset", 0) + accessor.get("byteOffset", 0)
    return np.frombuffer(binary, kind, accessor["count"], first)


def _end_of(accessor: dict[str, Any], view: dict[str, Any]) -> int:
    """First byte of a buffer view after the numbers of an accessor."""
    width = np.dtype(_COMPONENTS[accessor["componentType"]]).itemsize
    size = width * _ITEMS[accessor["type"]]
    stride = view.get("byteStride") or size
    return int(accessor.get("byteOffset", 0) + (accessor["count"] - 1) * stride + size)
