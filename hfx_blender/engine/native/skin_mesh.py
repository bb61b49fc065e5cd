# SPDX-License-Identifier: GPL-3.0-or-later
"""Triangle mesh of a model's skin as the library reads it; ``skin_mesh.h``."""

from __future__ import annotations

from typing import Any, Final, Protocol
from weakref import WeakKeyDictionary

import numpy as np
import numpy.typing as npt

from .library import INTS, LONGS, SINGLES, structure

_ARRAYS: Final = {
    **dict.fromkeys(("vertices", "normals", "areas_m2"), SINGLES),
    **{"triangles": INTS, "corners": LONGS, "starts": LONGS},
}
_Mesh = structure("hfx_skin_mesh", **_ARRAYS)


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
        _MESHES[mesh] = _Mesh(*(getattr(mesh, name) for name in _ARRAYS))
    return _MESHES[mesh]
