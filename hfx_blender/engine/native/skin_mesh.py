# SPDX-License-Identifier: GPL-3.0-or-later
"""Triangle mesh of a model's skin as the library reads it; ``skin_mesh.h``."""

from __future__ import annotations

from typing import Any, Final, Protocol
from weakref import WeakKeyDictionary

import numpy as np
import numpy.typing as npt

from .library import POINTER, pointer, structure

_ARRAYS: Final = ("vertices", "normals", "areas_m2", "triangles", "corners", "starts")
_Mesh = structure("hfx_skin_mesh", **dict.fromkeys(_ARRAYS, POINTER))


class Mesh(Protocol):
    """See :class:`..skin.skin_mesh.SkinMesh`."""

    @property
    def vertices(self) -> npt.NDArray[np.float32]: ...
    @property
    def triangles(self) -> npt.NDArray[np.int32]: ...


_MESHES: WeakKeyDictionary[Mesh, Any] = WeakKeyDictionary()


def mesh_of(mesh: Mesh) -> Any:
    """``hfx_skin_mesh``; the arrays live as long as the mesh."""
    if mesh not in _MESHES:
        arrays = [getattr(mesh, name) for name in _ARRAYS]
        _MESHES[mesh] = _Mesh(*map(pointer, arrays))
    return _MESHES[mesh]
