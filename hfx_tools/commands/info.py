# SPDX-License-Identifier: GPL-3.0-or-later
"""``hfx info``: shows the content of a scene, track, model, device, or other known file."""

from __future__ import annotations

import argparse
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from hfx_blender.blender.scene_info import fps_of
from hfx_blender.commands.arguments import add_json
from hfx_blender.commands.console import Console
from hfx_blender.errors import InputError, refuse_no_file
from hfx_blender.export.result_files import listed
from hfx_blender.files import kinds, limits
from hfx_blender.files.json_shapes import (
    PRINTABLE,
    Anything,
    Items,
    Number,
    Record,
    Table,
    Text,
    read,
)
from hfx_blender.processes import blender_session
from hfx_blender.text import printable

from .size_option import add_largest

_LISTS: Final = ("felt", "effects", "unrendered", "warnings", "notes")
_FILE: Final = Record(
    {"name": PRINTABLE, "bytes": Number(0, 1 << 50, is_whole=True)},
    unknown="ignore",
    title="an object with 'name' and 'bytes'",
)
_PLAIN: Final = Items(Table(Anything(), 1, title="an object with at least one member"))
_SENTENCES: Final = Items(Text(pattern=r"[^\x00-\x1f]*", note="a sentence"))
_REPORT: Final = Record(
    {"scene": Anything(), "files": Items(_FILE)},
    {key: _SENTENCES if key in ("warnings", "notes") else _PLAIN for key in _LISTS},
    unknown="ignore",
    title="an export's report",
)


def add_parser(commands: Any) -> None:
    parser = commands.add_parser(
        "info", help="what is in a file", description="Show the content of a file."
    )
    parser.add_argument("file", type=Path, metavar="FILE")
    add_largest(parser)
    add_json(parser, run)


def run(options: argparse.Namespace, console: Console) -> int:
    """Print the facts of a file, as text or JSON; returns 0. InputError for an unknown suffix."""
    readers = {".blend": _blend, ".hfxtrack": _track, ".npz": _model, ".json": _device}
    path: Path = options.file
    refuse_no_file(path)
    suffix = path.suffix.lower()
    # .json, .npz and .glb stand for several kinds each: the full name or the content decides.
    if own := kind_of(path):
        readers[suffix] = own.facts
    elif suffix != ".hfxtrack" and is_known(path):
        # Imported for these files alone: the readers of all formats take a tenth of a second.
        from ..formats.facts import facts_of

        readers[suffix] = facts_of
    if suffix not in readers:
        raise InputError(
            f"{path}: '{path.suffix}' is not a known suffix; known are "
            f"{', '.join([*readers, *kinds.OWN_KINDS])} and the formats of hfx export."
        )
    with console.reading(path):
        facts = readers[suffix](path)
    # Names in files may contain control characters.
    console.say("\n".join(map(printable, _lines(facts, 0))), several_lines=True)
    console.result(facts)
    return 0


def _blend(path: Path) -> dict[str, Any]:
    blender_session.open_blend(path)
    import bpy

    from hfx_blender.authoring.effects.effects import bodies_of, effects_of
    from hfx_blender.authoring.effects.sensation_levels import level_text
    from hfx_blender.reading.description.activation import activation_of

    return {
        "file": str(path),
        "scenes": [
            {
                "scene": scene.name,
                "frames": f"{scene.frame_start} to {scene.frame_end}",
                "fps": fps_of(scene),
                "bodies": [body.name for body in bodies_of(scene)],
                "effects": [
                    {
                        "effect": effect.name,
                        "modality": effect.hfx.modality,
                        "kind": effect.hfx.kind.lower(),
                        "clips": len(activation_of(effect).clips),
                        "above_threshold": level_text(effect, is_equal=scene.hfx.equal_feel)
                        or _without_level(effect),
                        **_where(effect),
                    }
                    for effect in effects_of(scene)
                ],
                "devices": [device.name for device in scene.hfx.devices],
            }
            for scene in bpy.data.scenes
        ],
    }


