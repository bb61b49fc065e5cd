# SPDX-License-Identifier: GPL-3.0-or-later
"""Facts of files for ``hfx info``."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from hfx_blender.files.findings import refuse_errors
from hfx_blender.files.strict_json import read_data
from hfx_blender.formats.files import read_signals
from hfx_blender.formats.glb import glb
from hfx_blender.formats.hjif.body_parts import described

from . import clip_rules, companions
from .clip_reader import texts_at
from .hmpg.hmpg_files import document_at
from .validation import validate


def facts_of(path: Path) -> dict[str, Any]:
    """Return a file's format, size, validity and content for ``hfx info``.

    Of a format without ``facts``: metadata, notes and losses if any, the range of frequencies, and
    a row per signal. Errors of formats with ``decode`` are only counted, as readers tolerate some.
    Raises InputError for invalid files of further formats, and for unknown or unreadable files.
    """
    info, findings = validate(path, is_alone=True)
    errors = [finding for finding in findings if finding.severity == "error"]
    # Readers of envelopes tolerate some errors, others would fail on them.
    if not info.decode and info.id != "hmpg":
        refuse_errors(errors, str(path))
    if not errors:
        beside = companions.findings_of(info, path)
        errors = [finding for finding in beside if finding.severity == "error"]
    facts: dict[str, Any] = {
        "file": str(path),
        "format": info.title,
        "bytes": path.stat().st_size,
        "valid": f"no, {len(errors)} errors (run 'hfx validate' for a list)" if errors else "yes",
    }
    if info.facts:
        return facts | info.function("facts")(path)
    signals, frequencies = read_signals(path)
    notes = [note for signal in signals for note in signal.notes]
    left_out = [note for signal in signals for note in signal.left_out]
    return facts | {
        **({"metadata": texts} if signals and (texts := signals[0].credits.texts) else {}),
        **as_fact("notes", notes),
        **as_fact("left_out", left_out),
        "lowest_hz": frequencies.lowest_hz,
        "highest_hz": frequencies.highest_hz,
        "signals": [
            {
                "signal": signal.name,
                "seconds": round(signal.duration_s, 6),
                "peak": round(float(signal.amplitude.values.max()), 4),
                "keyframes": len(signal.amplitude),
                "transients": len(signal.transients),
            }
            for signal in signals
        ],
    }


def hjif_facts(path: Path) -> dict[str, Any]:
    """Description, profile, avatars, perceptions and tolerated faults of HJIF or HMPG for
    ``hfx info``."""
    document, notes = document_at(path)
    return {
        **as_fact("notes", notes),
        "description": document["description"],
        "profile": f"{document['profile']}, level {document['level']}",
        "timescale": document.get("timescale"),
        "avatars": [avatar.get("mesh") or avatar["type"] for avatar in document["avatars"]],
        "perceptions": [
            {
                "perception": perception["description"] or str(perception["id"]),
                "modality": perception["perception_modality"],
                "library": len(perception["effect_library"]),
                "channels": [
                    {
                        "channel": channel["description"] or str(channel["id"]),
                        "where": described(channel.get("body_part_mask", 0)),
                        "vertices": len(channel.get("vertices", ())),
                        "effects": sum(len(band["effects"]) for band in channel["bands"]),
                    }
                    for channel in perception["channels"]
                ],
            }
            for perception in document["perceptions"]
        ],
    }


def glb_facts(path: Path) -> dict[str, Any]:
    """Mesh names, node and animation counts, extensions for ``hfx info``; InputError if invalid."""
    document = glb.read_json(read_data(path), str(path))
    return {
        "meshes": [str(mesh.get("name", "")) for mesh in document.get("meshes", [])],
        "nodes": len(document.get("nodes", [])),
        "animations": len(document.get("animations", [])),
        "extensions": [str(extension) for extension in document.get("extensionsUsed", [])],
    }


def clip_facts(path: Path) -> dict[str, Any]:
    """Content of a clip for ``hfx info``: rows, devices, clips, bodies, models, effects, surfaces.
    Raises InputError for an invalid clip."""
    sections = clip_rules.read(read_data(path), str(path))
    at = sections["TIME"][0]
    devices, clips, effects = sections["DEVC"], sections["CLIP"], sections["EFCT"]
    surfaces, maps = sections["SURF"], sections["HMAP"]
    names = zip(texts_at(sections, devices["id"]), texts_at(sections, devices["body"]), strict=True)
    return {
        "rows": int(at["rows"]),
        "rate_hz": float(at["rate_hz"]),
        "seconds": float(at["rows"]) / float(at["rate_hz"]),
        "devices": [
            {"device": device, "body": body, "actuators": int(entry["actuators"])}
            for (device, body), entry in zip(names, devices, strict=True)
        ],
        "rows_kept": len(sections["ROWS"]),
        "clips": [
            {
                "clip": clip,
                "from_s": float(entry["start_s"]),
                "to_s": float(entry["end_s"]),
                "loops": bool(entry["loops"]),
            }
            for clip, entry in zip(texts_at(sections, clips["name"]), clips, strict=True)
        ],
        "bodies": texts_at(sections, sections["BODY"]["name"]),
        "models": list(dict.fromkeys(texts_at(sections, effects["model"]))),
        "effects": texts_at(sections, effects["name"]),
        "surfaces": [
            {
                "surface": name,
                "size_mm": maps["mm"][entry["map"]].tolist(),
                "tiles": bool(maps["tiles"][entry["map"]]),
                "amplitude_m_s2": entry["m_s2"].tolist(),
                "frequency_hz": entry["hz"].tolist(),
            }
            for name, entry in zip(texts_at(sections, surfaces["name"]), surfaces, strict=True)
        ],
    }


def as_fact(key: str, sentences: Sequence[str]) -> dict[str, Any]:
    """Dict of ``key`` and a row ``{"": sentence}`` for each sentence; empty without sentences."""
    return {key: [{"": sentence} for sentence in sentences]} if sentences else {}
