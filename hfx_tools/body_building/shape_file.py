# SPDX-License-Identifier: GPL-3.0-or-later
"""Writing of ``body_models/shapes.npz``."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np

from hfx_blender.engine.arrays import I64
from hfx_blender.engine.retargeting.shape_fields import FORMAT, VERSION, ShapeFields
from hfx_blender.files.atomic import atomic_file


def save(fields: ShapeFields, mirror: I64, path: Path) -> None:
    """Write fields of one half of the body, as 8-bit steps with a scale for each field.

    ``mirror`` (V,) int64: id of the vertex at (-x, y, z); the fields must be symmetric.
    """
    half = np.flatnonzero(np.arange(len(mirror)) <= mirror)
    scale = np.abs(fields.fields).max(axis=(1, 2)) / 127.0
    steps = np.round(fields.fields[:, half] / scale[:, None, None]).astype(np.int8)
    meta = json.dumps({"format": FORMAT, "version": VERSION}, sort_keys=True).encode()
    with atomic_file(path) as file:
        np.savez_compressed(
            file,
            meta=np.frombuffer(meta, np.uint8),
            steps=steps.transpose(0, 2, 1),
            scale_m=scale.astype(np.float32),
            half=half.astype(np.int32),
            mirror=mirror.astype(np.int32),
        )
