# SPDX-License-Identifier: GPL-3.0-or-later
"""Whole tracks rendered for one device."""

from collections.abc import Callable, Iterable

from hfx_blender.engine.body.model import PerceptualModel, load_model
from hfx_blender.engine.rendering.device import DeviceConfig
from hfx_blender.engine.rendering.raster import Raster
from hfx_blender.engine.rendering.render import Renderer, blocks
from hfx_blender.engine.samples import SampleRun
from hfx_blender.engine.track import TrackHeader


def render(
    header: TrackHeader,
    runs: Iterable[SampleRun],
    device: DeviceConfig,
    models: Callable[[str], PerceptualModel] = load_model,
    *,
    body_id: str | None = None,
) -> Raster:
    """Raster of a track's runs, block after block."""
    renderer = Renderer(header, device, models, body_id=body_id)
    for block in blocks(header, runs):
        renderer.add(block)
    return renderer.raster()