def _without_level(effect: Any) -> str:
    """Reason of an effect without a level in dB SL."""
    from hfx_blender.engine.body.detection import threshold

    has_threshold = (threshold(effect.hfx.modality) > 0.0).any()
    return "silent (strength 0)" if has_threshold else "no published threshold"


def _where(effect: Any) -> dict[str, Any]:
    """Facts about the area of an effect: painted vertices; path in metres and radius in Blender
    units; device and actuators; or the shape."""
    from hfx_blender.authoring.effects.effects import area
    from hfx_blender.authoring.paths import paths

    hfx = effect.hfx
    if hfx.kind == "PAINTED":
        return {"painted_vertices": len(area(effect)[0])}
    if hfx.kind == "SPOT":
        return {"path_m": round(paths.length_m(effect), 3), "radius": round(hfx.radius, 4)}
    if hfx.kind == "ACTUATORS":
        return {"device": hfx.device, "actuators": len(hfx.drive)}
    return {"shape": hfx.shape.lower()}


def _track(path: Path) -> dict[str, Any]:
    from hfx_blender.engine.areas.felt_times import FeltTimes
    from hfx_blender.engine.track import TrackReader
    from hfx_blender.export.report import felt_effects

    from ..missing_models import how_to_install, missing_models

    with TrackReader(path) as track:
        header = track.header
        missing = missing_models(header)
        # Levels in dB need the models, which may be missing, and are not shown: none is computed.
        times = FeltTimes(strongest_db={effect.id: 0.0 for effect in header.effects})
        times.add_runs(track.runs(), {effect.id for effect in header.effects if effect.is_contact})
        return {
            "file": str(path),
            "bytes": path.stat().st_size,
            "source": dict(header.source),
            "rate_hz": float(header.time.rate_hz),
            "fps": float(header.time.fps),
            "frames": f"{header.time.frame_first} to {header.time.frame_last}",
            "seconds": header.time.sample_count / float(header.time.rate_hz),
            "models": [
                {
                    "model": model.id,
                    "vertices": model.vertex_count,
                    "hash": model.content_hash[:12],
                }
                for model in header.models
            ],
            "felt": list(felt_effects(track, times)),
            "settings": dict(header.settings),
            "tools": dict(header.tools),
            "warnings": list(header.warnings),
            **({"not_installed": how_to_install(path, missing)} if missing else {}),
        }


def _model(path: Path) -> dict[str, Any]:
    from hfx_blender.engine.body.model import PerceptualModel, load

    model = load(PerceptualModel, path)
    return {
        "file": str(path),
        "model": model.id,
        "modality": model.modality,
        "vertices": len(model),
        "triangles": len(model.triangles),
        "area_m2": round(float(model.areas_m2.sum()), 3),
        "hash": model.content_hash,
        "licence": model.provenance.get("licence", ""),
        "source": model.provenance.get("source", ""),
    }


def _device(path: Path) -> dict[str, Any]:
    from hfx_blender.devices.configuration import load_device

    # JSON of another kind gets a message with the name of the kind.
    content = read(path).value
    if not isinstance(content, dict) or not {"schema", "actuator_types"} & set(content):
        raise InputError(
            f"{path}: is {kinds.title_of(path)}; expected a device configuration, an export's "
            "report (.report.json), or a format of hfx export."
        )
    return describe_device(load_device(path))


def describe_device(device: Any) -> dict[str, Any]:
    """Summary of a device configuration: id, name, actuator count, modalities and substitutions."""
    return {
        "device": device.id,
        "name": device.name,
        "actuators": len(device.actuators),
        "plays": list(device.modalities),
        "instead": {name: sub.target for name, sub in device.substitutions.items()},
    }


