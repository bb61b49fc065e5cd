# SPDX-License-Identifier: GPL-3.0-or-later
"""Short description of a file of any format."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any, Final

from ..engine.rendering.raster import Raster
from ..errors import InputError
from ..files.findings import refuse_errors
from ..files.strict_json import mapped, parse, read_bytes
from .clip.writing import facts as clip_facts
from .files import FileFormat, format_of, read_signals, validate
from .glb import glb_rules
from .hjif import reader as hjif_reader
from .hjif.body_parts import described
from .jsonl import jsonl_samples
from .rasters import csv_raster, npz_raster
from .sound import wav_reader

_MOST_BYTES: Final = 1 << 30


def facts_of(path: Path) -> dict[str, Any]:
    """Format, validity and content of a file.

    Files of formats that other tools write may have errors that readers tolerate.

    Raises
    ------
    InputError
        It is of no known format, or cannot be read.
    """
    kind, findings = validate(path)
    errors = [each for each in findings if each.severity == "error"]
    if not kind.has_signals:
        refuse_errors(errors, str(path))
    facts: dict[str, Any] = {
        "file": str(path),
        "format": kind.title,
        "bytes": path.stat().st_size,
        "valid": f"no, {len(errors)} errors ('hfx validate' tells them)" if errors else "yes",
    }
    return facts | _TELLERS.get(kind.name, _signals)(path, kind)


def is_known(path: Path) -> bool:
    """Test that :func:`facts_of` knows a file's format; a ``.json`` is looked into."""
    try:
        format_of(path)
    except InputError:
        return False
    return True


def _signals(path: Path, kind: FileFormat) -> dict[str, Any]:
    signals, frequencies = read_signals(path)
    return {
        **({"metadata": texts} if signals and (texts := signals[0].credits.texts) else {}),
        **_reading_notes("notes", tuple(note for each in signals for note in each.notes)),
        **_reading_notes("left_out", tuple(note for each in signals for note in each.left_out)),
        "lowest_hz": frequencies.lowest_hz,
        "highest_hz": frequencies.highest_hz,
        "signals": [
            {
                "signal": each.name,
                "seconds": round(each.duration_s, 6),
                "peak": round(float(each.amplitude.values.max()), 4),
                "keyframes": len(each.amplitude),
                "transients": len(each.transients),
            }
            for each in signals
        ],
    }


def _reading_notes(key: str, sentences: tuple[str, ...]) -> dict[str, Any]:
    """Sentences about how a file was read, if there are any, a line each."""
    return {key: [{"": each} for each in sentences]} if sentences else {}


def _hjif(path: Path, kind: FileFormat) -> dict[str, Any]:
    document, notes = hjif_reader.decode_with_notes(read_bytes(path), str(path))
    return {
        **_reading_notes("notes", notes),
        "description": document.description,
        "profile": f"{document.profile}, level {document.level}",
        "timescale": document.timescale,
        "avatars": [each.mesh or each.type for each in document.avatars],
        "perceptions": [
            {
                "perception": each.description or str(each.id),
                "modality": each.perception_modality,
                "library": len(each.effect_library),
                "channels": [
                    {
                        "channel": channel.description or str(channel.id),
                        "where": described(channel.body_part_mask or 0),
                        "vertices": len(channel.vertices or ()),
                        "effects": sum(len(band.effects) for band in channel.bands),
                    }
                    for channel in each.channels
                ],
            }
            for each in document.perceptions
        ],
    }


def _raster(raster: Raster) -> dict[str, Any]:
    return {
        "rows": len(raster.times_s),
        "rate_hz": float(raster.rate_hz),
        "seconds": len(raster.times_s) / float(raster.rate_hz),
        "actuators": len(raster.actuators),
        "columns": len(raster.columns),
        "parameters": sorted({f"{each.parameter} [{each.unit}]" for each in raster.columns}),
    }


def _npz(path: Path, kind: FileFormat) -> dict[str, Any]:
    raster = npz_raster.read(path)
    return {"device": raster.device_id, "body": raster.body_id, **_raster(raster)}


def _csv(path: Path, kind: FileFormat) -> dict[str, Any]:
    return _raster(csv_raster.read(path))


def _wav(path: Path, kind: FileFormat) -> dict[str, Any]:
    form, _ = wav_reader.inspect(mapped(path))
    assert form is not None
    return {
        "channels": form.channels,
        "rate_hz": form.rate_hz,
        "samples": f"{form.bits} bit {'float' if form.is_float else 'integer'}",
        "seconds": round(form.duration_s, 6),
    }


def _jsonl(path: Path, kind: FileFormat) -> dict[str, Any]:
    header, *rest = jsonl_samples.read(path)
    return {
        "rate_hz": header["rate_hz"],
        "seconds": header["duration_s"],
        "bodies": [each["name"] for each in header["bodies"]],
        "effects": [each["name"] for each in header["effects"]],
        "samples": sum(line["type"] == "sample" for line in rest),
        "sets": sum(line["type"] == "set" for line in rest),
    }


def _glb(path: Path, kind: FileFormat) -> dict[str, Any]:
    found = glb_rules.read_json(read_bytes(path, _MOST_BYTES), str(path))
    return {
        "meshes": [str(each.get("name", "")) for each in found.get("meshes", [])],
        "nodes": len(found.get("nodes", [])),
        "animations": len(found.get("animations", [])),
        "extensions": [str(each) for each in found.get("extensionsUsed", [])],
    }


def _clip(path: Path, kind: FileFormat) -> dict[str, Any]:
    return clip_facts(read_bytes(path, _MOST_BYTES), str(path))


def _channels(path: Path, kind: FileFormat) -> dict[str, Any]:
    found = parse(read_bytes(path), str(path))
    of = {key: found[key] for key in ("device", "body", "layout") if key in found}
    return {**of, "rate_hz": found["rate_hz"], "channels": len(found["channels"])}


_TELLERS: Final[dict[str, Callable[[Path, FileFormat], dict[str, Any]]]] = {
    "hjif": _hjif,
    "npz": _npz,
    "csv": _csv,
    "wav": _wav,
    "jsonl": _jsonl,
    "glb": _glb,
    "clip": _clip,
    "channels": _channels,
}
