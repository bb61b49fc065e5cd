# SPDX-License-Identifier: GPL-3.0-or-later
"""Extras of a volume's node in a scene file: all that its collider needs to know.

``docs/formats/scene-volume.schema.json`` is their schema.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from ...engine.arrays import F64
from ...engine.modality import MODALITIES, neutral_temperature_c
from ...engine.scene import EffectDescription, HapticVolume, TimeBase
from ...engine.volume.analytic import Capsule, Cuboid, Cylinder, Sphere
from ...engine.volume.shape import Shape
from ...files.strict_json import clean
from .glb import TO_GLTF

_NAMES = {Cuboid: "cuboid", Sphere: "sphere", Cylinder: "cylinder", Capsule: "capsule"}


def volume_extras(
    effect: EffectDescription, shape: Shape, matrices: F64, values: F64, time: TimeBase
) -> dict[str, Any]:
    """Extras of a volume.

    Parameters
    ----------
    matrices : (T, 4, 4) float64
        Shape space to world while it is active.
    values : (T, 1 + P) float64
        Level and parameters at these times.
    """
    assert isinstance(effect.area, HapticVolume)
    falloff = effect.area.falloff
    edges = np.linalg.norm(matrices[0, :3, :3], axis=0) * np.diff(shape.bounds, axis=0)[0]
    names = MODALITIES[effect.modality].parameter_names
    parameters: dict[str, Any] = {
        name: _range(values[:, 1 + k])
        for k, name in enumerate(names)
        if not name.startswith("direction_")
    }
    if effect.modality == "wind":
        parameters["direction"] = (TO_GLTF @ values[0, 2:5]).round(6).tolist()
    if effect.modality == "temperature":
        parameters["neutral_c"] = neutral_temperature_c(effect.is_contact)
    return {
        "hfx_effect": clean(effect.id),
        "modality": effect.modality,
        "model": effect.model_id,
        "shape": _NAMES.get(type(shape), "mesh"),
        "size_m": edges.round(6).tolist(),
        "level": _range(values[:, 0]),
        "parameters": parameters,
        "falloff": {
            "kind": "none" if falloff.is_flat else str(falloff.kind.value),
            "share": 0.0 if falloff.is_flat else falloff.share,
        },
        "clips": [
            {
                "name": clean(clip.name),
                "start_s": _seconds(clip.frame_start, time),
                "end_s": _seconds(clip.frame_end, time),
            }
            for clip in effect.clips
        ],
    }


def _range(values: F64) -> dict[str, float]:
    """First, lowest and highest value while it is active."""
    return {
        "first": round(float(values[0]), 6),
        "lowest": round(float(values.min()), 6),
        "highest": round(float(values.max()), 6),
    }


def _seconds(frame: float, time: TimeBase) -> float:
    """Time of a frame since the first exported one."""
    return round((frame - time.frame_first) / float(time.fps), 6)
