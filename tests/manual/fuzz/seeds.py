# SPDX-License-Identifier: GPL-3.0-or-later
"""Small valid files of each format, as the start of fuzzing."""

from __future__ import annotations

import io
import json
import struct
import sys
import zipfile
import zlib
from collections.abc import Callable
from pathlib import Path
from typing import Any, Final

import numpy as np

sys.path[:0] = [str(Path(__file__).resolve().parents[2] / "formats")]

from format_cases import RANGE, raster_for  # noqa: E402
from format_cases import signal as signal_of  # noqa: E402
from mutation import png_part  # noqa: E402
from readers import report_of  # noqa: E402
from test_hjif import BEAT, sample, track_of  # noqa: E402

from hfx_blender.authoring.paths import path_file  # noqa: E402
from hfx_blender.devices.configuration import load_device  # noqa: E402
from hfx_blender.engine.body.model import PerceptualModel, SkinWeights, load_model  # noqa: E402
from hfx_blender.engine.rendering.render import renderers_of_track  # noqa: E402
from hfx_blender.engine.texture.haptic_map import DeviceRange, HapticMap  # noqa: E402
from hfx_blender.files import resources  # noqa: E402
from hfx_blender.formats import files, writing  # noqa: E402
from hfx_blender.formats.glb import glb  # noqa: E402
from hfx_blender.formats.pictures import texture_map  # noqa: E402
from hfx_blender.formats.registry import FORMATS  # noqa: E402
from hfx_blender.formats.signals.signals import Transient  # noqa: E402
from hfx_tools.body_building import model_file  # noqa: E402
from hfx_tools.formats.hmpg import hmpg_writer  # noqa: E402

MOST_BYTES = 8 << 10  # limit of a file: small files are changed and read quickly
_LONG_LIST = 2  # items kept in a list of a shortened document


def seeds(folder: Path, name: str) -> list[bytes]:
    """Seeds of a reader or conversion; ``folder`` is for the writers' output."""
    kind = name.removesuffix("-to").removesuffix("-commands")
    if kind in _OTHERS:
        return _smallest(_OTHERS[kind](folder))
    actual: dict[str, list[bytes]] = {id: [] for id, info in FORMATS.items() if info.check}
    _of_device(actual, folder)
    _of_signals(actual, folder)
    _of_track(actual, folder)
    actual["hjif"].append(json.dumps(sample()).encode())
    actual["hmpg"].append(hmpg_writer.encoded(sample(), "x").content)
    actual["glb"] += _glbs()
    actual["wav"].append(_wav())
    return _smallest(actual[kind])


def _tracks(folder: Path) -> list[bytes]:
    actual = []
    for modality, kind in (("vibration", "painted"), ("wind", "volume"), ("temperature", "volume")):
        with track_of(folder, modality, kind, BEAT[:12]) as track:
            actual.append(track.path.read_bytes())
    return actual


def _devices(folder: Path) -> list[bytes]:
    return [path.read_bytes() for path in sorted(resources.device_configs().glob("*.json"))]


def _effects(folder: Path) -> list[bytes]:
    return [path.read_bytes() for path in sorted(resources.effect_library().glob("*.hfxeffect"))]


def _paths(folder: Path) -> list[bytes]:
    return [path.read_bytes() for path in path_file.library().values()]


def _node_maps(folder: Path) -> list[bytes]:
    nodes = [
        {"node_data": {"x": 0.1, "y": 1.2, "z": 0.1}, "radius": 0.05, "target_bone": "Chest"},
        {"x": -0.3, "y": 1.2, "z": 0, "target_bone": "LeftHand", "address": "/avatar/parameters/a"},
    ]
    return [json.dumps({"nodes": nodes}).encode()]


def _layouts(folder: Path) -> list[bytes]:
    places = [{"x": x, "y": y, "z": z} for x, y, z in ((0, 0, 1), (1, 2, 0), (2, 1, 1))]
    layout = {
        "name": "vest",
        "visualReference": "Skinetic",
        "actuators": [{"projectedViewPosition": item} for item in places],
        "views": [{"name": "Front", "Indexes": [0, 2]}, {"name": "Back", "indexes": [1]}],
    }
    return [json.dumps(layout).encode()]


