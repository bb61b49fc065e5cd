# SPDX-License-Identifier: GPL-3.0-or-later
"""Small valid files of each format, that the fuzzing starts from."""

from __future__ import annotations

import json
import struct
import sys
from pathlib import Path
from typing import Any

import numpy as np

sys.path[:0] = [str(Path(__file__).resolve().parents[1] / "formats")]

from format_cases import RANGE, raster_for  # noqa: E402
from format_cases import signal as signal_of  # noqa: E402
from test_hjif import BEAT, sample, track_of  # noqa: E402

from hfx_blender.devices.configuration import load_device  # noqa: E402
from hfx_blender.engine.body.model import load_model  # noqa: E402
from hfx_blender.formats import files, glb, registry  # noqa: E402
from hfx_blender.formats.signals import Transient  # noqa: E402

MOST_BYTES = 8 << 10  # of one file: small ones are changed and read quickly
_LONG_LIST = 2  # items that a list of a shortened document keeps


def seeds(folder: Path) -> dict[str, list[bytes]]:
    """By format; ``folder`` is for what the writers write."""
    found: dict[str, list[bytes]] = {name: [] for name in files.FILE_FORMATS}
    _of_device(found, folder)
    _of_signals(found, folder)
    _of_track(found, folder)
    found["hjif"].append(json.dumps(sample()).encode())
    found["glb"] += _glbs()
    found["wav"].append(_wav())
    return {name: _smallest(each) for name, each in found.items()}


def _of_device(found: dict[str, list[bytes]], folder: Path) -> None:
    device = load_device("forearm_band_left")
    raster = raster_for(device, rows=30)
    for name in registry.DEVICE_FORMATS:
        if not name.startswith("wav"):
            for path in registry.write(name, raster, device, folder / f"a.{name}").files:
                found[files.format_of(path).name].append(path.read_bytes())


def _of_signals(found: dict[str, list[bytes]], folder: Path) -> None:
    ticking = signal_of([0, 1, 0.5, 0], transients=[Transient(0.01, 0.9, 100.0)])
    for name in ("ahap", "haptic", "he", "openxr"):
        write = registry.DEVICE_FORMATS[name].write_signals
        assert write is not None
        for path in write([ticking], RANGE, folder / f"b.{name}", registry.DEFAULT_TOLERANCE).files:
            found[name].append(path.read_bytes())


def _of_track(found: dict[str, list[bytes]], folder: Path) -> None:
    with track_of(folder, "vibration", "painted", BEAT) as track:
        for name in ("hjif", "jsonl"):
            written = registry.TRACK_FORMATS[name].write(
                track, (), folder / "c", registry.DEFAULT_TOLERANCE
            )
            for path in written.files:
                if path.suffix != glb.SUFFIX:
                    found[name].append(path.read_bytes())


def _glbs() -> list[bytes]:
    scene = glb.Document()
    scene.append("nodes", {"mesh": glb.add_model(scene, load_model("hfx-temperature-1"))})
    small = glb.Document()
    small.accessor(np.zeros((3, 3)))
    small.append("nodes", {"children": []})
    return [scene.encoded(), small.encoded()]


def _wav() -> bytes:
    form = struct.pack("<HHIIHH", 1, 1, 8000, 16000, 2, 16)
    return (
        b"RIFF" + struct.pack("<I", 44) + b"WAVEfmt " + struct.pack("<I", 16) + form
        + b"data" + struct.pack("<I", 8) + bytes(8)
    )  # fmt: skip


def _smallest(contents: list[bytes]) -> list[bytes]:
    """Each as it is and, where it is JSON, with its lists shortened."""
    every = {*contents, *filter(None, map(_shortened, contents))}
    fitting = [each for each in every if len(each) <= MOST_BYTES] or [min(every, key=len)]
    return sorted(fitting, key=lambda each: (len(each), each))[:8]


def _shortened(content: bytes) -> bytes | None:
    def short(tree: Any) -> Any:
        if isinstance(tree, list):
            return [short(each) for each in tree[:_LONG_LIST]]
        return {key: short(each) for key, each in tree.items()} if isinstance(tree, dict) else tree

    try:
        return json.dumps(short(json.loads(content))).encode()
    except ValueError:
        return None
