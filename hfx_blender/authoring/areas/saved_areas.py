# SPDX-License-Identifier: GPL-3.0-or-later
"""The user's own painted areas by name, for all files and modalities."""

from __future__ import annotations

import json
from typing import Any

import bpy

from ...errors import InputError
from ...files import resources
from ...files.atomic import amend_json
from ..effects import effects
from . import painting

_LONGEST_NAME = 60
_MOST_BYTES = 64 << 20


def names() -> list[str]:
    """Names of the saved areas; none where the file cannot be read."""
    return sorted(_read())


def save(effect: bpy.types.Object, name: str) -> int:
    """Keep an effect's area under a name; an empty one takes the name away; returns its size.

    Raises
    ------
    InputError
        The name is empty or too long.
    OutputError
        It cannot be stored.
    """
    import numpy as np

    if not name or len(name) > _LONGEST_NAME:
        raise InputError(f"Name: expected 1 to {_LONGEST_NAME} letters, found {len(name)}.")
    weights = painting.weights_of(effect)
    vertices = np.flatnonzero(weights > 0.0)
    area = {
        "model": effects.model_id_for(effect.hfx.modality),
        "vertices": vertices.tolist(),
        "weights": np.round(weights[vertices], 4).tolist(),
    }

    def content() -> dict[str, Any]:
        known = {other: each for other, each in _read().items() if other != name}
        return {**known, name: area} if len(vertices) else known

    amend_json(resources.saved_areas(), content)
    return len(vertices)


def add(effect: bpy.types.Object, name: str) -> int:
    """Add a saved area to an effect's, carried over to its model; returns the size of both.

    Raises
    ------
    InputError
        There is no such area, or it was saved on another edition of the models.
    """
    import numpy as np

    from ...engine.body import areas
    from ...engine.body.model import load_model

    model = effects.model_of(effect)
    try:
        found = _read()[name]
        source = load_model(found["model"])
        weights = np.zeros(len(source))
        given = np.asarray(found["weights"], np.float64)
        weights[np.asarray(found["vertices"], np.int64)] = np.clip(np.nan_to_num(given), 0.0, 1.0)
    except (KeyError, TypeError, ValueError, IndexError, OverflowError):
        text = f"{resources.saved_areas()}: has no readable area '{name}'; save it again."
        raise InputError(text) from None
    if source is not model:
        weights = areas.transferred(source, weights, model)
    return painting.set_weights(effect, np.maximum(painting.weights_of(effect), weights))


def _read() -> dict[str, Any]:
    try:
        with open(resources.saved_areas(), "rb") as file:
            found = json.loads(file.read(_MOST_BYTES))
    except (OSError, ValueError, RecursionError):
        return {}
    return found if isinstance(found, dict) else {}
