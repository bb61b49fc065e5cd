# SPDX-License-Identifier: GPL-3.0-or-later
"""Faults of device configuration files."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from hfx_blender.devices.configurations.configuration_reader import device_from
from hfx_blender.engine.body.model import PerceptualModel, load_model, manifest
from hfx_blender.engine.modality import MODALITIES
from hfx_blender.engine.rendering.actuator_vertices import vertices_of
from hfx_blender.engine.rendering.device_config import VertexPlace
from hfx_blender.errors import InputError
from hfx_blender.files.json_shapes import read


def faults_of(
    path: Path, models: Callable[[str], PerceptualModel] | None = load_model
) -> list[str]:
    """Faults of a configuration file, a sentence each; empty for a usable file.

    Only the first fault of the reading is returned. A readable configuration is then placed on
    the shipped perceptual models, and each actuator that does not fit is a fault; ``models``
    loads a model by id, None skips this.
    """
    try:
        device = device_from(read(path))
    except InputError as error:
        return [str(error)]
    if models is None:
        return []
    faults = []
    for i, actuator in enumerate(device.actuators):
        # The models of the actuator's modality, and of modalities that it substitutes.
        modality = actuator.type.modality
        sources = [s.source for s in device.substitutions.values() if s.target == modality]
        used = {MODALITIES[name].model for name in [modality, *sources]}
        ids = {id for id, model in manifest()["models"].items() if model["modality"] in used}
        if isinstance(actuator.place, VertexPlace):
            ids = {vertex_set.model_id for vertex_set in actuator.place.sets}
        for model_id in sorted(ids):
            try:
                vertices_of(actuator.place, models(model_id))
            except InputError as error:
                faults.append(f"{path}: actuators[{i}].place: {error}")
                break
    return faults
