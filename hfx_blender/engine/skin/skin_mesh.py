# SPDX-License-Identifier: GPL-3.0-or-later
"""The triangles around the vertices of a model that is skin."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final
from weakref import WeakKeyDictionary

import numpy as np

from ..arrays import F32, I32, I64
from ..body.model import PerceptualModel
from ..indexing import sorted_by


@dataclass(frozen=True, eq=False)
class SkinMesh:
    """A model's surface, with the corners of its triangles by their vertices.

    A corner is ``3 f + k``: that of triangle ``f`` which is at its ``k``-th vertex.
    """

    vertices: F32  # (V, 3)
    normals: F32  # (V, 3)
    areas_m2: F32  # (V,)
    triangles: I32  # (F, 3)
    corners: I64  # (3 F,)
    starts: I64  # (V + 1,) each vertex's first

    @classmethod
    def of(cls, model: PerceptualModel) -> SkinMesh:
        """Mesh of a model, which must not change; cached."""
        if model not in _KNOWN:
            corners = sorted_by(model.triangles.ravel(), len(model))
            _KNOWN[model] = cls(
                np.ascontiguousarray(model.vertices, np.float32),
                np.ascontiguousarray(model.normals, np.float32),
                np.ascontiguousarray(model.areas_m2, np.float32),
                np.ascontiguousarray(model.triangles, np.int32),
                *corners,
            )
        return _KNOWN[model]


_KNOWN: Final[WeakKeyDictionary[PerceptualModel, SkinMesh]] = WeakKeyDictionary()
