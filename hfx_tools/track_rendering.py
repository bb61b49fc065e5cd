# SPDX-License-Identifier: GPL-3.0-or-later
"""Rendering of a recorded track for devices, for conversions, demos and benches."""

from __future__ import annotations

from collections.abc import Sequence

from hfx_blender.devices.script_rendering import Rendered, rendering
from hfx_blender.engine.rendering.device_config import DeviceConfig
from hfx_blender.engine.rendering.render import Played, renderers_of_track
from hfx_blender.engine.rendering.renderer import Renderer
from hfx_blender.engine.stepwise import finish
from hfx_blender.engine.track import TrackReader
from hfx_blender.errors import ScriptError


def render_devices(track: TrackReader, devices: Sequence[DeviceConfig]) -> list[Played]:
    """Render a recorded track for each device on each body.

    Raises ScriptError: a device's script may not run, or has failed.
    Raises InputError: a place of a device does not fit a model, or the models differ from the
    track's.
    """
    return complete(track, renderers_of_track(track, devices)).played


def complete(track: TrackReader, renderers: Sequence[tuple[DeviceConfig, Renderer]]) -> Rendered:
    """Render devices; ScriptError for a device without a raster."""
    rendered = finish(rendering(track, renderers))
    for reason in rendered.silent.values():
        raise ScriptError(f"{reason}.")
    return rendered
