# SPDX-License-Identifier: GPL-3.0-or-later
"""Sample sources of connected devices: the open scene, or a track synchronized with its frames."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING

import bpy

from ...authoring.effects import effects
from ...blender.scene_info import fps_of
from ...errors import InputError, refuse_no_file
from ...files.hashes import is_elsewhere
from ..evaluation import evaluation
from ..timeline.timeline_recorder import recorder
from .latency import recorded_runs

if TYPE_CHECKING:
    from ...devices.live.client import LiveClient
    from ...devices.live.track_playback import PlayedTrack
    from ...devices.workers.live_frame import LiveFrame
    from ...engine.samples import Stream

Generation = tuple[str, int]
"""Kind of a source, and the number of its description, which rises."""


class SceneSource:
    """The open scene; samples of later frames come from the record of values over the timeline.

    :class:`TrackSource` has the same methods.
    """

    def __init__(self) -> None:
        self._streams: tuple[Stream, ...] = ()

    @property
    def generation(self) -> Generation:
        return "scene", evaluation.generation

    @property
    def is_open(self) -> bool:
        """Test for a readable scene."""
        return evaluation.scene is not None

    @property
    def fault(self) -> str:
        """Error of the last :meth:`open`; empty without an error."""
        return evaluation.fault

    def open(self, context: bpy.types.Context) -> None:
        """Describe the scene if changed; never call this during a depsgraph update."""
        evaluation.describe(context)
        recorder.check_settings(context.scene)

    def body_ids(self, _scene: bpy.types.Scene) -> dict[bpy.types.Object, str]:
        """Id of each described body; empty without a description."""
        live = evaluation.scene
        pairs = zip(live.objects.bodies, live.description.bodies, strict=True) if live else ()
        return {body: described.id for body, described in pairs}

    def begin(self, client: LiveClient) -> None:
        """Send the description to the output process. The first body wears the devices without a
        wearer of their own. The scene must be open."""
        from ...engine.rendering.moment import moment_header

        assert evaluation.scene is not None
        description = evaluation.scene.description
        header = moment_header(description)
        self._streams = header.streams
        client.describe(header, description.bodies[0].id)

    def frame(
        self, scene: bpy.types.Scene, gains: Mapping[int, float], later: Mapping[float, float]
    ) -> LiveFrame:
        """Samples of the current frame. ``gains``: by device number, as in :class:`LiveFrame`.
        ``later``: frame shown after each actuator latency, by latency in milliseconds; samples of
        a scene at these frames come from the recorded timeline, and are left out without one.

        Raises InputError: an effect or body has a fault.
        """
        from ...devices.workers.live_frame import LiveFrame
        from ...reading.description.scene_settings import play_space_now

        assert evaluation.scene is not None
        objects = evaluation.scene.objects
        return LiveFrame(
            (scene.frame_current_final - scene.frame_start) / fps_of(scene),
            evaluation.runs(),
            gains,
            play_space_now(scene, objects.layer, objects.unit_m)
            if evaluation.with_positions
            else None,
            recorded_runs(later, self._streams),
        )


class TrackSource:
    """The track selected in the scene."""

    fault = ""

    def __init__(self) -> None:
        self.track: PlayedTrack | None = None  # None while closed
        # Paths selected by the user in this session: a .blend must not open network paths.
        self.chosen: set[str] = set()
        self.written: dict[str, str] = {}  # last track written of each scene of the open file
        self._number = 0
        self._key: tuple[object, ...] = ()

    @property
    def generation(self) -> Generation:
        return "track", self._number

    @property
    def is_open(self) -> bool:
        return self.track is not None

    def open(self, context: bpy.types.Context) -> None:
        """Open the selected track if it or the wearer changed; InputError if not readable.

        Closes the track opened before. The scene's first body wears the new one if recorded in it.
        """
        from ...devices.live.track_playback import PlayedTrack

        scene = context.scene
        path = self._path(scene)
        bodies = effects.bodies_of(scene)
        wearer = self.body_ids(scene)[bodies[0]] if bodies else None
        refuse_no_file(path)
        # A new recording under the same name has other times and size: open the file again.
        status = path.stat()
        key = str(path), status.st_mtime_ns, status.st_size, wearer
        if self.track is None or key != self._key:
            self.forget()
            track = PlayedTrack(path)
            if wearer in [body.id for body in track.header.bodies]:
                track.body_id = wearer
            self.track, self._key = track, key

    def body_ids(self, scene: bpy.types.Scene) -> dict[bpy.types.Object, str]:
        """Id of each body of a scene in its tracks, if no body is left out there."""
        return effects.unique_ids(effects.bodies_of(scene))

    def choose(self, scene: bpy.types.Scene) -> None:
        """Note that the track in a scene's settings was selected in this session."""
        self.chosen.add(scene.hfx.live_track)
        self.written.pop(scene.name, None)

    def select_written(self, scene: bpy.types.Scene, path: str) -> None:
        """Select a track just written. Without an undo step: :meth:`restore_written` selects the
        track again after undo."""
        if scene.hfx.live_track != path:
            scene.hfx.live_track = path
        self.written[scene.name] = path

    def restore_written(self) -> None:
        """Select the written tracks again, as undo of an earlier edit takes the settings back."""
        for name, path in [*self.written.items()]:
            if name in bpy.data.scenes:
                self.select_written(bpy.data.scenes[name], path)

    def _path(self, scene: bpy.types.Scene) -> Path:
        """Absolute path of the selected track. InputError if no track is selected, the file is no
        track, or the path is on another machine and was not selected in this session."""
        from ...engine.track import SUFFIX

        selected = scene.hfx.live_track
        if not selected:
            raise InputError("Choose a track, or press Record Track.")
        path = Path(bpy.path.abspath(selected))
        source = Path(bpy.data.filepath) if bpy.data.filepath else None
        if path.suffix.lower() != SUFFIX:
            raise InputError(f"{path}: is no track; choose a {SUFFIX} file.")
        if is_elsewhere(path, source) and selected not in self.chosen:
            raise InputError(f"{path}: is on another machine; choose the file again to play it.")
        return path

    def forget(self) -> None:
        """Close the track and raise :attr:`generation`."""
        if self.track is not None:
            self.track.close()
        self.track, self._key = None, ()
        self._number += 1

    def begin(self, client: LiveClient) -> None:
        assert self.track is not None
        client.describe(self.track.header, self.track.body_id)

    def frame(
        self, scene: bpy.types.Scene, gains: Mapping[int, float], later: Mapping[float, float]
    ) -> LiveFrame:
        assert self.track is not None
        track, fps = self.track, fps_of(scene)
        # The track's own clock: its scene may start at another frame than the open scene.
        times_s = {ms: track.time_s(frame, fps) for ms, frame in later.items()}
        now_s = track.time_s(scene.frame_current_final, fps)
        return track.frame(now_s, later_s=times_s, gains=gains)

    def is_outside(self, scene: bpy.types.Scene, later: Mapping[float, float]) -> bool:
        """Test that the current and all ``later`` frames are before or after the open track."""
        assert self.track is not None
        track, fps = self.track, fps_of(scene)
        frames = (scene.frame_current_final, *later.values())
        return not any(track.start_s <= track.time_s(f, fps) < track.end_s for f in frames)

    def summary(self, scene: bpy.types.Scene) -> str:
        """Sentence about the open track for the panel; empty if none is open."""
        track = self.track
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