def _maps(folder: Path) -> list[bytes]:
    layers = np.random.default_rng(0).uniform(size=(2, 4, 5)).astype(np.float32)
    actual = []
    for bits in (8, 16):
        haptic_map = HapticMap(layers[0], layers[1], (2e-4, 3e-4), False, DeviceRange())
        written = texture_map.write(haptic_map, folder / "m", bits)
        packed = io.BytesIO()
        with zipfile.ZipFile(packed, "w") as archive:
            for path in written.files:
                archive.write(path, path.name)
        actual.append(packed.getvalue())
    return actual


def _pngs(folder: Path) -> list[bytes]:
    """PNG files of every depth, kind of colour and filter."""
    actual = []
    node = b'{"1": {"inputs": {"seed": 1, "positive": ["2", 0]}}, "2": {"inputs": {"text": "a"}}}'
    words = b"a\nNegative prompt: b\nSteps: 2, Seed: 3, Model: c"
    texts = (
        (b"tEXt", b"prompt\0" + node),
        (b"zTXt", b"parameters\0\0" + zlib.compress(words)),
        (b"iTXt", b"workflow\0\0\0\0\0" + b'{"nodes": [{"id": 1, "inputs": []}], "links": [[1]]}'),
    )
    for colour, channels in ((0, 1), (2, 3), (4, 2), (6, 4)):
        for depth in (8, 16):
            unit = channels * depth // 8
            rows = b"".join(bytes([k]) + bytes(range(3 * unit)) for k in range(5))
            head = struct.pack(">IIBBBBB", 3, 5, depth, colour, 0, 0, 0)
            parts = ((b"IHDR", head), *texts, (b"IDAT", zlib.compress(rows)), (b"IEND", b""))
            actual.append(b"\x89PNG\r\n\x1a\n" + b"".join(png_part(*part) for part in parts))
    return actual


def _models(folder: Path) -> list[bytes]:
    """A model of few vertices: the shipped models are large."""
    path = folder / "x.npz"
    kinds = {
        "vertices": ("f4", (4, 3)), "triangles": ("i4", (2, 3)), "normals": ("f4", (4, 3)),
        "areas_m2": ("f4", (4,)), "part": ("u1", (4,)), "side": ("u1", (4,)),
        "mirror": ("i4", (4,)), "avatar_vertices": ("i4", (4, 3)),
        "avatar_weights": ("f4", (4, 3)), "avatar_offset_m": ("f4", (4,)),
    }  # fmt: skip
    arrays = {name: np.zeros(shape, kind) for name, (kind, shape) in kinds.items()}
    weights = SkinWeights(np.arange(5, dtype="i4"), np.zeros(4, "i4"), np.ones(4, "f4"))
    model_file.save(
        PerceptualModel(
            "x", "vibration", **arrays, bone_names=("b",), weights=weights, provenance={}
        ),
        path,
    )
    return [path.read_bytes()]


def _clouds(folder: Path) -> list[bytes]:
    head = "ply\nformat {} 1.0\nelement vertex 3\n{}end_header\n"
    axes = "".join(f"property float {axis}\n" for axis in "xyz")
    points = np.arange(9, dtype="<f4").reshape(3, 3)
    lines = "".join("{} {} {}\n".format(*row) for row in points.tolist())
    return [
        head.format("ascii", axes).encode() + lines.encode(),
        head.format("binary_little_endian", axes).encode() + points.tobytes(),
        lines.replace(" ", ";").encode(),
    ]


_OTHERS: Final[dict[str, Callable[[Path], list[bytes]]]] = {
    "track": _tracks,
    "device": _devices,
    "effect": _effects,
    "path": _paths,
    "nodemap": _node_maps,
    "unitouch": _layouts,
    "texture": _maps,
    "png": _pngs,
    "report": lambda folder: [report_of(folder)],
    "model": _models,
    "cloud": _clouds,
    "channels": lambda folder: [_channels()],
}


