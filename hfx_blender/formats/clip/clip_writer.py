# SPDX-License-Identifier: GPL-3.0-or-later
"""Writer of clips."""

from pathlib import Path

from ...engine.track.header import TrackHeader
from ...files import limits
from ...files.atomic import atomic_file
from ..signals import losses
from ..written import Written
from . import baked, spatial
from .container import SUFFIX, Texts, encoded, refuse_long
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
    refuse_long(sections, path.name)
    with atomic_file(path) as file:
        file.write(content)
    notes = tuple(note for _, raster in played for note in losses.several_frequencies(raster))
    return Written((path,), notes=notes) + loss
