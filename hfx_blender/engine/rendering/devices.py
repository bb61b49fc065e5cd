# SPDX-License-Identifier: GPL-3.0-or-later
"""Renders one track for several devices, on each body that wears them."""

from __future__ import annotations

from collections.abc import Sequence

from ..body.model import load_model
from ..track import TrackHeader, TrackReader
from .device import DeviceConfig
from .raster import Raster
from .render import Renderer, blocks

Played = tuple[DeviceConfig, Raster]


def renderers_of(
    header: TrackHeader,
    devices: Sequence[DeviceConfig],
    body_ids: Sequence[str | None] | None = None,
) -> list[tuple[DeviceConfig, Renderer]]:
    """Make a renderer for each device on each body; or on chosen ones, where None is the only one.

    Raises
    ------
    InputError
        A body is not in the track, or is not the only one.
    """
    ids = [body.id for body in header.bodies] if body_ids is None else body_ids
    return [
        (device, Renderer(header, device, load_model, body_id=body_id))
        for body_id in ids
        for device in devices
    ]


def renderers_given(
    track: TrackReader,
    devices: Sequence[DeviceConfig],
    body_ids: Sequence[str | None] | None = None,
) -> list[tuple[DeviceConfig, Renderer]]:
    """Renderers of :func:`renderers_of`, given a whole track, which is read once."""
    renderers = renderers_of(track.header, devices, body_ids)
    for block in blocks(track.header, track.runs()) if renderers else ():
        for _, renderer in renderers:
            renderer.add(block)
    return renderers
