# SPDX-License-Identifier: GPL-3.0-or-later
"""Readers with their checks, and all conversions: the way of a stranger's file."""

from __future__ import annotations

import io
import json
import tempfile
import zipfile
import zlib
from collections.abc import Callable
from contextlib import suppress
from functools import partial
from pathlib import Path

from hfx_blender import file_limits
from hfx_blender.authoring import effect_file, path_file
from hfx_blender.batch import journal
from hfx_blender.batch.options import ExportOptions
from hfx_blender.batch.units import Unit
from hfx_blender.commands.info_report import facts_of_report
from hfx_blender.devices import node_map, strict_json, unitouch_layout
from hfx_blender.devices.configuration_reader import device_from
from hfx_blender.engine.body import model as body_model
from hfx_blender.engine.body.model import PerceptualModel, load_model
from hfx_blender.engine.track import TrackReader
from hfx_blender.errors import InputError
from hfx_blender.formats import csv_raster, files, npz_raster, png, point_cloud, texture_map
from hfx_blender.formats.clip import rules as clip_rules
from hfx_blender.formats.clip.container import with_checksum
from hfx_blender.formats.conversion import convert
from hfx_blender.formats.hjif import reader, text, to_signals
from hfx_blender.generation.picture_prompts import prompt_of

Reader = Callable[[bytes], None]

PARSERS = (
    *("ahap", "haptic", "he", "openharmony", "openxr", "tact", "hjif", "jsonl", "glb", "npz"),
    *("csv", "wav", "track", "device", "effect", "path", "nodemap", "unitouch", "texture", "png"),
    *("report", "model", "cloud", "clip"),
)
SUFFIXES = {
    "ahap": ".ahap",
    "haptic": ".haptic",
    "he": ".he",
    "openharmony": ".openharmony.json",
    "openxr": ".openxr.json",
    "tact": ".tact",
    "hjif": ".hjif",
    "npz": ".raster.npz",
    "csv": ".csv",
    "track": ".hfxtrack",
}
CONVERSIONS = tuple(f"{each}-to" for each in SUFFIXES)
"""Conversions of a format; which other one each input goes to is told by its bytes."""

DEVICE = "forearm_band_left"
SHARE = 1.0 / 64.0
"""Of what a file may ask for, in conversions: time and memory grow in step with it."""

_ENVELOPES = ("ahap", "haptic", "he", "he1", "openharmony", "openxr", "hjif")
_OF_A_DEVICE = (*_ENVELOPES, "tact", "wav", "csv", "npz")
_SHM = Path("/dev/shm")  # memory, where there is such a thing


def readers(name: str) -> Reader:
    """The reader or the conversion of a name; raises ``InputError`` for a bad file only."""
    folder = Path(tempfile.mkdtemp(prefix="hfx-fuzz-", dir=_SHM if _SHM.is_dir() else None))
    if name.endswith("-to"):
        return _conversion(name.removesuffix("-to"), folder)
    in_files: dict[str, Callable[[Path, bytes], None]] = {
        "track": _track,
        "texture": _texture,
        "png": _png,
        "report": _report,
        "model": _model,
        "cloud": _cloud,
    }
    if name in in_files:
        return partial(in_files[name], folder)
    of_bytes: dict[str, Reader] = {
        "clip": lambda content: void(clip_rules.validate(with_checksum(content), "x")),
        "npz": lambda content: void(npz_raster.decode(content, "x")),
        "csv": lambda content: void(csv_raster.decode(content, "x")),
        "hjif": _hjif,
        "device": lambda content: void(device_from(strict_json.parse(content, "x"))),
        "effect": lambda content: void(effect_file.from_text(content.decode("utf-8", "replace"))),
        "path": lambda content: void(path_file.recipe_of(strict_json.parse(content, "x"))),
        "nodemap": _node_map,
        "unitouch": _node_map,
    }
    return of_bytes[name] if name in of_bytes else _checked(files.FILE_FORMATS[name])


def void(found: object) -> None:
    """Do nothing: a reading without an exception is good."""


def _checked(kind: files.FileFormat) -> Reader:
    def read(content: bytes) -> None:
        findings = kind.validate(content, "x")
        if not kind.has_signals:
            return
        try:
            kind.signals(content, "x")
        except file_limits.TooLargeError:
            return
        except InputError:
            if not any(each.severity == "error" for each in findings):
                raise AssertionError("valid, but not read") from None

    return read


