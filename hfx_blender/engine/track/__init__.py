# SPDX-License-Identifier: GPL-3.0-or-later
"""HapticTrack: the device-independent recording on disk, output of the engine.

A track (``.hfxtrack``) says which vertices of which perceptual model feel what, when and how
strongly. :class:`TrackWriter` records blocks of samples as they are computed, :class:`TrackReader`
plays them back from any time. ``docs/track-format.md`` has the layout.
"""

from .header import TrackBody, TrackEffect, TrackHeader, TrackModel
from .reader import StreamSummary, TrackReader
from .writer import TrackWriter

SUFFIX = ".hfxtrack"

__all__ = [
    "SUFFIX",
    "StreamSummary",
    "TrackBody",
    "TrackEffect",
    "TrackHeader",
    "TrackModel",
    "TrackReader",
    "TrackWriter",
]
