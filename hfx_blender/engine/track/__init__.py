# SPDX-License-Identifier: GPL-3.0-or-later
"""HapticTrack: device-independent recording of haptic samples on disk.

A track (``.hfxtrack``) stores the weights of vertices of perceptual models over time.
:class:`TrackWriter` records blocks of samples during evaluation, :class:`TrackReader` reads from
any time. The layout is described in ``docs/track-format.md``.
"""

from .header import TrackBody, TrackEffect, TrackHeader, TrackModel
from .track_reader import StreamSummary, TrackReader
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
