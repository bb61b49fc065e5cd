# SPDX-License-Identifier: GPL-3.0-or-later
"""Sounds of Blender's Speaker objects, as the voices of haptic volumes."""

from __future__ import annotations

import tempfile
from dataclasses import dataclass
from pathlib import Path

import bpy
import numpy as np

from hfx_blender.engine.arrays import F64
from hfx_blender.engine.scene import SceneDescription
from hfx_blender.errors import InputError

from ..commands import sound_reading


@dataclass(frozen=True, eq=False)
class Voice:
    """Sound of a Speaker, repeated while its volume is on."""

    samples: F64  # (n,) mono, times the Speaker's volume
    frequency_hz: float  # repetitions a second, times the Speaker's pitch


def voices_of(described: SceneDescription, own: list[bpy.types.Object]) -> dict[str, Voice]:
    """Voices by effect id, of volumes with an unmuted Speaker with a sound as a child; the first
    Speaker by name counts. ``own`` are the objects of the first effects of ``described``; instances
    have the voice of their source. Raises InputError for a sound that cannot be read."""
    voices: dict[str, Voice] = {}
    read: dict[str, Voice] = {}
    for k, effect in enumerate(described.effects):
        sources = [own[k]] if k < len(own) else []
        if not sources:  # the id of an instance is the id of the source, and the instance's label
            source_id = effect.id.partition(":")[0]
            sources = [x for x in bpy.data.objects if source_id in (x.hfx.uid, x.name)]
        for source in sources[:1]:
            speakers = sorted(filter(_is_heard, source.children_recursive), key=_name)
            if speakers:
                name = speakers[0].name_full
                read[name] = read.get(name) or _voice(speakers[0])
                voices[effect.id] = read[name]
    return voices


def _is_heard(obj: bpy.types.Object) -> bool:
    return obj.type == "SPEAKER" and obj.data.sound is not None and not obj.data.muted


def _name(obj: bpy.types.Object) -> str:
    return str(obj.name)


def _voice(speaker: bpy.types.Object) -> Voice:
    """Voice of a Speaker, mono; InputError for a missing, empty, too long or unreadable sound."""
    data, sound = speaker.data, speaker.data.sound
    path = Path(bpy.path.abspath(sound.filepath, library=sound.library))
    with tempfile.TemporaryDirectory() as folder:
        if sound.packed_file is not None:
            path = Path(folder) / path.name
            path.write_bytes(sound.packed_file.data)
        try:
            blocks, rate_hz, _ = sound_reading.blocks_of(path)
            parts = [block.mean(axis=1, dtype=np.float64) for block in blocks]
        except InputError as error:
            raise InputError(f"Speaker '{speaker.name}': {error}") from None
    samples = np.concatenate([np.zeros(0), *parts])
    if not len(samples) or not np.isfinite(samples).all():
        raise InputError(f"Speaker '{speaker.name}': its sound '{sound.name}' has no samples.")
    return Voice(samples * data.volume, float(data.pitch) * rate_hz / len(samples))
