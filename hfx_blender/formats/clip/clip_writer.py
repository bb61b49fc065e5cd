# SPDX-License-Identifier: GPL-3.0-or-later
"""Writer and facts of clips."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from ...engine.track.header import TrackHeader
from ...files import limits
from ...files.atomic import atomic_file
from ...files.strict_json import read_data
from ..signals import losses
from ..written import Written
from . import baked, clip_rules, spatial
from .container import SUFFIX, Texts, encoded, texts_at
from .spatial_recorder import SpatialRecorder


def write(
    header: TrackHeader, played: baked.Played, stem: Path, scene: SpatialRecorder | None = None
) -> Written:
    """Write ``stem.hfxclip``: device output of a track, and effects of a scene for avatars. Raises
    InputError for content beyond the format's limits, OutputError for an unwritable file; no
    partial file remains."""
    texts = Texts()
    path = stem.with_name(stem.name + SUFFIX)
    sections, loss = baked.sections_of(header, played, texts, stem.name)
    if scene is not None:
        of_scene, scene_loss = spatial.sections_of(scene, played, texts)
        sections, loss = {**sections, **of_scene}, loss + scene_loss
    # The last section to be made: all others add texts.
    sections["TEXT"] = texts.records
    content = encoded(sections, path.name)
    limits.MEMORY.check(len(content), path.name, "it would have")
    clip_rules.refuse_long(sections, path.name)
    with atomic_file(path) as file:
        file.write(content)
    notes = tuple(note for _, raster in played for note in losses.several_frequencies(raster))
    return Written((path,), notes=notes) + loss


def facts(path: Path) -> dict[str, Any]:
    """Content of a clip for ``hfx info``: rows, devices, clips, bodies, effects and surfaces.
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
