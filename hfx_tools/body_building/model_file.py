# SPDX-License-Identifier: GPL-3.0-or-later
"""Writing of body models."""

from __future__ import annotations

import json
from dataclasses import fields
from pathlib import Path
from typing import Any

import numpy as np

from hfx_blender.engine.body.model import (
    FORMAT_VERSION,
    Avatar,
    PerceptualModel,
    Skeleton,
    SkinWeights,
    stored_arrays,
)
from hfx_blender.files.atomic import atomic_file

from .walk_cycle import WalkCycle


def save(item: PerceptualModel | Avatar | WalkCycle, path: Path) -> None:
    """Write a model, the avatar or a walk cycle as ``.npz``; equal content gives equal bytes.

    Raises
    ------
    OutputError
        The file cannot be written; an old file stays unchanged.
    """
    meta = {"format": type(item).__name__, "version": FORMAT_VERSION, **_facts(item)}
    meta_bytes = np.frombuffer(json.dumps(meta, sort_keys=True).encode(), np.uint8)
    with atomic_file(path) as file:
        np.savez_compressed(file, meta=meta_bytes, **stored_arrays(item))


def _facts(item: Any) -> dict[str, Any]:
    facts: dict[str, Any] = {}
    for field in fields(item):
        value = getattr(item, field.name)
        if isinstance(value, Skeleton):
            facts[field.name] = {"bone_names": list(value.bone_names)}
        elif not isinstance(value, np.ndarray | SkinWeights):
            facts[field.name] = list(value) if isinstance(value, tuple) else value
    return facts
