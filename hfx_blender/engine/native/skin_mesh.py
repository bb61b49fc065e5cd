# SPDX-License-Identifier: GPL-3.0-or-later
"""Triangle mesh of a model's skin as the library reads it; ``skin_mesh.h``."""

from __future__ import annotations

from typing import Any, Protocol
from weakref import WeakKeyDictionary

import numpy as np
import numpy.typing as npt

from .declarations import structure


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
        kind = structure("hfx_skin_mesh")
        _MESHES[mesh] = kind(*(getattr(mesh, name) for name, _ in kind._fields_))
    return _MESHES[mesh]
