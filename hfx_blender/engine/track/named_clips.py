# SPDX-License-Identifier: GPL-3.0-or-later
"""Named clips of a track, which an engine triggers one by one."""

from __future__ import annotations

from dataclasses import dataclass

from ..scene import Clip
from .header import TrackHeader


@dataclass(frozen=True)
class NamedClip:
    """Clip of an effect."""

    name: str  # tells it from all others of the track, whether case counts or not
    clip: Clip
    effect_ids: tuple[str, ...]  # its own


def named_clips(header: TrackHeader) -> list[NamedClip]:
    """The clips of a track in the order of time, each of one effect.

    Where clips share a name the later ones get their effect's name behind it, and a number if
    that is not enough.
    """
    clips = [(clip, effect) for effect in header.effects for clip in effect.clips]
    found: list[NamedClip] = []
    taken: set[str] = set()
    for clip, effect in sorted(clips, key=lambda each: (each[0].frame_start, each[0].frame_end)):
        name = _free_name(clip.name, effect.name, taken)
        taken.add(name.casefold())
        found.append(NamedClip(name, clip, (effect.id,)))
    return found


def _free_name(clip: str, effect: str, taken: set[str]) -> str:
    candidates = [clip, f"{clip} {effect}"]
    for name in candidates:
        if name.casefold() not in taken:
            return name
    number = 2
    while f"{clip} {effect} {number}".casefold() in taken:
        number += 1
    return f"{clip} {effect} {number}"