def _hjif(content: bytes) -> None:
    """Read, write again, read again: the same; and unfold."""
    document = reader.decode(content, "x")
    assert reader.decode(text.encode(document), "x") == document
    for each in to_signals.envelopes(document):
        assert len(each.strength) > 0
    to_signals.decode(content, "x")


def _node_map(content: bytes) -> None:
    document = strict_json.parse(content, "x.json")
    of = unitouch_layout if unitouch_layout.is_layout(document) else node_map
    made = of.configuration_of(document, "x", load_model(node_map.MODEL))
    device_from(strict_json.Node(made, "made"))  # what is made of it can be used


def _track(folder: Path, content: bytes) -> None:
    path = folder / "x.hfxtrack"
    path.write_bytes(content)
    with TrackReader(path) as track:
        track.summary()
        for _ in track.runs():
            pass
        track.samples_at(0.5)


def _texture(folder: Path, content: bytes) -> None:
    for name, part in _members(content).items():
        (folder / Path(name).name).write_bytes(part)
    texture_map.read(folder / "m.texture.json")


def _members(content: bytes) -> dict[str, bytes]:
    with suppress(Exception), zipfile.ZipFile(io.BytesIO(content)) as archive:
        return {each: archive.read(each)[: 1 << 20] for each in archive.namelist()[:3]}
    return {"m.texture.json": content}


def _png(folder: Path, content: bytes) -> None:
    path = folder / "x.png"
    path.write_bytes(content)
    prompt_of(png.texts(path))
    png.read(path)


def _report(folder: Path, content: bytes) -> None:
    source = folder / "x.blend"
    source.write_bytes(b"")
    (folder / "x.csv").write_bytes(b"")
    path = folder / "x.report.json"
    path.write_bytes(content)
    options = ExportOptions()
    journal.finished(Unit("scene", str(source), str(folder), "x", str(folder), options))
    facts_of_report(path)


def _model(folder: Path, content: bytes) -> None:
    path = folder / "x.npz"
    path.write_bytes(content)
    body_model.load(PerceptualModel, path)


def _cloud(folder: Path, content: bytes) -> None:
    path = folder / ("x.ply" if content.startswith(b"ply") else "x.xyz")
    path.write_bytes(content)
    point_cloud.read(path)


def _conversion(source: str, folder: Path) -> Reader:
    path = folder / f"x{SUFFIXES[source]}"
    if source == "track":
        asked = [("hjif", None), ("jsonl", None), *((each, DEVICE) for each in _OF_A_DEVICE)]
    elif source in ("npz", "csv"):
        asked = [(each, DEVICE) for each in _OF_A_DEVICE]
    else:
        asked = [(each, None) for each in _ENVELOPES] + [(each, DEVICE) for each in _OF_A_DEVICE]

    def read(content: bytes) -> None:
        target, device = asked[zlib.crc32(content) % len(asked)]
        path.write_bytes(content)
        try:
            with file_limits.raised(SHARE):
                written = convert(path, folder / "made", to=target, device=device)
            for each in written.files:
                each.unlink()
        finally:
            left = [each.name for each in folder.iterdir() if each != path]
            for name in left:
                (folder / name).unlink()
            assert not left, f"left behind: {left}"

    return read


def report_of(folder: Path) -> bytes:
    """A report that holds for an export of nothing."""
    from hfx_blender.batch import inputs

    source = folder / "x.blend"
    source.write_bytes(b"")
    unit = Unit("scene", str(source), str(folder), "x", str(folder), ExportOptions())
    empty = inputs.sha256_of(source)
    made_from = {
        "files": {"x.blend": empty},
        "devices": {"fan_heater": "0"},
        "models": {"hfx-temperature-1": "0"},
        "options": unit.options.as_json(),
        "tools": inputs.tools(),
    }
    document = {
        "scene": "x",
        "made_from": made_from,
        "files": [{"name": "x.csv", "bytes": 0, "sha256": empty}],
        "felt": [{"effect": "e"}],
        "warnings": ["w"],
    }
    return json.dumps(document).encode()
