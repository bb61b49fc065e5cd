# SPDX-License-Identifier: GPL-3.0-or-later
"""Exports each named clip as separate files instead of the whole timeline."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from ..devices.script_rendering import Rendered, rendering
from ..engine.rendering.device_config import DeviceConfig
from ..engine.rendering.render import renderers_of_track
from ..engine.stepwise import finish
from ..engine.track import SUFFIX, TrackReader
from ..engine.track.excerpt import named_clips, write_excerpt
from ..errors import InputError
from ..formats import writing
from ..formats.written import Written
from . import result_files


def write_clips(
    whole: TrackReader,
    formats: Sequence[str],
    devices: Sequence[DeviceConfig],
    rendered: Rendered,
    stem: Path,
    tolerance: float,
) -> tuple[Written, Rendered]:
    """Write separate files for each named clip of a track, each starting at time 0. Device scripts
    restart with each clip. A device whose script fails in any clip is left out of all clips, and is
    among ``silent`` of the returned rendering. Raises InputError without clips."""
    clips = named_clips(whole.header)
    if not clips:
        raise InputError(
            "There are no clips to write one by one: no effect has a clip, or effects with clips "
            "are muted or not solo."
        )
    written = Written()
    of_clips: list[str] = []
    names = result_files.distinct(clip.name for clip in clips)
    for named, name in zip(clips, names, strict=True):
        part = stem.with_name(f"{stem.name}.{name}")
        path = part.with_name(part.name + SUFFIX)
        try:
            write_excerpt(whole, named.effect_ids, named.clip, path)
        except ValueError:
            note = f"clip '{named.name}' is outside the exported frames, so it gets no file"
            written += Written(notes=(note,))
            continue
        with TrackReader(path) as track:
            if not any(stream.sample_count for stream in track.summary()):
                note = f"clip '{named.name}' has no samples, so its files are silent"
                written += Written(notes=(note,))
            if "track" in formats:
                written += Written((path,))
            played_by = [device for device in devices if device.id not in rendered.silent]
            of_clip = finish(rendering(track, renderers_of_track(track, played_by)))
            # A device with files for some clips only would mislead: all clips are written again
            # without it. Each repetition loses a device, so this ends.
            if of_clip.silent:
                reasons = {
                    device: f"clip '{named.name}': {reason}"
                    for device, reason in of_clip.silent.items()
                }
                remaining = rendered.without(reasons)
                return write_clips(whole, formats, devices, remaining, stem, tolerance)
            written += Written(notes=of_clip.notes)
            of_clips += [f"clip '{named.name}': {warning}" for warning in of_clip.warnings]
            played = result_files.placed(whole.header, of_clip.played, stem, part)
            files = writing.write_all(formats, played, track, devices, part, tolerance)
            written += replace(files, left_out=files.prefixed(f"clip '{named.name}'").left_out)
    return written, replace(rendered, warnings=(*rendered.warnings, *of_clips))
