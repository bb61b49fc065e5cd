# SPDX-License-Identifier: GPL-3.0-or-later
"""One track rendered for several devices, on each body that wears them."""

from __future__ import annotations

from collections.abc import Sequence

from ..body.model import load_model
from ..track import TrackHeader, TrackReader
from .device import DeviceConfig
from .raster import Raster
from .render import Renderer, blocks

Played = tuple[DeviceConfig, Raster]


def renderers_of(
    header: TrackHeader, devices: Sequence[DeviceConfig]
) -> list[tuple[DeviceConfig, Renderer]]:
    """A renderer for each device on each body."""
    return [
        (device, Renderer(header, device, load_model, body_id=body.id))
        for body in header.bodies
        for device in devices
    ]


def render_devices(track: TrackReader, devices: Sequence[DeviceConfig]) -> list[Played]:
    """A recorded track, read once and rendered for each device on each body."""
    renderers = renderers_of(track.header, devices)
    for block in blocks(track.header, track.runs()) if renderers else ():
        for _, renderer in renderers:
            renderer.add(block)
    return [(device, renderer.raster()) for device, renderer in renderers]