def _of_device(found: dict[str, list[bytes]], folder: Path) -> None:
    device = load_device("forearm_band_left")
    raster = raster_for(device, rows=30)
    for name in (id for id, info in FORMATS.items() if info.is_of_device):
        if not name.startswith("wav"):
            for path in writing.write(name, raster, device, folder / f"a.{name}").files:
                found[files.format_of(path).id].append(path.read_bytes())


def _of_signals(found: dict[str, list[bytes]], folder: Path) -> None:
    ticking = signal_of([0, 1, 0.5, 0], transients=[Transient(0.01, 0.9, 100.0)])
    for name in ("ahap", "haptic", "he", "openxr"):
        stem = folder / f"b.{name}"
        signals = writing.write_signals(FORMATS[name], [ticking], RANGE, stem, 0.01)
        for path in signals.files:
            found[name].append(path.read_bytes())


def _of_track(found: dict[str, list[bytes]], folder: Path) -> None:
    with track_of(folder, "vibration", "painted", BEAT) as track:
        for name in ("hjif", "jsonl"):
            written = writing.write_all((name,), (), track, (), folder / "c")
            for path in written.files:
                if path.suffix != glb.SUFFIX:
                    found[name].append(path.read_bytes())
        device = load_device("oculus_touch")
        played = [(d, r.raster()) for d, r in renderers_of_track(track, [device])]
        (path,) = (
            FORMATS["clip"].function("write_played")(track.header, played, folder / "c", None).files
        )
        found["clip"].append(path.read_bytes())


def _glbs() -> list[bytes]:
    scene = glb.Document()
    scene.append("nodes", {"mesh": glb.add_model(scene, load_model("hfx-temperature-1"))})
    small = glb.Document()
    small.accessor(np.zeros((3, 3)))
    small.append("nodes", {"children": []})
    views = [{"buffer": k, "byteLength": 6} for k in range(2)]
    corners = {"bufferView": 0, "componentType": 5123, "count": 3, "type": "SCALAR"}
    others = {"bufferView": 1, "byteOffset": 4, "componentType": 5121}
    sparse = {"count": 1, "indices": others, "values": {"bufferView": 1}}
    elsewhere = {
        "asset": {"version": "2.0"},
        "buffers": [
            {"byteLength": 6, "uri": "data:;base64,AAABAAIA"},
            {"byteLength": 6, "uri": "beside.bin"},
        ],
        "bufferViews": views,
        "accessors": [corners, {**corners, "sparse": sparse}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}, "indices": 1}]}],
    }
    text = json.dumps(elsewhere).encode()
    text += b" " * (-len(text) % 4)
    head = struct.pack("<4sIIII", b"glTF", 2, 20 + len(text), len(text), glb._JSON_CHUNK)
    return [scene.encoded(), small.encoded(), head + text]


def _wav() -> bytes:
    form = struct.pack("<HHIIHH", 1, 1, 8000, 16000, 2, 16)
    return (
        b"RIFF" + struct.pack("<I", 44) + b"WAVEfmt " + struct.pack("<I", 16) + form
        + b"data" + struct.pack("<I", 8) + bytes(8)
    )  # fmt: skip


def _channels() -> bytes:
    channels = [{"channel": k, "actuator": f"a{k}"} for k in range(2)]
    of = {"format": "hfx-wav-channels", "version": 1, "rate_hz": 48000, "start_s": 0.0}
    rest = {"device": "d", "body": "b", "full_scale_m_s2": 10.0, "channels": channels}
    return json.dumps(of | rest).encode()


def _smallest(contents: list[bytes]) -> list[bytes]:
    """Unchanged contents and, for JSON, contents with shortened lists."""
    every = {*contents, *filter(None, map(_shortened, contents))}
    fitting = [item for item in every if len(item) <= MOST_BYTES] or [min(every, key=len)]
    return sorted(fitting, key=lambda each: (len(each), each))[:8]


def _shortened(content: bytes) -> bytes | None:
    def short(tree: Any) -> Any:
        if isinstance(tree, list):
            return [short(item) for item in tree[:_LONG_LIST]]
        return {key: short(item) for key, item in tree.items()} if isinstance(tree, dict) else tree

    try:
        return json.dumps(short(json.loads(content))).encode()
    except ValueError:
        return None
