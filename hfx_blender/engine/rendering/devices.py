# SPDX-License-Identifier: GPL-3.0-or-later
"""Renders one track for several devices, on each body that wears them."""

from __future__ import annotations

from collections.abc import Sequence

from ...errors import InputError
from ..body.model import load_model
from ..scene import ActuatorArea, SceneDescription
from ..track import TrackHeader, TrackReader
from .actuator_vertices import rows_of
from .device import DeviceConfig
from .dispatch import rendered_modalities
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
        (device, Renderer(header, device, body_id=body_id)) for body_id in ids for device in devices
    ]


def misfits(scene: SceneDescription, devices: Sequence[DeviceConfig]) -> dict[str, str]:
    """Devices whose places do not fit a body model that they are to play: id to a sentence."""
    on_skin = (each for each in scene.effects if not isinstance(each.area, ActuatorArea))
    felt = dict.fromkeys((each.modality, each.model_id) for each in on_skin)
    found: dict[str, str] = {}
    for device in devices:
        try:
            for modality, model_id in felt:
                shown = rendered_modalities(device, modality)
                actuators = [each for each in device.actuators if each.type.modality in shown]
                if actuators:
                    rows_of(device, actuators, load_model(model_id))
        except InputError as error:
            found[device.id] = f"device '{device.id}' plays nothing: {error}".removesuffix(".")
    return found


def renderers_of_track(
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