def _lines(value: Any, indent: int) -> list[str]:
    """Lines "key: value" of a dict of facts, nested facts indented; empty dicts are left out. Of a
    list of dicts, the first value is a title above the further ones; other lists are a line, "none"
    without items."""
    pad = "  " * indent
    lines: list[str] = []
    for key, entry in value.items():
        if isinstance(entry, dict):
            lines += [f"{pad}{key}:", *_lines(entry, indent + 1)] if entry else []
        elif isinstance(entry, list) and entry and isinstance(entry[0], dict):
            lines.append(f"{pad}{key}:")
            for item in entry:
                (_, title), *rest = item.items()
                lines += [f"{pad}  {title}", *_lines(dict(rest), indent + 2)]
        elif isinstance(entry, list):
            lines.append(f"{pad}{key}: {', '.join(map(str, entry)) or 'none'}")
        else:
            lines.append(f"{pad}{key}: {entry}")
    return lines


@dataclass(frozen=True)
class OwnFile:
    """Kind of file; ``facts`` reads a file and raises ``InputError`` for the first fault."""

    name: str
    title: str
    facts: Callable[[Path], dict[str, Any]]


def kind_of(path: Path) -> OwnFile | None:
    """Kind of a file by name; None for unknown names."""
    name = path.name.lower()
    for suffix, title in kinds.OWN_KINDS.items():
        if name.endswith(suffix):
            id, facts = _READERS[suffix]
            return OwnFile(id, title, facts)
    return None


def _effect(path: Path) -> dict[str, Any]:
    from hfx_blender.authoring.effects import effect_file

    sensation = effect_file.load(path)
    wheres = {
        effect_file.PartsArea: "area",
        effect_file.VertexArea: "area",
        effect_file.VolumeRecipe: "volume",
        effect_file.SpotRecipe: "spot",
        effect_file.ActuatorsRecipe: "actuators",
    }
    return {
        "file": str(path),
        "sensation": sensation.name,
        "description": sensation.description,
        "effects": [
            {
                "effect": effect.name,
                "modality": effect.modality,
                "where": wheres[type(effect.where)],
                "clips": len(effect.clips),
            }
            for effect in sensation.effects
        ],
    }


def _path(path: Path) -> dict[str, Any]:
    from hfx_blender.authoring.paths import path_file

    recipe = path_file.load(path)
    return {
        "file": str(path),
        "path": recipe.name,
        "description": recipe.description,
        "kind": recipe.kind,
        "closed": "yes" if recipe.is_closed else "no",
        "points": len(recipe.points_m),
        "motion_s": recipe.motion[-1][0] if recipe.motion else 0.0,
    }


def facts_of_report(path: Path) -> dict[str, Any]:
    """Content of an export's report, with the state of each listed file. A state is "there",
    "missing" or "of another size". Raises InputError for an invalid report."""
    document = read(path, int(limits.MEMORY.allowed))
    kinds.refuse_another(document.value, document.file, "report")
    report = document.hold(_REPORT)
    files = []
    for node in report["files"].items():
        name, size = node.get("name"), node.get("bytes")
        result = listed(path.parent, name)
        if result is None:
            node["name"].fail("the name of a file in its folder, or in folders below")
        state = "missing"
        if result.is_file():
            state = "there" if result.stat().st_size == size else "of another size"
        files.append({"name": name, "bytes": size, "state": state})
    return {
        "file": str(path),
        "scene": report.get("scene"),
        "complete": "yes" if all(file["state"] == "there" for file in files) else "no",
        "files": files,
        **{key: report.get(key, []) for key in _LISTS},
    }


_READERS: Final = {
    kinds.REPORT_SUFFIX: ("report", facts_of_report),
    kinds.EFFECT_SUFFIX: ("effect", _effect),
    kinds.PATH_SUFFIX: ("path", _path),
}


def is_known(path: Path) -> bool:
    """Test for a file of a format with ``check``; the content of ``.json`` files is read."""
    from hfx_blender.formats.files import format_of

    try:
        format_of(path)
    except InputError:
        return False
    return True
