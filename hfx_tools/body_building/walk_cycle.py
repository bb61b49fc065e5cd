# SPDX-License-Identifier: GPL-3.0-or-later
"""Cycle of walking in place, and its shipped file."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import Any

from hfx_blender.engine.arrays import F32
from hfx_blender.engine.body.model import load, manifest
from hfx_blender.files import resources


@dataclass(frozen=True, eq=False)
class WalkCycle:
    """Seamless cycle of walking in place for the canonical skeleton."""

    rate_hz: float
    stride_m: float  # distance walked in one cycle
    bone_names: tuple[str, ...]
    rotations: F32  # (T, B, 4) quaternions (w, x, y, z); the last frame precedes the first
    root_offset_m: F32  # (T, 3) rest-space offset of the root bone
    provenance: dict[str, Any]


@lru_cache(maxsize=1)
def load_walk() -> WalkCycle:
    """Shipped walk cycle; cached."""
    return load(WalkCycle, resources.body_models() / manifest()["walk"]["file"])
