# SPDX-License-Identifier: GPL-3.0-or-later
"""Readers with their checks, and all conversions: the way of a stranger's file."""

from __future__ import annotations

import io
import json
import shutil
import tempfile
import warnings
import zipfile
import zlib
from collections.abc import Callable
from contextlib import redirect_stderr, redirect_stdout, suppress
from functools import partial
from pathlib import Path

from hfx_blender import cli
from hfx_blender.authoring.effects import effect_file
from hfx_blender.authoring.paths import path_file
from hfx_blender.devices.configuration import load_device
from hfx_blender.devices.configurations import imported_layouts
from hfx_blender.devices.configurations.configuration_reader import device_from
from hfx_blender.engine.body import model as body_model
from hfx_blender.engine.body.model import PerceptualModel, load_model
from hfx_blender.engine.track import TrackReader
from hfx_blender.errors import InputError
from hfx_blender.export.batch import journal
from hfx_blender.export.batch.units import ExportOptions, Unit
from hfx_blender.files import json_shapes, limits
from hfx_blender.files.strict_json import encoded
from hfx_blender.formats import files
from hfx_blender.formats.clip.container import with_checksum
from hfx_blender.formats.hjif import hjif_reader, to_signals
from hfx_blender.formats.pictures import png, point_cloud, texture_map
from hfx_blender.formats.registry import FORMATS, FormatInfo
from hfx_blender.generation.picture_folder import prompt_of
from hfx_tools.commands.conversion import convert
from hfx_tools.commands.info import facts_of_report
from hfx_tools.commands.played_clip import PlayedClip
from hfx_tools.commands.played_track import PlayedTrackSource
from hfx_tools.formats import clip_rules, csv_reader, hjif_signals, npz_reader
from hfx_tools.formats.hmpg import hmpg_files, hmpg_reader, hmpg_writer

Reader = Callable[[bytes], None]

PARSERS = (
    *("ahap", "haptic", "he", "openharmony", "openxr", "tact", "hjif", "jsonl", "glb", "npz"),
    "hmpg",
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
    "hmpg": ".hmpg",
    "npz": ".raster.npz",
    "csv": ".csv",
    "track": ".hfxtrack",
}
_COMMAND_SUFFIXES = {
    **SUFFIXES,
    "jsonl": ".jsonl",
    "glb": ".glb",
    "wav": ".wav",
    "channels": ".channels.json",
    "device": ".json",
    "effect": ".hfxeffect",
    "path": ".hfxpath",
    "nodemap": ".json",
    "unitouch": ".json",
    "texture": ".texture.json",
    "png": ".png",
    "report": ".report.json",
    "model": ".npz",
    "cloud": ".ply",
    "clip": ".hfxclip",
}
COMMANDS = tuple(f"{command_suffix}-commands" for command_suffix in _COMMAND_SUFFIXES)
"""All commands that read a format; what one converts to is told by its bytes."""

_DOCUMENTED = (0, 2, 3, 4, 5)  # allowed exit codes
CONVERSIONS = tuple(f"{item}-to" for item in SUFFIXES)
"""Conversions of a format; which other one each input goes to is told by its bytes."""

DEVICE = "forearm_band_left"
SHARE = 1.0 / 64.0
"""Of what a file may ask for, in conversions: time and memory grow in step with it."""

_ENVELOPES = ("ahap", "haptic", "he", "he1", "openharmony", "openxr", "hjif", "hmpg")
_OF_A_DEVICE = (*_ENVELOPES, "tact", "wav", "csv", "npz")
_SHM = Path("/dev/shm")  # memory, where there is such a thing


def readers(name: str) -> Reader:
    """The reader or the conversion of a name; raises ``InputError`` for a bad file only."""
    folder = Path(tempfile.mkdtemp(prefix="hfx-fuzz-", dir=_SHM if _SHM.is_dir() else None))
    if name.endswith("-commands"):
        return _commands(name.removesuffix("-commands"), folder)
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
        "npz": lambda content: void(npz_reader.decode(content, "x")),
        "csv": lambda content: void(csv_reader.decode(content, "x")),
        "hjif": _hjif,
        "hmpg": _hmpg,
        "device": lambda content: void(device_from(json_shapes.node_of(content, "x"))),
        "effect": lambda content: void(effect_file.from_text(content.decode("utf-8", "replace"))),
        "path": lambda content: void(path_file.recipe_of(json_shapes.node_of(content, "x"))),
        "nodemap": _node_map,
        "unitouch": _node_map,
    }
    return of_bytes[name] if name in of_bytes else _checked(FORMATS[name])


def void(found: object) -> None:
    """Do nothing: a reading without an exception is good."""


def _checked(info: FormatInfo) -> Reader:
    def read(content: bytes) -> None:
        findings = info.function("check")(content, "x")
        if not info.decode:
            return
        try:
            files.decoded(info, content, "x")
        except limits.TooLargeError:
            return
        except InputError:
            if not any(finding.severity == "error" for finding in findings):
                raise AssertionError("valid, but not read") from None

    return read


