# SPDX-License-Identifier: GPL-3.0-or-later
"""Raster of a device from a track in memory, without the device's script."""

from __future__ import annotations

from collections.abc import Iterable

from hfx_blender.engine.body.model import load_model
from hfx_blender.engine.rendering.device_config import DeviceConfig
from hfx_blender.engine.rendering.dispatch import ModelLoader
from hfx_blender.engine.rendering.raster import Raster
from hfx_blender.engine.rendering.render import blocks
from hfx_blender.engine.rendering.renderer import Renderer
from hfx_blender.engine.samples import SampleRun
from hfx_blender.engine.track import TrackHeader


def render(
    header: TrackHeader,
    runs: Iterable[SampleRun],
    device: DeviceConfig,
    models: ModelLoader = load_model,
    *,
    body_id: str | None = None,
) -> Raster:
    """Render a whole track for one device.

    Runs come block after block in time, within a block in the order of ``header.streams``, as from
    ``TrackReader.runs()`` and ``Engine.evaluate``; memory holds a single block. ``models`` loads a
    perceptual model by id. ``body_id``, the wearer, is optional for a track with one body. Raises
    InputError for an unknown body, a device that does not fit a model, or a model other than that
    of the recording.
    """
    renderer = Renderer(header, device, models, body_id=body_id)
    for block in blocks(header, runs):
        renderer.add(block)
    return renderer.raster()
