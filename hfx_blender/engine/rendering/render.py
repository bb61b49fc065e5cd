# SPDX-License-Identifier: GPL-3.0-or-later
"""Rendering of whole tracks for devices, on each wearer."""

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


def blocks(header: TrackHeader, runs: Iterable[SampleRun]) -> Iterator[list[SampleRun]]:
    """Yield the runs of each block of time: successive runs in the order of ``header.streams``."""
    position = {(s.effect_id, s.body_id): i for i, s in enumerate(header.streams)}
    block: list[SampleRun] = []
    previous = -1
    for run in runs:
        current = position[run.stream.effect_id, run.stream.body_id]
        # Within a block streams ascend, so a stream that is not later starts the next block.
        if current <= previous:
            yield block
            block = []
        block.append(run)
        previous = current
    if block:
        yield block


def renderers_of(
    header: TrackHeader,
    devices: Sequence[DeviceConfig],
    body_ids: Sequence[str | None] | None = None,
) -> list[tuple[DeviceConfig, Renderer]]:
    """(Device, renderer) for each body, then each device; ``body_ids`` None: all bodies. An id of
    None is the only body. Raises InputError for an unknown body, or for None with several."""
    ids = [body.id for body in header.bodies] if body_ids is None else body_ids
    return [
        (device, Renderer(header, device, body_id=body_id)) for body_id in ids for device in devices
    ]


def misfits(scene: SceneDescription, devices: Sequence[DeviceConfig]) -> dict[str, str]:
    """Sentence, by id, of each device with a place off a body model of the scene's skin effects.
    Only actuators that show an effect's modality are tested; the first fault counts."""
    on_skin = (e for e in scene.effects if not isinstance(e.area, ActuatorArea))
    # Each pair of modality and model once: several effects share these.
    streams = dict.fromkeys((effect.modality, effect.model_id) for effect in on_skin)
    reasons: dict[str, str] = {}
    for device in devices:
        try:
            for modality, model_id in streams:
                shown = rendered_modalities(device, modality)
                actuators = [a for a in device.actuators if a.type.modality in shown]
                if actuators:
                    rows_of(device, actuators, load_model(model_id))
        except InputError as error:
            reasons[device.id] = f"device '{device.id}' plays nothing: {error}".removesuffix(".")
    return reasons


def renderers_of_track(
    track: TrackReader,
    devices: Sequence[DeviceConfig],
    body_ids: Sequence[str | None] | None = None,
) -> list[tuple[DeviceConfig, Renderer]]:
    """Renderers as :func:`renderers_of`, with the whole track added in one pass."""
    renderers = renderers_of(track.header, devices, body_ids)
    for block in blocks(track.header, track.runs()) if renderers else ():
        for _, renderer in renderers:
            renderer.add(block)
    return renderers
