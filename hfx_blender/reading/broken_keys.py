# SPDX-License-Identifier: GPL-3.0-or-later
"""Animation that cannot be played: keys that are not numbers."""

from __future__ import annotations

import bpy
import numpy as np

from ..compat import fcurves, strip_fcurves
from ..errors import InputError


def refuse_broken_keys(objects: list[bpy.types.Object]) -> None:
    """Refuse animation with keys that are not numbers: what they would do is anybody's guess."""
    for obj in _with_parents(objects):
        for owner in filter(None, (obj, obj.data)):
            data = owner.animation_data
            if data is None:
                continue
            curves = fcurves(owner)
            for track in data.nla_tracks:
                for strip in track.strips:
                    curves += strip_fcurves(strip)
            for curve in curves:
                keys = np.zeros(len(curve.keyframe_points) * 2, np.float32)
                curve.keyframe_points.foreach_get("co", keys)
                if not np.isfinite(keys).all():
                    number = int(np.flatnonzero(~np.isfinite(keys))[0]) // 2 + 1
                    raise InputError(
                        f"'{obj.name}': key {number} of the F-curve '{curve.data_path}' "
                        f"[{curve.array_index}] is not a finite number; correct or delete it."
                    )


def _with_parents(objects: list[bpy.types.Object]) -> list[bpy.types.Object]:
    found: dict[str, bpy.types.Object] = {}
    for obj in objects:
        while obj is not None and obj.name_full not in found:
            found[obj.name_full] = obj
            obj = obj.parent
    return list(found.values())
