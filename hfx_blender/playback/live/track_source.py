# SPDX-License-Identifier: GPL-3.0-or-later
"""A track that connected devices play in place of the open scene, in step with its frames."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING

import bpy

from ...authoring.effects import effects
from ...blender.scene_units import fps_of
from ...errors import InputError, refuse_no_file
from ...files.hashes import is_elsewhere

if TYPE_CHECKING:
    from ...devices.live.played_track import PlayedTrack
    from ...devices.live.playhead import Playhead
    from ...devices.workers.live_frame import LiveFrame


chosen: set[str] = set()
"""Tracks that were chosen in this session, not only named in a file that was opened."""


def is_chosen(scene: bpy.types.Scene) -> bool:
    """Test that devices are to play a track, not what is felt in the scene."""
    return bool(scene.hfx.live_source == "TRACK")


class TrackSource:
    """The chosen track, opened when it is needed.

    Attributes
    ----------
    track : PlayedTrack or None
    generation : int
        Another one after each track that was opened.
    """

    def __init__(self) -> None:
        self.track: PlayedTrack | None = None
        self.generation = 0
        self._key: tuple[object, ...] = ()

    def open(self, scene: bpy.types.Scene) -> PlayedTrack:
        """Open the track that a scene has chosen, unless it is open; the first body wears devices.

        Raises
        ------
        InputError
            None is chosen, or it cannot be read.
        """
        from ...devices.live.played_track import PlayedTrack
        from ...engine.track import SUFFIX

        if not scene.hfx.live_track:
            raise InputError("Choose a track, or press Record Track.")
        path = Path(bpy.path.abspath(scene.hfx.live_track))
        source = Path(bpy.data.filepath) if bpy.data.filepath else None
        if path.suffix.lower() != SUFFIX:
            raise InputError(f"{path}: is no track; choose a {SUFFIX} file.")
        if is_elsewhere(path, source) and scene.hfx.live_track not in chosen:
            raise InputError(f"{path}: is on another machine; choose it anew to play it.")
        bodies = effects.bodies_of(scene)
        wearer = bodies[0].hfx.uid if bodies else None
        refuse_no_file(path)
        found = path.stat()
        key = str(path), found.st_mtime_ns, found.st_size, wearer
        if self.track is None or key != self._key:
            self.forget()
            track = PlayedTrack(path)
            if wearer in [body.id for body in track.header.bodies]:
                track.body_id = wearer
            self.track, self._key = track, key
        return self.track

    def forget(self) -> None:
        """Close the track; the scene may have become another one."""
        if self.track is not None:
            self.track.close()
        self.track, self._key = None, ()
        self.generation += 1

    def frame(
        self, playhead: Playhead, gains: Mapping[int, float], latencies_ms: Iterable[float]
    ) -> LiveFrame:
        """Samples at the playhead, and later ones for actuators with latency.

        Raises
        ------
        InputError
            The file is damaged.
        """
        assert self.track is not None
        times = {}
        if playhead.is_playing:
            times = {ms: self.track.time_s(playhead.after(ms), playhead.fps) for ms in latencies_ms}
        now = self.track.time_s(playhead.frame, playhead.fps)
        return self.track.frame(now, later_s=times, gains=gains)


def summary(scene: bpy.types.Scene, source: TrackSource) -> str:
    """Sentence about the open track for the panel; empty if none is open."""
    track = source.track
    if track is None:
        return ""
    length_s = track.end_s - track.start_s
    last = track.time.scene_start + track.end_s * fps_of(scene)
    first = track.time.scene_start + track.start_s * fps_of(scene)
    count = len(track.header.effects)
    return (
        f"{count} effect{'' if count == 1 else 's'}, {length_s:.1f} s, "
        f"frames {first:.0f}-{last - 1:.0f}"
    )
