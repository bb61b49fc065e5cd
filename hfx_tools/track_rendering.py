# SPDX-License-Identifier: GPL-3.0-or-later
"""Rendering of a recorded track for devices, for demos and benches."""

from __future__ import annotations

from collections.abc import Sequence

from hfx_blender.devices.script_rendering import rendering
from hfx_blender.engine.rendering.device_config import DeviceConfig
from hfx_blender.engine.rendering.render import Played, renderers_of_track
from hfx_blender.engine.stepwise import finish
from hfx_blender.engine.track import TrackReader


def render_devices(track: TrackReader, devices: Sequence[DeviceConfig]) -> list[Played]:
    """Render a recorded track for each device on each body.

    Raises ScriptError: a device's script may not run, or has failed.
    Raises InputError: a place of a device does not fit a model, or the models differ from the
    track's.
    """
    return finish(rendering(track, renderers_of_track(track, devices))).complete().played
