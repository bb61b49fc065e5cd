# SPDX-License-Identifier: GPL-3.0-or-later
"""``hfx info``: shows the content of a scene, track, model, device, or other known file."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from ..blender.scene_info import fps_of
from ..errors import InputError, refuse_no_file
from ..files.kinds import title_of
from ..processes import blender_session
from ..text import printable
from .arguments import add_json, add_largest
from .console import Console
from .own_files import kind_of


def add_parser(commands: Any) -> None:
    parser = commands.add_parser(
        "info", help="what is in a file", description="Show the content of a file."
    )
    parser.add_argument("file", type=Path, metavar="FILE")
    add_largest(parser)
    add_json(parser, run)


def run(options: argparse.Namespace, console: Console) -> int:
    """Print the facts of a file, as text or JSON."""
    from ..formats.files import facts_of, is_known

    readers = {".blend": _blend, ".hfxtrack": _track, ".npz": _model, ".json": _device}
    path: Path = options.file
    refuse_no_file(path)
    if own := kind_of(path):
        readers[path.suffix] = own.facts
    elif is_known(path):
        readers[path.suffix] = facts_of
    if path.suffix not in readers:
        raise InputError(
            f"{path}: '{path.suffix}' is not a known suffix; known are {', '.join(readers)} and "
            "the formats of hfx export."
        )
    with console.reading(path):
        facts = readers[path.suffix](path)
    console.say(_as_text(facts), several_lines=True)
    console.result(facts)
    return 0


def _blend(path: Path) -> dict[str, Any]:
    blender_session.open_blend(path)
    import bpy

    from ..authoring.effects.effects import bodies_of, effects_of
    from ..reading.description.activation import activation_of

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
                        **_where(effect),
                    }
                    for effect in effects_of(scene)
                ],
                "devices": [device.name for device in scene.hfx.devices],
            }
            for scene in bpy.data.scenes
        ],
    }


def _where(effect: Any) -> dict[str, Any]:
    """Facts about the area of an effect."""
    from ..authoring.effects.effects import area
    from ..authoring.paths import paths

    hfx = effect.hfx
    if hfx.kind == "PAINTED":
        return {"painted_vertices": len(area(effect)[0])}
    if hfx.kind == "SPOT":
        return {"path_m": round(paths.length_m(effect), 3), "radius": round(hfx.radius, 4)}
    if hfx.kind == "ACTUATORS":
        return {"device": hfx.device, "actuators": len(hfx.drive)}
    return {"shape": hfx.shape.lower()}


def _track(path: Path) -> dict[str, Any]:
    from ..engine.areas.felt_times import FeltTimes
    from ..engine.track import TrackReader
    from ..export.report import felt_effects

    times = FeltTimes()
    with TrackReader(path) as track:
        header = track.header
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
        }


def _model(path: Path) -> dict[str, Any]:
    from ..engine.body.model import PerceptualModel, load

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
    from ..devices.configuration import load_device
    from ..files.json_shapes import read

    content = read(path).value
    if not isinstance(content, dict) or not {"schema", "actuator_types"} & set(content):
        raise InputError(
            f"{path}: is {title_of(path)}; expected a device configuration, an export's report "
            "(.report.json), or a format of hfx export."
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


def _as_text(value: Any) -> str:
    """Format nested facts as indented lines."""
    return "\n".join(map(printable, _lines(value, 0)))


def _lines(value: Any, indent: int) -> list[str]:
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
