# SPDX-License-Identifier: GPL-3.0-or-later
"""Rendering of tracks for one or several devices, on each body that wears them."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence

from ...errors import InputError
from ..body.model import load_model
from ..samples import SampleRun
from ..scene import ActuatorArea, SceneDescription
from ..track import TrackHeader, TrackReader
from .actuator_vertices import rows_of
from .device_config import DeviceConfig
from .dispatch import ModelLoader, rendered_modalities
from .raster import Raster
from .renderer import Renderer

Played = tuple[DeviceConfig, Raster]


def render(
    header: TrackHeader,
    runs: Iterable[SampleRun],
    device: DeviceConfig,
    models: ModelLoader = load_model,
    *,
    body_id: str | None = None,
) -> Raster:
    """Render a whole track for one device.

    Parameters
    ----------
    runs : iterable of SampleRun
        Block after block in time; within a block in the order of ``header.streams``, as
        ``TrackReader.runs()`` and ``Engine.evaluate`` yield them. One block is held at a time.
    models : callable
        Loads a perceptual model by its id.
    body_id : str, optional
        Who wears the device; may be left out if the track has one body.

    Raises
    ------
    InputError
        The wearer is not known, the device does not fit a model, or a model is not the one
        that the track was recorded on.
    """
    renderer = Renderer(header, device, models, body_id=body_id)
    for block in blocks(header, runs):
        renderer.add(block)
    return renderer.raster()


def blocks(header: TrackHeader, runs: Iterable[SampleRun]) -> Iterator[list[SampleRun]]:
    """Cut a track's runs into blocks of time."""
    place = {(s.effect_id, s.body_id): i for i, s in enumerate(header.streams)}
    block: list[SampleRun] = []
    last = -1
    for run in runs:
        here = place[run.stream.effect_id, run.stream.body_id]
        if here <= last:
            yield block
            block = []
        block.append(run)
        last = here
    if block:
        yield block


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