def _hjif(content: bytes) -> None:
    """Read, write again, read again: the same; and unfold."""
    document, _ = hjif_reader.decode(content, "x")
    assert hjif_reader.decode(encoded(document), "x")[0] == document
    for envelope in to_signals.envelopes(document):
        assert len(envelope.strength) > 0
    hjif_signals.decode(content, "x")


def _hmpg(content: bytes) -> None:
    """Read, write, read again: the same but for what HMPG rounds; then once more, exactly."""
    document, _ = hmpg_reader.decode(content, "x")
    hjif_signals.decode(encoded(document), "x")
    hmpg_files.validate(content, "x")
    once = hmpg_reader.decode(hmpg_writer.encoded(document, "x").content, "x")[0]
    assert hmpg_reader.decode(hmpg_writer.encoded(once, "x").content, "x")[0] == once


def _node_map(content: bytes) -> None:
    document = json_shapes.node_of(content, "x.json")
    configuration = imported_layouts.configuration_of(
        document, "x", load_model(imported_layouts.MODEL)
    )
    device_from(json_shapes.Node(configuration, "made"))  # the created configuration is usable


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
        return {item: archive.read(item)[: 1 << 20] for item in archive.namelist()[:3]}
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
    targets = _targets(source)

    def read(content: bytes) -> None:
        target, device = targets[zlib.crc32(content) % len(targets)]
        path.write_bytes(content)
        try:
            with limits.raised(SHARE):
                written = convert(path, folder / "made", to=target, device=device)
            for file in written.files:
                file.unlink()
        finally:
            left = [item.name for item in folder.iterdir() if item != path]
            for name in left:
                (folder / name).unlink()
            assert not left, f"left behind: {left}"

    return read


def _commands(kind: str, folder: Path) -> Reader:
    """``hfx`` in this process: an undocumented exit code is a fault, and so is a warning."""
    suffix = _COMMAND_SUFFIXES[kind]
    warnings.simplefilter("error", RuntimeWarning)
    cli.defect = _raise  # type: ignore[assignment]
    parser = cli.build_parser()  # most of the time of a small file
    cli.build_parser = lambda prog="hfx", names=(): parser  # type: ignore[assignment]
    path = folder / f"x{suffix}"

    def read(content: bytes) -> None:
        for name, part in (
            _members(content) if kind == "texture" else {path.name: content}
        ).items():
            (folder / ("x" + suffix if name.endswith(".json") else Path(name).name)).write_bytes(
                part
            )
        number = zlib.crc32(content)
        requests = [["validate", str(path)], ["info", str(path), "--largest", str(SHARE)]]
        requests[1] = requests[1][:2] if kind in ("device", "model") else requests[1]
        if kind in SUFFIXES:
            to, device = _targets(kind)[number % len(_targets(kind))]
            created = folder / "made"
            more = ["--device", device] if device else []
            requests.append(["convert", str(path), str(created / "y"), "--to", to, *more])
            requests[-1] += ["--largest", str(SHARE)]
            created.mkdir(exist_ok=True)
        if kind in ("device", "nodemap", "unitouch"):
            requests.append(["device", "check", str(path)])
        if kind in ("png", "cloud", "texture"):
            requests.append(["texture", "info", str(path)])
        try:
            for arguments in requests:
                with redirect_stdout(io.StringIO()), redirect_stderr(io.StringIO()):
                    code = cli.run(arguments)
                assert code in _DOCUMENTED, f"{arguments[0]} ended with {code}"
            if kind == "clip":
                PlayedClip(path, {"a": load_device("oculus_touch")})
            if kind == "track":
                with PlayedTrackSource(path):
                    pass
        finally:
            shutil.rmtree(folder / "made", ignore_errors=True)

    return read


def _raise(console: object) -> int:
    raise  # the exception handled by cli.run()


def _targets(source: str) -> list[tuple[str, str | None]]:
    """Target formats of a format's conversions, and the devices."""
    if source == "track":
        return [
            ("hjif", None),
            ("hmpg", None),
            ("jsonl", None),
            *((item, DEVICE) for item in _OF_A_DEVICE),
        ]
    if source in ("npz", "csv"):
        return [(item, DEVICE) for item in _OF_A_DEVICE]
    return [(envelope, None) for envelope in _ENVELOPES] + [(item, DEVICE) for item in _OF_A_DEVICE]


def report_of(folder: Path) -> bytes:
    """A report valid for an export of nothing."""
    from hfx_blender.files.hashes import sha256_of

    source = folder / "x.blend"
    source.write_bytes(b"")
    unit = Unit("scene", str(source), str(folder), "x", str(folder), ExportOptions())
    empty = sha256_of(source)
    made_from = {
        "files": {"x.blend": empty},
        "devices": {"fan_heater": "0"},
        "models": {"hfx-temperature-1": "0"},
        "options": unit.options.as_json(),
        "tools": journal.tools(),
    }
    document = {
        "scene": "x",
        "made_from": made_from,
        "files": [{"name": "x.csv", "bytes": 0, "sha256": empty}],
        "felt": [{"effect": "e"}],
        "warnings": ["w"],
    }
    return json.dumps(document).encode()
