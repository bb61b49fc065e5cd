# SPDX-License-Identifier: GPL-3.0-or-later
"""Named clips of a track, which an engine triggers one by one."""

from __future__ import annotations

from dataclasses import dataclass

from ..scene import Clip
from .header import TrackHeader


@dataclass(frozen=True)
class NamedClip:
    """Clip with the effects that share its name and frames."""

    name: str  # tells it from all others of the track, whether case counts or not
    clip: Clip
    effect_ids: tuple[str, ...]


def named_clips(header: TrackHeader) -> list[NamedClip]:
    """The clips of a track in the order of time.

    Effects that share a clip's name and frames belong together (a sensation of several
    modalities). Where clips share a name only, the later ones get their effect's name behind
    it, and a number if that is not enough.
    """
    groups: dict[tuple[str, float, float], list[tuple[str, str, Clip]]] = {}
    for effect in header.effects:
        for clip in effect.clips:
            key = (clip.name, clip.frame_start, clip.frame_end)
            groups.setdefault(key, []).append((effect.id, effect.name, clip))
    found: list[NamedClip] = []
    taken: set[str] = set()
    for key in sorted(groups, key=lambda key: (key[1], key[2])):
        members = groups[key]
        name = _free_name(key[0], members[0][1], taken)
        taken.add(name.casefold())
        ids = tuple(dict.fromkeys(effect_id for effect_id, _, _ in members))
        found.append(NamedClip(name, members[0][2], ids))
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
